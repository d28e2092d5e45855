//! Equation numbers: cited ones exist in the theory, and the theory has none without a citation.

use crate::tree;
use std::collections::BTreeSet;

/// Numbers that `text` cites; `T-3 to T-5` cites three.
fn cited(text: &str) -> BTreeSet<u32> {
    let mut numbers = BTreeSet::new();
    for (at, _) in text.match_indices("T-") {
        let inside_word = text[..at].ends_with(|c: char| c.is_alphanumeric() || c == '-');
        let Some((first, rest)) = number(&text[at + 2..]).filter(|_| !inside_word) else {
            continue;
        };
        let last = [" to T-", ") to (T-"]
            .iter()
            .find_map(|joint| rest.strip_prefix(joint))
            .and_then(number)
            .map_or(first, |(last, _)| last);
        numbers.extend(first..=last);
    }
    numbers
}

fn number(text: &str) -> Option<(u32, &str)> {
    let digits = text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    Some((text[..digits].parse().ok()?, &text[digits..]))
}

/// Numbers that the theory defines, in the order in which it does.
fn defined(theory: &str) -> Vec<u32> {
    theory
        .lines()
        .filter_map(|l| l.strip_prefix("**(T-"))
        .filter_map(|l| number(l).map(|(n, _)| n))
        .collect()
}

#[test]
fn citations_and_definitions_are_read() {
    let text = "see (T-3), (T-10 to T-12), (T-17) to (T-18); not MAT-4 nor T-x";
    assert_eq!(cited(text).into_iter().collect::<Vec<_>>(), [3, 10, 11, 12, 17, 18]);
    assert_eq!(defined("**(T-1)** a\n(T-9)\n**(T-2)** b"), [1, 2]);
}

#[test]
fn the_theory_counts_without_gaps() {
    let numbers = defined(&tree::read("docs/src/theory.md"));
    let expected: Vec<u32> = (1..=numbers.len() as u32).collect();
    assert_eq!(numbers, expected);
}

#[test]
fn every_citation_exists() {
    let known: BTreeSet<u32> = defined(&tree::read("docs/src/theory.md")).into_iter().collect();
    let mut places = tree::files(".", &["md"]);
    places.extend(tree::files("src", &["rs"]));
    places.extend(tree::around(&["rs"]));
    places.extend(tree::files("tests/physics", &["rs"]));
    places.extend(tree::files("tests/solver", &["rs"]));
    let unknown = places
        .iter()
        .flat_map(|f| {
            let numbers = cited(&f.text);
            let unknown: Vec<u32> = numbers.difference(&known).copied().collect();
            unknown.into_iter().map(move |n| format!("{}: (T-{n}) is not in the theory", f.path))
        })
        .collect();
    crate::none(unknown);
}

#[test]
fn every_equation_is_cited_by_the_code() {
    let cited: BTreeSet<u32> = tree::sources().iter().flat_map(|f| cited(&f.text)).collect();
    let idle = defined(&tree::read("docs/src/theory.md"))
        .into_iter()
        .filter(|n| !cited.contains(n))
        .map(|n| format!("docs/src/theory.md: no line of code cites (T-{n})"))
        .collect();
    crate::none(idle);
}
