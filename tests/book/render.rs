//! Renders the documentation in `docs` to `target/book`.

use mdbook_driver::MDBook;
use std::path::Path;
use std::process::ExitCode;

/// Folder of `book.toml`.
const DOCS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs");

/// Renders the book into `folder`. No network is used.
fn render(folder: &Path) -> Result<(), String> {
    let mut book = MDBook::load(DOCS).map_err(|e| format!("{DOCS}: {e:#}"))?;
    book.config.build.build_dir = folder.to_path_buf();
    book.build().map_err(|e| format!("{DOCS}: {e:#}"))
}

fn main() -> ExitCode {
    let folder = Path::new(DOCS).join("../target/book");
    match render(&folder) {
        Ok(()) => {
            println!("{}", folder.join("index.html").display());
            ExitCode::SUCCESS
        }
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

#[test]
fn the_book_renders_every_page() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    render(folder.path()).expect("a book");
    let summary =
        std::fs::read_to_string(Path::new(DOCS).join("src/SUMMARY.md")).expect("SUMMARY.md");
    let pages = summary.split("](").skip(1).filter_map(|rest| rest.split_once(".md)"));
    let pages: Vec<&str> = pages.map(|(page, _)| page).collect();
    assert!(pages.len() > 30, "the table of contents was not read");
    for page in pages {
        let html = folder.path().join(page).with_extension("html");
        assert!(html.exists(), "{page}.md: expected {}", html.display());
    }
}
