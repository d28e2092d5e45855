//! Relative links of the pages lead somewhere; examples are used.

use crate::tree;
use std::path::Path;

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

/// Links of a page that lead nowhere; links to the web and inside the page are not looked at.
fn broken(page: &str, text: &str, exists: impl Fn(&Path) -> bool) -> Vec<String> {
    let folder = Path::new(page).parent().unwrap_or(Path::new(""));
    targets(text)
        .into_iter()
        .filter(|t| !t.contains("://") && !t.starts_with('#') && !t.starts_with("mailto:"))
        .filter(|t| !exists(&folder.join(t.split('#').next().unwrap_or(t))))
        .map(|t| format!("{page}: link to `{t}`, which does not exist"))
        .collect()
}

#[test]
fn a_broken_link_is_found() {
    let text = "[a](b.md) [c](../d.md#e) [f](https://g.h) `[i](j)`\n```\n[k](l)\n```\n[m](#n)";
    let found = broken("docs/src/x.md", text, |p| p == Path::new("docs/src/b.md"));
    assert_eq!(found.len(), 1, "{found:?}");
    assert!(found[0].contains("../d.md#e"));
}

#[test]
fn links_lead_somewhere() {
    let pages = tree::files(".", &["md"]);
    assert!(pages.iter().any(|p| p.path == "README.md"), "the pages were not found");
    let exists = |p: &Path| tree::root().join(p).exists();
    crate::none(pages.iter().flat_map(|p| broken(&p.path, &p.text, exists)).collect());
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
