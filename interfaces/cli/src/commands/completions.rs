//! `ballast completions SHELL`: the script that lets a shell complete this program's arguments.

use crate::args::Cli;
use crate::console::Console;
use crate::exit::Outcome;
use clap::CommandFactory;
use clap_complete::Shell;
use serde_json::json;

pub fn completions(shell: Shell, console: Console) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "ballast", &mut script);
    let script = String::from_utf8_lossy(&script);
    console.event("completions", json!({ "shell": shell.to_string(), "script": script }));
    console.result(script.trim_end());
    Ok(())
}
