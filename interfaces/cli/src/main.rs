//! The program `ballast`.
//!
//! Results go to standard output, messages and progress to standard error. [`Failure`] determines the exit code.

mod args;
mod case_run;
mod checkpoint_timer;
mod commands;
mod console;
#[cfg(feature = "zenoh")]
mod coupling;
mod interrupt;
mod nonfatal_errors;
mod panic_hook;
mod problem_dump;
mod progress;
mod recording_start;

use args::{Cli, Command};
use ballast_session::{
    Failure, Result, beds, case, files, lock, profile, recorder, summary_text, table, threads,
};
use clap::Parser;
use console::Console;
use std::process::ExitCode;

fn main() -> ExitCode {
    panic_hook::install();
    let cli = match parse_arguments() {
        Ok(cli) => cli,
        Err(code) => return code,
    };
    let console = Console { json: cli.json };
    let result = dispatch(cli, console);
    if let Err(failure) = &result {
        console.failure(failure);
    }
    console::finish();
    match result {
        // The failed write was reported when it happened.
        Ok(()) if !console::is_complete() => ExitCode::FAILURE,
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => ExitCode::from(failure.code()),
    }
}

/// Parses the command line; returns the exit code after help, version or a usage error.
fn parse_arguments() -> Result<Cli, ExitCode> {
    // Usage errors are events, too, if `--json` stands anywhere.
    let arguments = || std::env::args_os().skip(1);
    let console = Console { json: arguments().any(|argument| argument == "--json") };
    if let Some(argument) = arguments().find(|argument| argument.to_str().is_none()) {
        // Paths are part of events, tables and pages, which are texts.
        let text = format!("expected arguments in UTF-8, found {argument:?}");
        let failure = Failure::Usage(text);
        console.failure(&failure);
        return Err(ExitCode::from(failure.code()));
    }
    Cli::try_parse().map_err(|error| {
        if !error.use_stderr() {
            console::write_out(error.to_string().trim_end());
            return if console::is_complete() { ExitCode::SUCCESS } else { ExitCode::FAILURE };
        }
        // Clap's own output has colours on a terminal.
        let _ = error.print();
        let failure = Failure::Usage(error.to_string().trim_end().to_string());
        console.failure_event(&failure);
        ExitCode::from(failure.code())
    })
}

fn dispatch(cli: Cli, console: Console) -> Result {
    if matches!(cli.command, Command::Sweep(_)) && cli.threads.is_some() {
        let text = "--threads: expected --threads-per-run (threads of each run) or --jobs (runs at a time) for a sweep";
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
            let text = "serve, describe, top, doctor: expected a program with the feature `zenoh`, found one without; build it \
                        with `cargo install --locked --path interfaces/cli`";
            Err(Failure::Usage(text.into()))
        }
        Command::Check(args) => commands::check::check(args, console),
        Command::Inspect(args) => commands::inspect::inspect(args, console),
        Command::Stones(args) => commands::stones::stones(args, console),
        Command::Tool(args) => commands::tool::tool(args, console),
        Command::Report(args) => commands::report::report(args, console),
        Command::Probe { command } => commands::probe::probe(command, console),
        Command::Validate(args) => commands::validate::validate(args, console),
        Command::Export(args) => commands::export::export(args, console),
        Command::Solve(args) => commands::solve::solve(args, console),
        Command::Schema { protocol } => commands::schema::schema(protocol, console),
        Command::Completions { shell } => commands::completions::completions(shell, console),
        Command::Man { folder } => commands::completions::man(&folder, console),
        Command::Bench { command } => commands::bench::bench(command, &console),
    }
}
