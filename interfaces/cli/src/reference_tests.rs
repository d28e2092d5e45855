//! The reference page of the command line, generated from clap.

use crate::args::Cli;
use clap::{Arg, Command, CommandFactory};

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/src/reference/cli.md");

fn in_cell(text: impl ToString) -> String {
    text.to_string().replace('\n', " ").replace('|', "\\|")
}

/// Option as it is typed, with the name of its value.
fn name(arg: &Arg) -> String {
    let values = arg.get_value_names().unwrap_or_default();
    let value = values.first().map(|v| v.as_str()).filter(|_| arg.get_action().takes_values());
    match (arg.get_long(), value) {
        (Some(long), Some(value)) => format!("`--{long} {value}`"),
        (Some(long), None) => format!("`--{long}`"),
        (None, _) => format!("`{}`", value.unwrap_or_else(|| arg.get_id().as_str())),
    }
}

fn section(command: &Command, path: &str) -> String {
    let about = command.get_about().map(in_cell).unwrap_or_default();
    let mut text = format!("\n## {path}\n\n{about}.\n");
    let shown =
        |arg: &&Arg| !arg.is_hide_set() && !matches!(arg.get_id().as_str(), "help" | "version");
    let arguments: Vec<&Arg> = command.get_arguments().filter(shown).collect();
    if !arguments.is_empty() {
        text += "\n| argument | default | meaning |\n|---|---|---|\n";
    }
    for arg in arguments {
        let default = arg.get_default_values().iter().map(|v| format!("`{}`", v.to_string_lossy()));
        let default =
            if arg.get_action().takes_values() { default.collect() } else { String::new() };
        let help = arg.get_help().map(in_cell).unwrap_or_default();
        text += &format!("| {} | {default} | {help} |\n", name(arg));
    }
    for inner in command.get_subcommands().filter(|c| !c.is_hide_set() && c.get_name() != "help") {
        text += &section(inner, &format!("{path} {}", inner.get_name()));
    }
    text
}

#[test]
#[cfg(feature = "zenoh")]
fn the_reference_of_the_command_line_is_current() {
    let head = "# Command line\n\nGenerated from the program; `make docs` writes this page. Exit codes: \
        [error and exit codes](errors.md).\n";
    let wanted = format!("{head}{}", section(&Cli::command(), "ballast"));
    if std::env::var_os("BALLAST_WRITE_DOCS").is_some() {
        std::fs::write(PAGE, &wanted).expect(PAGE);
    }
    let found = std::fs::read_to_string(PAGE).expect(PAGE);
    assert!(found == wanted, "{PAGE}: expected the present command line; run `make docs`");
}
