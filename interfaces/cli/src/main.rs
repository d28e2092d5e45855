//! The program `ballast`: runs cases from the command line.
//!
//! Results go to stdout, messages and progress to stderr; [`exit`] decides the exit codes.

mod args;
mod aside;
mod commands;
mod console;
#[cfg(feature = "zenoh")]
mod coupling;
mod dump;
mod engine;
mod exit {
    pub use ballast_session::{Failure, Outcome};
}
mod interrupt;
mod memory;
mod playback;
mod progress;
#[cfg(test)]
mod reference_tests;
mod room;
mod session;
mod start;
mod taping;

use args::{Cli, Command};
use ballast_session::{Failure, Outcome};
use ballast_session::{
    beds, case, files, lock, machine, profile, recorder, summary_text, table, threads,
};
use clap::Parser;
use console::Console;
use std::process::ExitCode;

fn main() -> ExitCode {
    let (cli, console) = match called() {
        Ok(cli) => {
            let console = Console { json: cli.json };
            (cli, console)
        }
        Err(code) => return code,
    };
    let ended = dispatch(cli, console);
    if let Err(failure) = &ended {
        console.failure(failure);
    }
    console::finish();
    match ended {
        // What was not written has been told.
        Ok(()) if !console::was_heard() => ExitCode::FAILURE,
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => ExitCode::from(failure.code()),
    }
}

/// What is asked for; else how the program ends: help and version are told, and usage errors.
fn called() -> Result<Cli, ExitCode> {
    // Before anything is parsed, events are as good as asked for where the word stands.
    let given = || std::env::args_os().skip(1);
    let console = Console { json: given().any(|argument| argument == "--json") };
    if let Some(odd) = given().find(|argument| argument.to_str().is_none()) {
        // Paths stand in events, tables and pages, which are texts.
        let failure = Failure::Usage(format!("expected arguments that are UTF-8, found {odd:?}"));
        console.failure(&failure);
        return Err(ExitCode::from(failure.code()));
    }
    Cli::try_parse().map_err(|told| {
        if !told.use_stderr() {
            console::write_out(told.to_string().trim_end());
            return if console::was_heard() { ExitCode::SUCCESS } else { ExitCode::FAILURE };
        }
        // In colours where there is a terminal.
        let _ = told.print();
        let failure = Failure::Usage(told.to_string().trim_end().to_string());
        console.failure_event(&failure);
        ExitCode::from(failure.code())
    })
}

fn dispatch(cli: Cli, console: Console) -> Outcome {
    if matches!(cli.command, Command::Sweep(_)) && cli.threads.is_some() {
        let text = "--threads: the runs of a sweep have theirs, --threads-each; --jobs are the runs at a time";
        return Err(Failure::Usage(text.into()));
    }
    threads::start(cli.threads)?;
    match cli.command {
        Command::Run(args) => commands::run::run(args, console),
        Command::Prepare(args) => commands::prepare::prepare(args, console),
        Command::Resume(args) => commands::resume::resume(args, console),
        Command::Replay(args) => commands::replay::replay(args, console),
        Command::Verify(args) => commands::verify::verify(args, console),
        Command::Sweep(args) => commands::sweep::sweep(args, console),
        #[cfg(feature = "zenoh")]
        Command::Serve(args) => coupling::serve::serve(args, console),
        #[cfg(feature = "zenoh")]
        Command::Describe(args) => coupling::describe::describe(args, console),
        #[cfg(feature = "zenoh")]
        Command::Top(args) => coupling::top::top(args, console),
        #[cfg(feature = "zenoh")]
        Command::Doctor(args) => coupling::doctor::doctor(args, console),
        #[cfg(not(feature = "zenoh"))]
        Command::Absent { .. } => {
            let text = "serve, describe, top and doctor: this program was built without the network; built with its \
                        feature `zenoh`, as `cargo install --locked --path interfaces/cli` does, it has them";
            Err(Failure::Usage(text.into()))
        }
        Command::Check(args) => commands::check::check(args, console),
        Command::Inspect(args) => commands::inspect::inspect(args, console),
        Command::Report(args) => commands::report::report(args, console),
        Command::Validate(args) => commands::validate::validate(args, console),
        Command::Export(args) => commands::export::export(args, console),
        Command::Solve(args) => commands::solve::solve(args, console),
        Command::Schema { protocol } => commands::schema::schema(protocol, console),
        Command::Completions { shell } => commands::completions::completions(shell, console),
        Command::Bench { what } => commands::bench::bench(what, console),
    }
}
