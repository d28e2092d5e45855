//! The command line.

pub use ballast_benches::args::{BedCacheArgs, OverrideArgs, thread_count};

use ballast::component::{PushProbe, StiffnessProbe};
use ballast::nlgs::solution::Method;
use ballast::track::TampingPhase;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::time::Duration;

/// Simulate the tamping of railway ballast grain by grain with non-smooth contact dynamics
#[derive(Debug, Parser)]
#[command(name = "ballast", version, propagate_version = true, arg_required_else_help = true)]
#[command(
    after_help = "Exit codes: 0 success, 1 failure, 2 usage, 3 invalid case, 4 transport or deadline, \
    5 verification mismatch, 6 incompatible version, 130 interrupted after a clean checkpoint."
)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
    /// Print one JSON event per line on standard output instead of tables
    #[arg(long, global = true)]
    pub json: bool,
    /// Number of worker threads (default: one per processor)
    #[arg(long, global = true, value_name = "N", value_parser = thread_count())]
    pub threads: Option<usize>,
}

/// Parses the hash of a state in the form in which the program prints it.
fn hash(text: &str) -> Result<u128, String> {
    let is_hash = text.len() == 32 && text.bytes().all(|c| c.is_ascii_hexdigit());
    let found = is_hash.then(|| u128::from_str_radix(text, 16).ok()).flatten();
    found.ok_or_else(|| "expected the hash of a state, 32 hexadecimal digits".into())
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a case: prepare its bed if necessary, then simulate the tamping cycle
    Run(RunArgs),
    /// Prepare the bed of a case and store it in the bed cache
    Prepare(PrepareArgs),
    /// Continue an interrupted run from its checkpoint, bit for bit
    Resume(ResumeArgs),
    /// Replay a recording (MCAP): move the bodies of a case along recorded motions
    Replay(ReplayArgs),
    /// Recompute a recording and report the first difference
    Verify(VerifyArgs),
    /// Serve a case over Zenoh: a partner moves its bodies, window by window
    #[cfg(feature = "zenoh")]
    Serve(crate::coupling::args::ServeArgs),
    /// Print a description of a served component: bodies, time step, units
    #[cfg(feature = "zenoh")]
    Describe(crate::coupling::args::DescribeArgs),
    /// Monitor a served component: owner, progress, forces
    #[cfg(feature = "zenoh")]
    Top(crate::coupling::args::TopArgs),
    /// Diagnose connection problems of served components on this machine
    #[cfg(feature = "zenoh")]
    Doctor(crate::coupling::args::DoctorArgs),
    #[cfg(not(feature = "zenoh"))]
    #[command(name = "serve", aliases = ["describe", "top", "doctor"], hide = true, disable_help_flag = true)]
    Absent {
        #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
        _rest: Vec<std::ffi::OsString>,
    },
    /// Check a case and print a summary of it
    Check(CheckArgs),
    /// Run a case many times with varied values, in parallel
    Sweep(SweepArgs),
    /// Print a summary of a bed, a checkpoint, results or the folder of a run
    Inspect(crate::commands::inspect::InspectArgs),
    /// Make stones of a case from surface meshes, such as scans
    Stones(crate::commands::stones::StonesArgs),
    /// Make the convex parts of a tine from a surface mesh, such as a CAD model
    Tool(crate::commands::tool::ToolArgs),
    /// Write an HTML report of a run: pictures, compactness, forces, energy, quality, settings
    Report(crate::commands::report::ReportArgs),
    /// Measure support stiffness or lateral resistance of a sleeper on its bed
    Probe {
        #[command(subcommand)]
        command: ProbeCommand,
    },
    /// Validate the program against exact laws, published experiments and convergence
    Validate(ValidateArgs),
    /// Export a results file as CSV tables and VTK shapes, or a case as a co-simulation unit (FMU)
    Export(ExportArgs),
    /// Solve friction-contact problems (FCLIB, HDF5) and measure the errors
    Solve(SolveArgs),
    /// Print the JSON Schema of case files
    Schema {
        /// Print the schema of requests and replies of the network protocol instead
        #[arg(long)]
        protocol: bool,
    },
    /// Print the completion script of a shell
    Completions {
        /// Shell
        shell: clap_complete::Shell,
    },
    /// Write the manual pages of all commands
    #[command(hide = true)]
    Man {
        /// Folder to write to
        folder: PathBuf,
    },
    /// Measure the performance: kernel, detection, steps, threads, subdomains
    Bench {
        #[command(subcommand)]
        command: ballast_benches::args::BenchCommand,
    },
}

