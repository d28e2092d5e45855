//! The command line.

pub use ballast_benches::args::{Beds, Overrides, jobs, one_or_more, threads};

use ballast::nlgs::solution::Method;
use ballast::track::TampingPhase;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;

/// Grain-scale simulation of railway ballast tamping by non-smooth contact dynamics.
#[derive(Debug, Parser)]
#[command(name = "ballast", version, propagate_version = true, arg_required_else_help = true)]
#[command(after_help = "Exit codes: 0 done, 1 failed, 2 usage, 3 invalid case, 4 transport or \
    deadline, 5 verification mismatch, 6 incompatible version, 130 interrupted after a clean \
    checkpoint.")]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    /// One JSON event per line on stdout instead of tables
    #[arg(long, global = true)]
    pub json: bool,
    /// Worker threads; by default one per processor
    #[arg(long, global = true, value_name = "N", value_parser = threads)]
    pub threads: Option<NonZeroUsize>,
}

/// A state's hash, as it is printed.
fn hash(text: &str) -> Result<u128, String> {
    let is_one = text.len() == 32 && text.bytes().all(|c| c.is_ascii_hexdigit());
    let found = is_one.then(|| u128::from_str_radix(text, 16).ok()).flatten();
    found.ok_or_else(|| "expected a state's hash, 32 hexadecimal digits".into())
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a case: prepare its bed if there is none yet, then simulate the tamping cycle
    Run(Run),
    /// Prepare the bed of a case and keep it for runs
    Prepare(Prepare),
    /// Continue an interrupted run from its checkpoint, bit for bit
    Resume(Resume),
    /// Move the bodies of a case as a recording (MCAP) says, instead of by its machine
    Replay(Replay),
    /// Compute a recording of ours again and name the first difference
    Verify(Verify),
    /// Serve a case over Zenoh: another program moves its bodies, window by window
    #[cfg(feature = "zenoh")]
    Serve(crate::coupling::args::Serve),
    /// Say what a served component is: bodies, time step, units
    #[cfg(feature = "zenoh")]
    Describe(crate::coupling::args::Describe),
    /// Watch a served component: who waits for whom, how far it is, forces
    #[cfg(feature = "zenoh")]
    Top(crate::coupling::args::Top),
    /// Look for what would keep a served component from working here
    #[cfg(feature = "zenoh")]
    Doctor(crate::coupling::args::Doctor),
    #[cfg(not(feature = "zenoh"))]
    #[command(name = "serve", aliases = ["describe", "top", "doctor"], hide = true, disable_help_flag = true)]
    Absent {
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        _rest: Vec<std::ffi::OsString>,
    },
    /// Read a case and say what it asks for, or what is wrong with it
    Check(Check),
    /// Run a case many times with other values, side by side
    Sweep(Sweep),
    /// Say what a bed, a checkpoint, results or the folder of a run hold
    Inspect(Inspect),
    /// Make a page (HTML) about a run: pictures, compactness, forces, energy, quality, settings
    Report(Report),
    /// Check the program against known answers: exact laws, published experiments, convergence
    Validate(Validate),
    /// Write a results file as plain tables (CSV) and shapes that other programs open
    Export(Export),
    /// Solve published friction-contact problems (FCLIB form, HDF5) and measure the errors
    Solve(Solve),
    /// Print the JSON Schema of case files
    Schema {
        /// That of requests and replies over a network instead
        #[arg(long)]
        protocol: bool,
    },
    /// Print the completion script of a shell
    Completions { shell: clap_complete::Shell },
    /// Measure what the program costs: kernel, detection, steps, threads, subdomains
    Bench {
        #[command(subcommand)]
        what: ballast_benches::args::Bench,
    },
}

#[derive(Debug, Args)]
pub struct Run {
    /// Case file (TOML)
    pub case: PathBuf,
    /// Folder of the run's files, where a finished run is replaced; by default runs/<name of the case>
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub beds: Beds,
    #[command(flatten)]
    pub overrides: Overrides,
    #[command(flatten)]
    pub until: Until,
    /// Start over even if the folder holds an unfinished run, or that of another case; a finished one of this case is
    /// replaced without it
    #[arg(long)]
    pub force: bool,
    /// Record the run in an MCAP file, which is replaced
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    #[command(flatten)]
    pub dump: DumpProblems,
}

