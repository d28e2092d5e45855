//! `ballast completions SHELL` and `ballast man DIR`: files for shells and manuals.

use crate::args::Cli;
use crate::console::Console;
use ballast_session::files::create_folder;
use ballast_session::{Failure, Reporter, Result};
use clap::CommandFactory;
use clap_complete::Shell;
use serde_json::json;
use std::path::Path;

/// Prints the completion script of a shell.
pub fn completions(shell: Shell, console: Console) -> Result {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "ballast", &mut script);
    let script = String::from_utf8_lossy(&script);
    console.event("completions", json!({ "shell": shell.to_string(), "script": script }));
    console.result(script.trim_end());
    Ok(())
}

/// Writes a manual page for each command.
pub fn man(folder: &Path, console: Console) -> Result {
    create_folder(folder)?;
    clap_mangen::generate_to(Cli::command(), folder).map_err(|e| Failure::at(folder, e))?;
    console.event("done", json!({ "folder": folder }));
    console.result(&folder.display().to_string());
    Ok(())
}
