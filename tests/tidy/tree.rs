//! The project's own files.

use std::fs;
use std::path::{Path, PathBuf};

/// A text file: path relative to the project's root, with forward slashes, and contents.
pub struct File {
    pub path: String,
    pub text: String,
}

pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// The text of one file that has to be there.
pub fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// Files below `folder` with one of the extensions, in the order of their paths.
pub fn files(folder: &str, extensions: &[&str]) -> Vec<File> {
    let mut found = Vec::new();
    collect(&root().join(folder), extensions, &mut found);
    found.sort_by(|a, b| a.path.cmp(&b.path));
    found
}

/// Files around the core, as [`files`].
pub fn around(extensions: &[&str]) -> Vec<File> {
    ["interfaces", "bindings", "validation", "benches"]
        .iter()
        .flat_map(|folder| files(folder, extensions))
        .collect()
}

/// Source of the core and of what is around it, tests left out.
pub fn sources() -> Vec<File> {
    let mut all = files("src", &["rs"]);
    all.extend(around(&["rs"]).into_iter().filter(|f| f.path.contains("/src/")));
    all.retain(|f| !is_test(&f.path));
    assert!(all.len() > 20, "the tree's sources were not found");
    all
}

/// Returns true if a file below `src` holds tests only: `tests.rs`, `*_tests.rs`, `tests/*.rs`.
pub fn is_test(path: &str) -> bool {
    path.ends_with("/tests.rs") || path.ends_with("_tests.rs") || path.contains("/tests/")
}

fn collect(folder: &Path, extensions: &[&str], found: &mut Vec<File>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for entry in entries {
        let path = entry.expect("a readable folder").path();
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        if name == "target" || name.starts_with('.') {
            continue;
        }
        if path.is_dir() {
            collect(&path, extensions, found);
        } else if path.extension().and_then(|e| e.to_str()).is_some_and(|e| extensions.contains(&e))
        {
            let relative = path.strip_prefix(root()).expect("below the root");
            let text = fs::read_to_string(&path).unwrap_or_else(|e| panic!("{path:?}: {e}"));
            found.push(File { path: relative.to_string_lossy().replace('\\', "/"), text });
        }
    }
}