/// Contact problems kept for `ballast solve` and other programs.
#[derive(Debug, Args)]
pub struct DumpProblems {
    /// Keep contact problems of the run in this folder, in the FCLIB form (local, HDF5)
    #[arg(long, value_name = "DIR")]
    pub dump_problems: Option<PathBuf>,
    /// Steps from one problem to the next
    #[arg(long, value_name = "K", default_value = "100", value_parser = one_or_more::<NonZeroU32>, requires = "dump_problems")]
    pub dump_every: NonZeroU32,
    /// Only of these phases, separated by commas; by default of all
    #[arg(long, value_name = "PHASE", value_delimiter = ',', requires = "dump_problems")]
    #[arg(value_parser = phase())]
    pub dump_phases: Vec<TampingPhase>,
}

/// A phase of the cycle, by name.
fn phase() -> impl TypedValueParser<Value = TampingPhase> {
    let in_cycle = |p: &TampingPhase| !matches!(p, TampingPhase::Waiting | TampingPhase::Done);
    let names = TampingPhase::ALL.into_iter().filter(in_cycle).map(TampingPhase::name);
    let expected = "expected a phase of the cycle";
    PossibleValuesParser::new(names).try_map(move |name| TampingPhase::named(&name).ok_or(expected))
}

#[derive(Debug, Args)]
pub struct Replay {
    /// Recording (MCAP): one of ours, or any with poses of bodies
    pub file: PathBuf,
    /// Case file (TOML) that the bodies belong to; by default the one in a recording of our windows
    #[arg(long, value_name = "CASE")]
    pub case: Option<PathBuf>,
    /// Topic that moves a body, TOPIC=BODY, or TOPIC:FRAME=BODY for transforms; by default our own windows,
    /// or the topics /<body>/pose and transforms to the frame <body>
    #[arg(long, value_name = "MAP")]
    pub map: Vec<ballast_mcap::motion::Map>,
    /// Which time of a message counts; by default its stamp
    #[arg(long)]
    pub time: Option<TimeName>,
    /// Let the bodies begin wherever the recording has them, not where the case has them
    #[arg(long)]
    pub rebase: bool,
    /// Folder of the replay's files; by default runs/<name of the case>-replay
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Start over even if the folder holds a run, an interrupted replay, or the whole replay of another case; any other
    /// replay, also one that --steps stopped, is replaced without it
    #[arg(long)]
    pub force: bool,
    /// Record the replay in another MCAP file
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    #[command(flatten)]
    pub beds: Beds,
    #[command(flatten)]
    pub overrides: Overrides,
    #[command(flatten)]
    pub until: Until,
}

#[derive(Debug, Args)]
pub struct Verify {
    /// Recording of ours (MCAP)
    pub file: PathBuf,
    /// Case file (TOML) to compute with; by default the one in the recording
    #[arg(long, value_name = "CASE")]
    pub case: Option<PathBuf>,
    #[command(flatten)]
    pub beds: Beds,
}

/// The times of a message by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TimeName {
    /// The stamp in the message: when the pose was true
    Stamp,
    /// When the message was recorded
    Log,
}

/// How far to go, and what to find there.
#[derive(Debug, Args)]
pub struct Until {
    /// Stop after this many steps of the run; `resume` goes on from there, but for a replay, which leaves no checkpoint
    #[arg(long, value_name = "N")]
    pub steps: Option<u64>,
    /// Hash that the final state must have; exit code 5 if it differs
    #[arg(long, value_name = "HASH", value_parser = hash)]
    pub expect: Option<u128>,
}

#[derive(Debug, Args)]
pub struct Prepare {
    /// Case file (TOML)
    pub case: PathBuf,
    #[command(flatten)]
    pub beds: Beds,
    /// Seed of the bed, instead of the case's
    #[arg(long)]
    pub seed: Option<u64>,
    /// Prepare again even if the bed is there
    #[arg(long)]
    pub force: bool,
}

#[derive(Debug, Args)]
pub struct Resume {
    /// Checkpoint file; the run's other files are beside it
    pub checkpoint: PathBuf,
    #[command(flatten)]
    pub until: Until,
}