#[derive(Debug, Args)]
pub struct RunArgs {
    /// Case file (TOML)
    pub case: PathBuf,
    /// Folder of the run's files; a finished run in it is replaced (default: runs/<name of the case>)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub beds: BedCacheArgs,
    #[command(flatten)]
    pub overrides: OverrideArgs,
    #[command(flatten)]
    pub stop: StopAt,
    /// Replace an unfinished or a longer run, or the run of another case, in the folder
    #[arg(long)]
    pub force: bool,
    /// Record the run in this MCAP file, which is replaced
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    #[command(flatten)]
    pub checkpoint: CheckpointArgs,
    #[command(flatten)]
    pub dump: DumpArgs,
}

/// Checkpoints by wall time.
#[derive(Debug, Args)]
pub struct CheckpointArgs {
    /// Maximum wall time between checkpoints in seconds (0: after every step)
    #[arg(long, value_name = "S", default_value = "300", value_parser = seconds)]
    pub checkpoint_every: Duration,
}

/// Parses a duration in seconds.
pub fn seconds(text: &str) -> Result<Duration, String> {
    let s = text.parse().ok().and_then(|s| Duration::try_from_secs_f64(s).ok());
    s.ok_or_else(|| "expected seconds, 0 or more".into())
}

/// Contact problems stored for `ballast solve` and other programs.
#[derive(Debug, Args)]
pub struct DumpArgs {
    /// Store contact problems of the run in this folder (FCLIB local form, HDF5)
    #[arg(long, value_name = "DIR")]
    pub dump_problems: Option<PathBuf>,
    /// Steps between two stored problems
    #[arg(long, value_name = "K", default_value = "100", requires = "dump_problems")]
    pub dump_every: NonZeroU32,
    /// Phases of which problems are stored, separated by commas (default: all)
    #[arg(long, value_name = "PHASE", value_delimiter = ',', requires = "dump_problems")]
    #[arg(value_parser = phase())]
    pub dump_phases: Vec<TampingPhase>,
}

/// Returns a parser of the names of the cycle's phases.
fn phase() -> impl TypedValueParser<Value = TampingPhase> {
    let in_cycle = |p: &TampingPhase| !matches!(p, TampingPhase::Waiting | TampingPhase::Done);
    let names = TampingPhase::ALL.into_iter().filter(in_cycle).map(TampingPhase::name);
    let expected = "expected a phase of the cycle";
    PossibleValuesParser::new(names).try_map(move |name| TampingPhase::named(&name).ok_or(expected))
}

#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// Recording (MCAP) made by Ballast, or any MCAP file with poses of bodies
    pub file: PathBuf,
    /// Case file (TOML) with the bodies (default: the case stored in the recording)
    #[arg(long, value_name = "CASE")]
    pub case: Option<PathBuf>,
    /// Topic that moves a body: TOPIC=BODY, or TOPIC:FRAME=BODY for transforms (default: the windows that
    /// Ballast recorded, or the topics /<body>/pose and transforms to the frame <body>)
    #[arg(long, value_name = "MAP")]
    pub map: Vec<ballast_mcap::motion::TopicMap>,
    /// Time of a message that counts (default: stamp)
    #[arg(long)]
    pub time: Option<TimeName>,
    /// Start each motion at its recorded pose instead of the pose in the case
    #[arg(long)]
    pub allow_jump: bool,
    /// Folder of the replay's files (default: runs/<name of the case>-replay)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Replace a run, an interrupted replay or the replay of another case in the folder
    #[arg(long)]
    pub force: bool,
    /// Record the replay in this MCAP file, which is replaced
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    #[command(flatten)]
    pub beds: BedCacheArgs,
    #[command(flatten)]
    pub overrides: OverrideArgs,
    #[command(flatten)]
    pub stop: StopAt,
}

