//! Generated reference files: help texts and quantities. `BALLAST_WRITE_DOCS=1` writes them.

use crate::setup::program;
use std::path::Path;

/// Compares a generated text with its file, or writes the file.
fn expect_file(path: &str, text: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    if std::env::var_os("BALLAST_WRITE_DOCS").is_some() {
        std::fs::write(&path, text).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    let line = text.lines().zip(found.lines()).position(|(a, b)| a != b);
    assert!(
        found == text,
        "{}: expected the generated text, found another one from line {line:?} on; run the tests with BALLAST_WRITE_DOCS=1",
        path.display()
    );
}

/// Appends the help of a command and of its subcommands.
fn add_help(command: &[&str], text: &mut String) {
    let output = program().args(command).arg("--help").env("COLUMNS", "100").output().unwrap();
    let help = String::from_utf8(output.stdout).unwrap();
    *text += &format!(
        "$ ballast {}\n\n{}\n\n",
        [command, &["--help"]].concat().join(" "),
        help.trim_end()
    );
    let commands = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let names = commands.take_while(|line| !line.is_empty()).filter_map(|line| {
        let is_name = line.starts_with("  ") && !line.starts_with("   ");
        line.split_whitespace().next().filter(|name| is_name && *name != "help")
    });
    for name in names {
        add_help(&[command, &[name]].concat(), text);
    }
}

#[test]
fn help_texts_are_those_of_the_golden_file() {
    let mut text = String::new();
    add_help(&[], &mut text);
    let text = format!("{}\n", text.trim_end());
    // Only the full program has all commands.
    if text.contains("$ ballast serve") {
        expect_file("tests/data/help.txt", &text);
    }
}

#[test]
fn manual_pages_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let output = program().arg("man").arg(folder.path()).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let page = std::fs::read_to_string(folder.path().join("ballast-run.1")).unwrap();
    assert!(page.contains(".TH ballast-run 1"), "{page}");
}

#[test]
fn reference_page_of_quantities_is_generated() {
    expect_file("../../docs/src/reference/quantities.md", &ballast_session::quantities::markdown());
}
