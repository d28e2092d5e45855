//! Checks of the style guide (`docs`, style guide): first words, word list, type names, names of limits.

use crate::rust_text::comments_and_literals;
use crate::tree::{self, File};
use std::collections::BTreeMap;
use syn::{Attribute, Item, Meta};

/// Words with which no documentation comment begins: a reader sees the sentence alone, in a list.
const FORBIDDEN_FIRST_WORDS: [&str; 11] =
    ["What", "How", "Whether", "Where", "Of", "The same", "As", "Who", "Which", "Those", "Why"];

/// Phrases that stand for a standard term or for a subject that is missing.
const FORBIDDEN_PHRASES: [&str; 24] = [
    "told",
    "goes on",
    "go on",
    "going on",
    "went on",
    "at hand",
    "let be",
    "by itself",
    "anew",
    "so many",
    "taken back",
    "takes back",
    "take back",
    "of ours",
    "of its own",
    "of one's own",
    "of their own",
    "nobody",
    "somebody",
    "in the mean",
    "today's version",
    "the version before",
    "earlier version",
    "in another sitting",
];

/// Prefixes of constants for which `MAX_` and `MIN_` are the words.
const FORBIDDEN_LIMITS: [&str; 12] = [
    "MOST_",
    "LEAST_",
    "LONGEST_",
    "LARGEST_",
    "FASTEST_",
    "OLDEST_",
    "WIDEST_",
    "NARROWEST_",
    "FLATTEST_",
    "SMALLEST_",
    "SHORTEST_",
    "FURTHEST_",
];

/// Type names that several crates may have: each is the usual name inside its own crate.
const SHARED_TYPE_NAMES: [&str; 4] = ["Error", "Result", "Config", "Args"];

/// Names that are no nouns.
const FORBIDDEN_TYPE_NAMES: [&str; 16] = [
    "Here",
    "There",
    "Few",
    "Every",
    "On",
    "Over",
    "Until",
    "Anew",
    "Aside",
    "Otherwise",
    "Kept",
    "Asked",
    "Given",
    "Told",
    "Said",
    "Seen",
];

/// Texts that a reader of the project sees: sources, pages, stubs, message definitions, scripts.
fn texts() -> Vec<File> {
    let mut all = tree::files(".", &["rs", "md", "py", "pyi", "msg", "toml", "sh"]);
    // This file names what it forbids, and the style guide does so for its readers.
    all.retain(|f| f.path != "tests/tidy/language.rs" && !f.path.ends_with("/style.md"));
    assert!(all.len() > 100, "the project's texts were not found");
    all
}

/// Phrases of the list in `text`, as `line: phrase`; upper and lower case are one, ends of words count.
fn forbidden_phrases(text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (line, words) in text.lines().enumerate() {
        let words = words.to_lowercase();
        for phrase in FORBIDDEN_PHRASES {
            let is_word = |at: usize| {
                let letter = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
                !letter(words[..at].chars().next_back())
                    && !letter(words[at + phrase.len()..].chars().next())
            };
            if words.match_indices(phrase).any(|(at, _)| is_word(at)) {
                found.push(format!("{}: `{phrase}`", line + 1));
            }
        }
    }
    found
}

/// First words of documentation comments that the style guide forbids, as `line: comment`.
fn forbidden_first_words(source: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut before = "";
    for (line, text) in source.lines().map(str::trim).enumerate() {
        let mark = ["///", "//!"].into_iter().find(|mark| text.starts_with(mark));
        if let Some(mark) = mark.filter(|mark| !before.starts_with(mark)) {
            let comment = text[mark.len()..].trim_start();
            let begins = |word: &str| {
                comment
                    .strip_prefix(word)
                    .is_some_and(|rest| !rest.starts_with(char::is_alphanumeric))
            };
            if FORBIDDEN_FIRST_WORDS.into_iter().any(begins) {
                found.push(format!("{}: `{comment}`", line + 1));
            }
        }
        before = text;
    }
    found
}

/// Names that a file defines.
#[derive(Default)]
struct Definitions {
    types: Vec<String>,
    constants: Vec<String>,
}

impl Definitions {
    fn read(source: &str) -> Self {
        let file = syn::parse_file(source).expect("source of the workspace is Rust");
        let mut found = Self::default();
        found.collect(&file.items);
        found
    }

