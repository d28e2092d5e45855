//! A module of the core uses only modules declared above it in `src/lib.rs`.

use crate::rust_text::{without_comments_and_literals, without_tests};
use crate::tree;

/// Top-level modules in the order of their declaration.
fn declared(lib: &str) -> Vec<String> {
    let text = without_comments_and_literals(lib);
    text.lines()
        .filter_map(|l| l.trim().trim_start_matches("pub ").strip_prefix("mod "))
        .filter_map(|l| l.strip_suffix(';'))
        .map(str::to_owned)
        .collect()
}

/// Re-exports of the crate's root: name and the module it comes from.
fn re_exported(lib: &str) -> Vec<(String, String)> {
    let text = without_comments_and_literals(lib);
    text.split(';')
        .filter_map(|item| item.trim().strip_prefix("pub use "))
        .filter_map(|path| path.split_once("::"))
        .flat_map(|(module, names)| {
            let names = names.trim_matches(['{', '}']).split(',').map(str::trim);
            names.map(|name| (name.to_owned(), module.to_owned())).collect::<Vec<_>>()
        })
        .collect()
}

/// Modules of the path `src/a/b.rs` or `src/a/mod.rs`.
fn module_path(path: &str) -> Vec<&str> {
    let inside = path.trim_start_matches("src/").trim_end_matches(".rs");
    inside.split('/').filter(|&part| part != "mod").collect()
}

/// Top-level names that `text`, at `depth` modules below the root, reaches through `crate::` and `super::`.
fn reached(text: &str, depth: usize) -> Vec<String> {
    let mut names = Vec::new();
    for (at, _) in text.match_indices("crate::") {
        let continues = text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '_' || c == '$');
        if !continues {
            first_names(&text[at + "crate::".len()..], &mut names);
        }
    }
    // `super::super::x`: as many steps up as there are modules leads to the root.
    let to_root = "super::".repeat(depth);
    for (at, _) in text.match_indices(&to_root) {
        let rest = &text[at + to_root.len()..];
        let longer = text[..at].ends_with("super::") || rest.starts_with("super::");
        if !longer {
            first_names(rest, &mut names);
        }
    }
    names
}

/// First names of a path or of each branch of a braced group: `a::b` gives a, `{a::b, c}` a and c.
fn first_names(rest: &str, names: &mut Vec<String>) {
    let word = |s: &str| s.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
    let Some(group) = rest.strip_prefix('{') else {
        names.push(word(rest));
        return;
    };
    let mut depth = 1;
    let mut branch_starts = true;
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 1 => return,
            '}' => depth -= 1,
            ',' if depth == 1 => branch_starts = true,
            _ if c.is_whitespace() => {}
            _ if branch_starts => {
                names.push(word(&group[at..]));
                branch_starts = false;
            }
            _ => {}
        }
    }
}

/// Objections against one file.
fn objections(path: &str, source: &str, lib: &str) -> Vec<String> {
    let order = declared(lib);
    let re_exports = re_exported(lib);
    let modules = module_path(path);
    let Some(own) = order.iter().position(|m| m == modules[0]) else {
        return vec![format!("{path}: module `{}` is not declared in src/lib.rs", modules[0])];
    };
    let text = without_tests(&without_comments_and_literals(source));
    let mut out = Vec::new();
    for name in reached(&text, modules.len()) {
        let source = re_exports.iter().find(|(n, _)| *n == name).map_or(&name, |(_, m)| m);
        match order.iter().position(|m| m == source) {
            Some(other) if other > own => {
                out.push(format!("{path}: `{}` uses `{name}`, declared below it", modules[0]));
            }
            Some(_) => {}
            None => out.push(format!("{path}: `crate::{name}` is no module of src/lib.rs")),
        }
    }
    out
}

const LIB: &str = "pub mod error;\npub mod math; // pub mod fake;\nmod nlgs;\npub mod step;\npub use error::{Error, Result};";

#[test]
fn a_module_that_looks_down_is_found() {
    for (source, wrong) in [
        ("use crate::math::Vec3;", false),
        ("use crate::step::Phase;", true),
        ("use crate::{math::{Vec3, Quat}, step};", true),
        ("use crate::{Error, math::{Vec3, Quat}};", false),
        ("// crate::step\n", false),
        ("fn f() { crate::step::step() }", true),
        ("use super::super::step::Phase;", true),
        ("use super::super::math::Vec3;", false),
        ("use super::law::step;", false),
        ("#[cfg(test)]\nmod tests { use crate::step; }", false),
        ("use crate::fake::X;", true),
    ] {
        let found = objections("src/nlgs/visit.rs", source, LIB);
        assert_eq!(!found.is_empty(), wrong, "{source}: {found:?}");
    }
    assert!(!objections("src/orphan.rs", "", LIB).is_empty());
    assert!(!objections("src/math/mod.rs", "use super::nlgs::law;", LIB).is_empty());
}

#[test]
fn modules_use_only_modules_declared_above_them() {
    let lib = tree::read("src/lib.rs");
    let core = tree::files("src", &["rs"]);
    let found = core
        .iter()
        .filter(|f| f.path != "src/lib.rs" && !tree::is_test(&f.path))
        .flat_map(|f| objections(&f.path, &f.text, &lib))
        .collect();
    crate::none(found);
}

#[test]
fn the_architecture_names_every_module() {
    let page = tree::read("ARCHITECTURE.md");
    let missing = declared(&tree::read("src/lib.rs"))
        .into_iter()
        .filter(|m| !page.contains(&format!("`{m}`")))
        .map(|m| format!("ARCHITECTURE.md does not name the module `{m}`"))
        .collect();
    crate::none(missing);
}
