//! The house's rules, held by tests: layers, purity, sizes, citations, dependencies, links.
//!
//! Each rule is a function on text that returns what it objects to, so that it can be shown to
//! object (the module's own tests) before it is let loose on the tree.

mod circles;
mod citations;
mod language;
mod layers;
mod links;
mod manifests;
mod reference_pages;
mod rust_text;
mod tree;
mod words;

/// Fails with one objection per line.
fn none(objections: Vec<String>) {
    assert!(objections.is_empty(), "\n{}", objections.join("\n"));
}