    fn collect(&mut self, items: &[Item]) {
        for item in items {
            match item {
                Item::Struct(i) => self.types.push(i.ident.to_string()),
                Item::Enum(i) => self.types.push(i.ident.to_string()),
                Item::Union(i) => self.types.push(i.ident.to_string()),
                Item::Trait(i) => self.types.push(i.ident.to_string()),
                Item::Type(i) => self.types.push(i.ident.to_string()),
                Item::Const(i) => self.constants.push(i.ident.to_string()),
                Item::Static(i) => self.constants.push(i.ident.to_string()),
                Item::Mod(i) if !is_test(&i.attrs) => {
                    if let Some((_, items)) = &i.content {
                        self.collect(items);
                    }
                }
                _ => {}
            }
        }
    }
}

/// Returns true for `#[cfg(test)]`.
fn is_test(attributes: &[Attribute]) -> bool {
    attributes.iter().any(|a| match &a.meta {
        Meta::List(list) => list.path.is_ident("cfg") && list.tokens.to_string() == "test",
        _ => false,
    })
}

/// Type names that stand in several places of `files`, and names that are no nouns.
fn type_name_objections(files: &[File]) -> Vec<String> {
    let mut places: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for file in files {
        for name in Definitions::read(&file.text).types {
            places.entry(name).or_default().push(&file.path);
        }
    }
    let mut out = Vec::new();
    for (name, places) in places {
        if places.len() > 1 && !SHARED_TYPE_NAMES.contains(&name.as_str()) {
            out.push(format!(
                "type `{name}` is defined {} times: {}",
                places.len(),
                places.join(", ")
            ));
        }
        if FORBIDDEN_TYPE_NAMES.contains(&name.as_str()) {
            out.push(format!("{}: the type name `{name}` is no noun", places[0]));
        }
    }
    out
}

fn limit_objections(file: &File) -> Vec<String> {
    let names = Definitions::read(&file.text).constants;
    let wrong = |name: &&String| FORBIDDEN_LIMITS.iter().any(|prefix| name.starts_with(prefix));
    let say = |name: &String| format!("{}: limits are MAX_ or MIN_, found `{name}`", file.path);
    names.iter().filter(wrong).map(say).collect()
}

#[test]
fn each_language_rule_objects() {
    assert_eq!(forbidden_first_words("/// What it is.\n/// As well.\n//! Velocity.").len(), 1);
    assert!(forbidden_first_words("/// Whatever.\n/// Assembles.\n").is_empty());
    assert_eq!(forbidden_phrases("It goes on.\nForgotten, retold, told").len(), 2);
    assert!(forbidden_phrases("cargo on, canewood").is_empty());
    let file = |path: &str, text: &str| File { path: path.into(), text: text.into() };
    let files = [
        file("a.rs", "struct A; #[cfg(test)] mod t { struct B; }"),
        file("b.rs", "enum A {} enum B {}"),
    ];
    assert_eq!(type_name_objections(&files).len(), 1);
    assert_eq!(type_name_objections(&[file("a.rs", "struct Few;")]).len(), 1);
    assert_eq!(
        limit_objections(&file("a.rs", "const MOST_X: u32 = 1; const MAX_X: u32 = 1;")).len(),
        1
    );
}

#[test]
fn documentation_begins_with_the_thing() {
    let rust = texts().into_iter().filter(|f| f.path.ends_with(".rs"));
    let say = |f: File| {
        let found = forbidden_first_words(&f.text);
        found.into_iter().map(move |at| format!("{}:{at}", f.path))
    };
    crate::none(rust.flat_map(say).collect());
}

#[test]
fn texts_are_free_of_listed_phrases() {
    let say = |f: File| {
        let text = if f.path.ends_with(".rs") { comments_and_literals(&f.text) } else { f.text };
        forbidden_phrases(&text).into_iter().map(move |at| format!("{}:{at}", f.path))
    };
    crate::none(texts().into_iter().flat_map(say).collect());
}

#[test]
fn type_names_are_unique_nouns() {
    crate::none(type_name_objections(&tree::sources()));
}

#[test]
fn limits_are_max_or_min() {
    crate::none(tree::sources().iter().flat_map(limit_objections).collect());
}
