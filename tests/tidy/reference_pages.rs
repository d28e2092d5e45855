//! Reference pages of the book: messages from their `.msg` definitions, command line from the file of help texts.

use crate::tree;
use std::fmt::Write;

const MESSAGES_PAGE: &str = "docs/src/reference/messages.md";
const MESSAGES: &str = "interfaces/protocol/msg/ballast_msgs";
const COMMANDS_PAGE: &str = "docs/src/reference/cli.md";
/// Help texts of all commands; a test of the program keeps them.
const HELP: &str = "interfaces/cli/tests/data/help.txt";

fn add_section(page: &mut String, title: &str, text: &str) {
    let _ = write!(page, "\n## {title}\n\n```text\n{}\n```\n", text.trim());
}

fn messages() -> String {
    let mut page = String::from(
        "# Messages\n\n\
        Generated from `interfaces/protocol/msg/ballast_msgs`; `make docs` writes this page.\n\n\
        Messages on the wire and in recordings are CDR (XCDR1, little endian) with these ROS 2 definitions. SI units, \
        world axes, z up;\nquaternions x, y, z, w. A comment describes the fields below it. Recordings also use stock \
        messages of ROS 2 and\nFoxglove, whose definitions are in `interfaces/protocol/msg`.\n",
    );
    for file in tree::files(MESSAGES, &["msg"]) {
        let name = file.path.trim_start_matches(MESSAGES).trim_matches('/');
        add_section(&mut page, name.trim_end_matches(".msg"), &file.text);
    }
    page
}

fn commands(help: &str) -> String {
    let mut page = String::from(
        "# Command line\n\n\
        Generated from the help texts of the program; `make docs` writes this page. Exit codes:\n\
        [error and exit codes](errors.md).\n",
    );
    for section in help.split("$ ").skip(1) {
        let (command, text) = section.split_once(" --help\n").unwrap_or((section, ""));
        add_section(&mut page, command, text);
    }
    page
}

fn check(page: &str, text: &str) {
    if std::env::var_os("BALLAST_WRITE_DOCS").is_some() {
        std::fs::write(tree::root().join(page), text).expect(page);
    }
    assert!(tree::read(page) == text, "{page}: expected the present sources; run `make docs`");
}

#[test]
fn each_command_is_a_section() {
    let page = commands("$ ballast --help\n\nUse\n\n$ ballast run --help\n\nRun\n");
    assert!(page.contains("\n## ballast\n\n```text\nUse\n```\n"), "{page}");
    assert!(page.ends_with("\n## ballast run\n\n```text\nRun\n```\n"), "{page}");
}

#[test]
fn the_reference_of_messages_is_current() {
    check(MESSAGES_PAGE, &messages());
}

#[test]
fn the_reference_of_commands_is_current() {
    check(COMMANDS_PAGE, &commands(&tree::read(HELP)));
}
