//! `ballast completions SHELL`: the script that lets a shell complete this program's arguments.

use crate::args::Cli;
use crate::console::write_out;
use crate::exit::Outcome;
use clap::CommandFactory;
use clap_complete::Shell;

pub fn completions(shell: Shell) -> Outcome {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "ballast", &mut script);
    write_out(String::from_utf8_lossy(&script).trim_end());
    Ok(())
}
