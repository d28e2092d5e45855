//! Checks of links, headings and the table of contents of the pages; every example is used.

use crate::tree;
use std::path::{Component, Path, PathBuf};

/// Folder of the book's pages: their links stay inside it, because the rendered book has nothing else.
const BOOK: &str = "docs/src/";

/// Targets of the Markdown links of `text`, code left out.
fn targets(text: &str) -> Vec<String> {
    let mut fenced = false;
    let mut out = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            fenced = !fenced;
        }
        if fenced || line.starts_with("    ") {
            continue;
        }
        let prose: String = line.split('`').step_by(2).collect();
        for (at, _) in prose.match_indices("](") {
            let rest = &prose[at + 2..];
            out.extend(rest.find(')').map(|end| rest[..end].to_owned()));
        }
    }
    out
}

/// Anchor that mdBook and GitHub give to a heading: lower case, hyphens for spaces, no punctuation.
fn anchor(heading: &str) -> String {
    let kept = |c: &char| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_');
    heading.trim().to_lowercase().chars().filter(kept).collect::<String>().replace(' ', "-")
}

/// Anchors of all headings of a page.
fn anchors(text: &str) -> Vec<String> {
    let mut fenced = false;
    let mut found = Vec::new();
    for line in text.lines() {
        fenced ^= line.starts_with("```");
        if let Some(heading) = line.strip_prefix('#').filter(|_| !fenced) {
            found.push(anchor(heading.trim_start_matches('#')));
        }
    }
    found
}

/// Path without `.` and `..`.
fn normalised(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => drop(out.pop()),
            Component::CurDir => {}
            other => out.push(other),
        }
    }
    out
}

/// Links of a page to files or headings that do not exist; links to the web are not checked.
///
/// `page_text` returns the text of a page, or an empty one for other files that exist.
fn broken(page: &str, text: &str, page_text: impl Fn(&Path) -> Option<String>) -> Vec<String> {
    let folder = Path::new(page).parent().unwrap_or(Path::new(""));
    let mut found = Vec::new();
    for target in targets(text) {
        if target.contains("://") || target.starts_with("mailto:") {
            continue;
        }
        let (file, heading) = target.split_once('#').unwrap_or((&target, ""));
        let file =
            if file.is_empty() { PathBuf::from(page) } else { normalised(&folder.join(file)) };
        if page.starts_with(BOOK) && !file.starts_with(BOOK) {
            found.push(format!("{page}: link to `{target}`, which is not part of the book"));
        }
        match page_text(&file) {
            None => found.push(format!("{page}: link to `{target}`, which does not exist")),
            Some(text) if !heading.is_empty() && !anchors(&text).iter().any(|a| a == heading) => {
                found.push(format!("{page}: link to `{target}`, a heading that does not exist"));
            }
            Some(_) => {}
        }
    }
    found
}

#[test]
fn a_broken_link_is_found() {
    let text = "[a](b.md) [c](../d.md#e) [f](https://g.h) `[i](j)`\n```\n[k](l)\n```\n[m](#n) [o](b.md#two-words)";
    let found = broken("docs/x.md", text, |p| {
        let page = [("docs/b.md", "# One\n## Two `words`!"), ("docs/x.md", "# N")];
        page.iter().find(|(name, _)| Path::new(name) == p).map(|(_, text)| (*text).into())
    });
    assert_eq!(found, ["docs/x.md: link to `../d.md#e`, which does not exist"]);
    let outside = broken("docs/src/x.md", "[a](../../README.md)", |_| Some(String::new()));
    assert_eq!(
        outside,
        ["docs/src/x.md: link to `../../README.md`, which is not part of the book"]
    );
    let heading = broken("README.md", "[a](b.md#no)", |_| Some("# yes".into()));
    assert_eq!(heading, ["README.md: link to `b.md#no`, a heading that does not exist"]);
}

#[test]
fn links_lead_to_files_and_headings() {
    let pages = tree::files(".", &["md"]);
    assert!(pages.iter().any(|p| p.path == "README.md"), "the pages were not found");
    let page_text = |path: &Path| {
        let page = pages.iter().find(|p| Path::new(&p.path) == path);
        page.map(|p| p.text.clone()).or_else(|| tree::root().join(path).exists().then(String::new))
    };
    crate::none(pages.iter().flat_map(|p| broken(&p.path, &p.text, page_text)).collect());
}

#[test]
fn the_summary_lists_every_page_of_the_book_once() {
    let summary = tree::read("docs/src/SUMMARY.md");
    let listed: Vec<String> = targets(&summary.replace("    -", "-"));
    let pages = tree::files(BOOK, &["md"]);
    let mut objections = Vec::new();
    for page in pages.iter().filter(|p| !p.path.ends_with("SUMMARY.md")) {
        let name = page.path.trim_start_matches(BOOK);
        let count = listed.iter().filter(|target| *target == name).count();
        if count != 1 {
            objections.push(format!(
                "docs/src/SUMMARY.md: `{name}` is listed {count} times, expected once"
            ));
        }
    }
    crate::none(objections);
}

/// Examples whose file name occurs in none of the texts.
fn unused<'a>(examples: &[&'a str], texts: &[&str]) -> Vec<&'a str> {
    let named = |path: &str| {
        let name = path.rsplit('/').next().unwrap_or(path);
        texts.iter().any(|t| t.contains(name))
    };
    examples.iter().copied().filter(|e| !named(e)).collect()
}

#[test]
fn an_unused_example_is_found() {
    assert_eq!(unused(&["examples/a.toml", "examples/b.py"], &["runs a.toml"]), ["examples/b.py"]);
}

#[test]
fn examples_are_named_by_tests_or_pages() {
    let examples = tree::files("examples", &["toml", "rs", "py"]);
    let mut users = tree::files(".", &["md"]);
    users.extend(tree::files("tests", &["rs"]));
    users.extend(tree::around(&["rs"]));
    let texts: Vec<&str> = users.iter().map(|f| f.text.as_str()).collect();
    let paths: Vec<&str> = examples.iter().map(|f| f.path.as_str()).collect();
    let idle = unused(&paths, &texts);
    crate::none(idle.iter().map(|e| format!("{e}: no test and no page names it")).collect());
}