#[derive(Debug, Args)]
pub struct VerifyArgs {
    /// Recording (MCAP) made by Ballast
    pub file: PathBuf,
    /// Case file (TOML) to compute with (default: the case stored in the recording)
    #[arg(long, value_name = "CASE")]
    pub case: Option<PathBuf>,
    #[command(flatten)]
    pub beds: BedCacheArgs,
}

/// Times of a message, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TimeName {
    /// Stamp in the message: time of the measurement
    Stamp,
    /// Time at which the message was recorded
    Log,
}

/// End of a run, and the state expected there.
#[derive(Debug, Args)]
pub struct StopAt {
    /// Stop after this many steps of the run; `ballast resume` continues it, except for a replay
    #[arg(long, value_name = "N")]
    pub steps: Option<u64>,
    /// Hash that the final state must have; exit code 5 if it differs
    #[arg(long, value_name = "HASH", value_parser = hash)]
    pub expect_hash: Option<u128>,
}

#[derive(Debug, Args)]
pub struct PrepareArgs {
    /// Case file (TOML)
    pub case: PathBuf,
    #[command(flatten)]
    pub beds: BedCacheArgs,
    /// Seed of the bed, instead of the seed in the case
    #[arg(long)]
    pub seed: Option<u64>,
    /// Prepare the bed again even if the cache contains it
    #[arg(long)]
    pub force: bool,
}

#[derive(Debug, Args)]
pub struct ResumeArgs {
    /// Checkpoint file beside the other files of the run, or the folder of the run
    pub checkpoint: PathBuf,
    #[command(flatten)]
    pub stop: StopAt,
    #[command(flatten)]
    pub written: CheckpointArgs,
}

#[derive(Debug, Args)]
pub struct SweepArgs {
    /// Plan of the sweep (TOML): a case and the values to vary
    pub plan: PathBuf,
    /// Folder of the sweep (default: runs/<name of the plan>)
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Number of runs at a time
    #[arg(long, value_name = "N", default_value = "1", value_parser = thread_count())]
    pub jobs: usize,
    /// Number of worker threads of each run
    #[arg(long, value_name = "N", default_value = "1", value_parser = thread_count())]
    pub threads_per_run: usize,
    /// Run only the point with this index, for array jobs of a scheduler
    #[arg(long, value_name = "INDEX")]
    pub point: Option<usize>,
    /// Print the points with their indices and run nothing
    #[arg(long)]
    pub list: bool,
    #[command(flatten)]
    pub beds: BedCacheArgs,
}

#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Case file (TOML)
    pub case: PathBuf,
}

#[derive(Debug, Args)]
pub struct ValidateArgs {
    /// Use small samples only
    #[arg(long)]
    pub quick: bool,
    /// Run only these checks, separated by commas
    #[arg(long, value_name = "CHECK", value_delimiter = ',')]
    #[arg(value_parser = PossibleValuesParser::new(ballast_validation::names()))]
    pub only: Vec<String>,
    /// Folder of validation.html and validation.json
    #[arg(long, value_name = "DIR", default_value = "runs/validation")]
    pub out: PathBuf,
    /// Folder with samples settled by LMGC90 to compare with
    #[arg(long, value_name = "DIR")]
    pub samples: Option<PathBuf>,
    #[command(flatten)]
    pub beds: BedCacheArgs,
}

#[derive(Debug, Subcommand)]
pub enum ProbeCommand {
    /// Load a sleeper vertically and measure settlement and secant stiffness
    Stiffness(StiffnessArgs),
    /// Push a sleeper across the track and measure the force against it
    Push(PushArgs),
}

#[derive(Debug, Args)]
pub struct ProbeArgs {
    /// Checkpoint, folder of a run, or case file, whose prepared bed is probed
    pub from: PathBuf,
    /// Name of the sleeper (default: the first)
    #[arg(long, value_name = "NAME")]
    pub sleeper: Option<String>,
    /// CSV file to which the curve is written
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub beds: BedCacheArgs,
}

#[derive(Debug, Args)]
pub struct StiffnessArgs {
    #[command(flatten)]
    pub probe: ProbeArgs,
    /// Largest load without the sleeper's weight, N
    #[arg(long, value_name = "N", default_value_t = StiffnessProbe::default().max_load)]
    pub max_load: f64,
    /// Load to which the sleeper is unloaded, N
    #[arg(long, value_name = "N", default_value_t = StiffnessProbe::default().min_load)]
    pub min_load: f64,
    /// Number of load cycles
    #[arg(long, value_name = "N", default_value_t = StiffnessProbe::default().cycles)]
    pub cycles: u32,
    /// Duration of each ramp of the load, s
    #[arg(long, value_name = "S", default_value_t = StiffnessProbe::default().ramp)]
    pub ramp: f64,
}

