//! Turns the docstrings of the type stub into the macro `stub!`, so that `help` and the stub have equal texts.

use std::fmt::Write;
use std::path::Path;

const STUB: &str = "python/ballast/_ballast.pyi";

fn main() {
    println!("cargo::rerun-if-changed={STUB}");
    let stub = std::fs::read_to_string(STUB).expect("the type stub is readable");
    let mut arms = String::new();
    for (name, text) in docstrings(&stub) {
        writeln!(arms, "    ({name:?}) => {{ {text:?} }};").expect("a string grows");
    }
    let folder = std::env::var("OUT_DIR").expect("cargo sets OUT_DIR");
    let code = format!(
        "/// Returns the docstring of a class or member in the type stub.\n\
         macro_rules! stub {{\n{arms}}}\n"
    );
    std::fs::write(Path::new(&folder).join("stub.rs"), code).expect("OUT_DIR is writable");
}

/// Returns the names of classes and their members with their docstrings.
fn docstrings(stub: &str) -> Vec<(String, String)> {
    let mut found: Vec<(String, String)> = Vec::new();
    let mut class = "";
    let mut name = String::new();
    let mut lines = stub.lines();
    while let Some(line) = lines.next() {
        let code = line.trim_start();
        if let Some(rest) = line.strip_prefix("class ") {
            class = rest.split(['(', ':']).next().unwrap_or_default();
            name = class.into();
        } else if let Some(rest) = code.strip_prefix("def ") {
            let function = rest.split('(').next().unwrap_or_default();
            name = if code == line { function.into() } else { format!("{class}.{function}") };
        } else if let Some(first) = code.strip_prefix("\"\"\"").filter(|_| !name.is_empty()) {
            let mut text = first.to_string();
            while !text.ends_with("\"\"\"") {
                text.push('\n');
                text += lines.next().expect("a docstring has an end").trim_end();
            }
            let text = text.trim_end_matches("\"\"\"").trim_end().to_string();
            let name = std::mem::take(&mut name);
            // Overloads have the docstring of the first one.
            if !found.iter().any(|(known, _)| *known == name) {
                found.push((name, text));
            }
        }
    }
    found
}