#[derive(Debug, Args)]
pub struct Sweep {
    /// Plan of the sweep (TOML): a case, and what is changed in it
    pub plan: PathBuf,
    /// Folder of the sweep; by default runs/<name of the plan>
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Runs at a time
    #[arg(long, value_name = "N", default_value = "1", value_parser = jobs)]
    pub jobs: NonZeroUsize,
    /// Worker threads of each run
    #[arg(long, value_name = "N", default_value = "1", value_parser = threads)]
    pub threads_each: NonZeroUsize,
    /// Only this point, by its number: for the array jobs of a scheduler
    #[arg(long, value_name = "NUMBER")]
    pub case: Option<usize>,
    /// Print the points with their numbers, and run nothing
    #[arg(long)]
    pub list: bool,
    #[command(flatten)]
    pub beds: Beds,
}

#[derive(Debug, Args)]
pub struct Check {
    /// Case file (TOML)
    pub case: PathBuf,
}

#[derive(Debug, Args)]
pub struct Inspect {
    /// Bed, checkpoint or results file, or the folder of a run
    pub file: PathBuf,
}

#[derive(Debug, Args)]
pub struct Report {
    /// Folder of a run, or a file in it; the checkpoint must be there, which a replay does not leave
    pub run: PathBuf,
    /// The page; by default report.html in the folder of the run
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct Validate {
    /// Small samples only
    #[arg(long)]
    pub quick: bool,
    /// Only these checks, separated by commas: incline, column, arch, dice, collapse, repose, silo, cycle, samples
    #[arg(long, value_name = "CHECK", value_delimiter = ',')]
    pub only: Vec<String>,
    /// Folder for validation.html and validation.json
    #[arg(long, value_name = "DIR", default_value = "runs/validation")]
    pub out: PathBuf,
    /// Folder with samples that LMGC90 settled, to compare with side by side
    #[arg(long, value_name = "DIR")]
    pub samples: Option<PathBuf>,
    #[command(flatten)]
    pub beds: Beds,
}

#[derive(Debug, Args)]
pub struct Export {
    /// Results of a run
    pub results: PathBuf,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

#[derive(Debug, Args)]
pub struct Solve {
    /// A problem (.hdf5), or a folder of problems, all of which are solved
    pub file: PathBuf,
    /// Error ‖F‖/‖q‖ to reach; by default 1e-6, in folders 1e-4, 1e-6 and 1e-8
    #[arg(long, value_name = "T")]
    pub tolerance: Option<f64>,
    /// Most sweeps over all contacts
    #[arg(long, value_name = "N", default_value_t = 200_000)]
    pub max_sweeps: u64,
    /// How to solve; several, separated by commas, are compared
    #[arg(long, value_name = "METHOD", value_delimiter = ',', default_value = "auto")]
    pub method: Vec<MethodName>,
    /// Write a copy of the problem that holds the solution
    #[arg(long, value_name = "OUT")]
    pub write_solution: Option<PathBuf>,
    /// Write the table as CSV
    #[arg(long, value_name = "OUT", value_parser = ballast_session::files::table)]
    pub csv: Option<PathBuf>,
    /// Write the performance profile of the methods, as curves (.html) or CSV: the share of problems that
    /// each solves within a factor of the time of the fastest
    #[arg(long, value_name = "OUT", value_parser = ballast_session::files::table_or_page)]
    pub profile: Option<PathBuf>,
}

/// The methods for given problems by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MethodName {
    /// Sweeps; when they do not get on, accelerated sweeps and Newton's method in turns
    Auto,
    /// Non-linear Gauss-Seidel alone
    Nlgs,
    /// Non-linear Gauss-Seidel with Anderson's acceleration
    Anderson,
    /// A few sweeps and Newton's method in turns
    Newton,
}

impl MethodName {
    /// The name as it is typed.
    pub fn name(self) -> String {
        self.to_possible_value().map_or(String::new(), |value| value.get_name().to_string())
    }
}

impl From<MethodName> for Method {
    fn from(name: MethodName) -> Self {
        match name {
            MethodName::Auto => Method::Auto,
            MethodName::Nlgs => Method::Nlgs,
            MethodName::Anderson => Method::Anderson,
            MethodName::Newton => Method::Newton,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