#[derive(Debug, Args)]
pub struct PushArgs {
    #[command(flatten)]
    pub probe: ProbeArgs,
    /// Largest displacement, m
    #[arg(long, value_name = "M", default_value_t = PushProbe::default().displacement)]
    pub displacement: f64,
    /// Speed, m/s
    #[arg(long, value_name = "M_PER_S", default_value_t = PushProbe::default().speed)]
    pub speed: f64,
}

#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct ExportArgs {
    #[command(subcommand)]
    pub command: Option<ExportCommand>,
    #[command(flatten)]
    pub tables: Option<ExportTablesArgs>,
}

#[derive(Debug, Args)]
pub struct ExportTablesArgs {
    /// Results file, or the folder of a run
    pub results: PathBuf,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

#[derive(Debug, Subcommand)]
pub enum ExportCommand {
    /// Export a case as a co-simulation unit (FMU) for FMI 2.0 or 3.0, with its prepared bed or for a served component
    Fmu(ExportFmuArgs),
}

#[derive(Debug, Args)]
pub struct ExportFmuArgs {
    /// Case file (TOML)
    pub case: PathBuf,
    /// Unit to write (.fmu); for both versions, _fmi2 and _fmi3 are added to its name
    #[arg(short, long, value_name = "FILE")]
    pub out: PathBuf,
    /// Version of FMI
    #[arg(long, value_name = "VERSION", default_value = "2")]
    pub fmi: FmiName,
    /// Library of units (default: the one installed with the program)
    #[arg(long, value_name = "FILE")]
    pub library: Option<PathBuf>,
    #[cfg(feature = "zenoh")]
    #[command(flatten)]
    pub server: crate::coupling::args::UnitServerArgs,
    #[command(flatten)]
    pub beds: BedCacheArgs,
    #[command(flatten)]
    pub overrides: OverrideArgs,
}

/// Versions of FMI, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum FmiName {
    /// FMI 2.0: scalars
    #[value(name = "2")]
    Two,
    /// FMI 3.0: arrays, the same as scalars, terminals
    #[value(name = "3")]
    Three,
    /// A unit for each version
    Both,
}

#[derive(Debug, Args)]
pub struct SolveArgs {
    /// Problem (.hdf5), or a folder of problems
    pub file: PathBuf,
    /// Error ‖F‖/‖q‖ to reach (default: 1e-6; for folders 1e-4, 1e-6 and 1e-8)
    #[arg(long, value_name = "T")]
    pub tolerance: Option<f64>,
    /// Maximum number of sweeps over all contacts
    #[arg(long, value_name = "N", default_value_t = 200_000)]
    pub max_sweeps: u64,
    /// Methods to compare, separated by commas
    #[arg(long, value_name = "METHOD", value_delimiter = ',', default_value = "auto")]
    pub method: Vec<MethodName>,
    /// Write a copy of the problem that contains the solution
    #[arg(long, value_name = "OUT")]
    pub write_solution: Option<PathBuf>,
    /// Write the table as CSV
    #[arg(long, value_name = "OUT", value_parser = ballast_session::files::table)]
    pub csv: Option<PathBuf>,
    /// Write the performance profile of the methods as curves (.html) or CSV: fraction of the problems that a
    /// method solves within a factor of the shortest time
    #[arg(long, value_name = "OUT", value_parser = ballast_session::files::table_or_page)]
    pub profile: Option<PathBuf>,
}

/// Methods of `ballast solve`, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MethodName {
    /// Sweeps; after stagnation accelerated sweeps and Newton's method alternate
    Auto,
    /// Nonlinear Gauss-Seidel
    Nlgs,
    /// Nonlinear Gauss-Seidel with Anderson acceleration
    Anderson,
    /// Sweeps and Newton's method in alternation
    Newton,
}

impl MethodName {
    /// Returns the name on the command line.
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
    fn command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
