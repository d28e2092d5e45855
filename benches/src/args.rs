//! The command line of `ballast bench`, and the arguments that other commands share with it.

// Flattened groups are documented at their types.
#![allow(missing_docs)]

use ballast::model::{Schedule, Stepping};
use ballast::step::MAX_THREADS;
use ballast_session::case::CaseOverrides;
use ballast_session::{Failure, Result};
use clap::builder::RangedU64ValueParser;
use clap::{Args, Subcommand, ValueEnum, value_parser};
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;

/// Returns a parser of a number of threads, or of runs at a time.
///
/// Thousands of threads that wait for each other are as good as a hang.
pub fn thread_count() -> RangedU64ValueParser<usize> {
    RangedU64ValueParser::new().range(1..=MAX_THREADS as u64)
}

/// Values that replace those of the case; runs with different ones are different runs.
#[derive(Debug, Args)]
pub struct OverrideArgs {
    /// Order of the sweeps, instead of the schedule in the case
    #[arg(long)]
    pub schedule: Option<ScheduleArg>,
    /// Seed of the bed, instead of the seed in the case
    #[arg(long)]
    pub seed: Option<u64>,
}

impl From<&OverrideArgs> for CaseOverrides {
    fn from(args: &OverrideArgs) -> Self {
        Self { schedule: args.schedule.map(Into::into), seed: args.seed }
    }
}

/// Cache of prepared beds.
#[derive(Debug, Args)]
pub struct BedCacheArgs {
    /// Folder of prepared beds, one file per bed, found by content
    #[arg(long, value_name = "DIR", default_value = "runs/beds")]
    pub bed_cache: PathBuf,
}

/// Schedules of the solver, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ScheduleArg {
    /// One set of contacts, no decomposition
    Sequential,
    /// Subdomains in parallel, then the interface: same bytes for any number of threads
    Synchronous,
    /// Interface concurrent with the subdomains, newest values, no fixed order: bytes may differ
    Asynchronous,
}

impl From<ScheduleArg> for Schedule {
    fn from(name: ScheduleArg) -> Self {
        match name {
            ScheduleArg::Sequential => Schedule::Sequential,
            ScheduleArg::Synchronous => Schedule::Synchronous,
            ScheduleArg::Asynchronous => Schedule::Asynchronous,
        }
    }
}

/// Commands of `ballast bench`.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Run a neutral sample (nscd-sample-1) and print its timings as one line of JSON
    Sample(SampleArgs),
    /// Measure contact visits per second of the kernel, with the roofline of memory and arithmetic
    Kernel(KernelArgs),
    /// Measure detection per grain and step: from scratch, nearly at rest, in a run
    Detection(DetectionArgs),
    /// Measure each phase of a step on 1 to P threads, alternating from the same states
    Step(StepArgs),
    /// Reproduce the two tables of the domain decomposition study of Hoang et al. 2012
    Hoang2012(Hoang2012Args),
    /// Measure cost per simulated second against residual penetration, by step length and iterations
    WorkPrecision(WorkPrecisionArgs),
    /// Measure time, residual and interface against the number of subdomains and the schedule
    Subdomains(SubdomainsArgs),
    /// Measure iterations and time to a residual: cold start, warm start, NNCG, subdomains
    Convergence(ConvergenceArgs),
}

/// Arguments of `ballast bench sample`.
#[derive(Debug, Args)]
pub struct SampleArgs {
    /// Sample file (JSON)
    pub file: PathBuf,
    /// Number of steps (default: the number in the sample)
    #[arg(long, value_name = "N")]
    pub steps: Option<u64>,
    /// Fixed number of iterations per step
    #[arg(long, value_name = "K", conflicts_with = "tolerance")]
    pub iterations: Option<NonZeroU32>,
    /// Residual to reach, in the norm of the sample
    #[arg(long, value_name = "T")]
    pub tolerance: Option<f64>,
    /// Order of the sweeps
    #[arg(long, default_value = "synchronous")]
    pub schedule: ScheduleArg,
    /// Number of subdomains (default: subdomains of a thousand contacts)
    #[arg(long, value_name = "N")]
    pub subdomains: Option<NonZeroU32>,
    #[command(flatten)]
    pub detection: DetectionDistanceArgs,
    /// Write the final state as a sample
    #[arg(long, value_name = "FILE", value_parser = ballast_session::files::sample)]
    pub save: Option<PathBuf>,
    #[command(flatten)]
    pub csv: CsvArgs,
}

/// Detection distance of a sample.
#[derive(Debug, Args)]
pub struct DetectionDistanceArgs {
    /// Minimum detection distance in m, instead of the distance in the sample
    #[arg(long, value_name = "M")]
    pub detection_distance_m: Option<f64>,
}

impl DetectionDistanceArgs {
    /// Replaces the detection distance of `stepping`.
    ///
    /// # Errors
    /// A distance that is not above 0.
    pub fn apply(&self, stepping: &mut Stepping) -> Result {
        let Some(distance) = self.detection_distance_m else { return Ok(()) };
        if !(distance > 0.0 && distance.is_finite()) {
            return Err(Failure::Usage(format!(
                "--detection-distance-m {distance}: expected a distance above 0, m"
            )));
        }
        stepping.detection_distance = distance;
        Ok(())
    }
}

/// File of a table.
#[derive(Debug, Args)]
pub struct CsvArgs {
    /// Write the table as CSV, with the machine in comment lines
    #[arg(long, value_name = "FILE", value_parser = ballast_session::files::table)]
    pub csv: Option<PathBuf>,
}

/// Numbers of threads to measure.
#[derive(Debug, Args)]
pub struct ThreadArgs {
    /// Measure on 1, 2, 3, 4, 8, 16, ... up to P threads (default: the value of --threads)
    #[arg(long, value_name = "P", value_parser = thread_count())]
    pub threads_up_to: Option<usize>,
}

const MAX_STEPS: i64 = 1_000_000_000;

/// Range of steps to measure.
#[derive(Debug, Args)]
pub struct StepRange {
    /// Number of steps to measure
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = value_parser!(u32).range(1..=MAX_STEPS))]
    pub steps: u32,
    /// Number of steps before them
    #[arg(long, value_name = "M", default_value_t = 5, value_parser = value_parser!(u32).range(..=MAX_STEPS))]
    pub warm_up: u32,
}

/// Stop criteria of a step: a fixed number of iterations, and a common residual.
#[derive(Debug, Args)]
pub struct StopCriteria {
    /// Fixed number of iterations, instead of the number in the case
    #[arg(long, value_name = "K")]
    pub iterations: Option<NonZeroU32>,
    /// Residual (QM/16) of the common tolerance
    #[arg(long, value_name = "T", default_value_t = 1.666e-4)]
    pub tolerance: f64,
    /// Maximum number of iterations at the common tolerance (default: four times the fixed number)
    #[arg(long, value_name = "K")]
    pub max_iterations: Option<NonZeroU32>,
}

/// Initial state of a measurement.
#[derive(Debug, Args)]
pub struct StartArgs {
    #[command(flatten)]
    pub overrides: OverrideArgs,
    #[command(flatten)]
    pub beds: BedCacheArgs,
    /// Start at this checkpoint of a run of the case, instead of at its beginning
    #[arg(long, value_name = "CHECKPOINT")]
    pub from_checkpoint: Option<PathBuf>,
}

/// Arguments of `ballast bench kernel`.
#[derive(Debug, Args)]
pub struct KernelArgs {
    /// Number of grains along an edge of the largest lattice; 40 give 310 000 contacts
    #[arg(long, value_name = "N", default_value = "40")]
    pub edge: NonZeroUsize,
    /// Number of rounds of the measurement
    #[arg(long, value_name = "N", default_value = "7")]
    pub rounds: NonZeroU32,
    /// Time of each figure in each round, s
    #[arg(long, value_name = "S", default_value_t = 0.05)]
    pub seconds: f64,
    #[command(flatten)]
    pub threads: ThreadArgs,
    #[command(flatten)]
    pub csv: CsvArgs,
}

/// Arguments of `ballast bench detection`.
#[derive(Debug, Args)]
pub struct DetectionArgs {
    /// Case file (TOML) or sample (JSON)
    pub scene: PathBuf,
    #[command(flatten)]
    pub range: StepRange,
    /// Fixed number of iterations per step of the run; affects the motion, not the cost of detection
    #[arg(long, value_name = "K")]
    pub iterations: Option<NonZeroU32>,
    #[command(flatten)]
    pub start: StartArgs,
    #[command(flatten)]
    pub threads: ThreadArgs,
    #[command(flatten)]
    pub csv: CsvArgs,
}

/// Arguments of `ballast bench step`.
#[derive(Debug, Args)]
pub struct StepArgs {
    /// Case file (TOML) or sample (JSON)
    pub scene: PathBuf,
    #[command(flatten)]
    pub range: StepRange,
    /// Fixed number of iterations per step, instead of the stop criterion in the case
    #[arg(long, value_name = "K")]
    pub iterations: Option<NonZeroU32>,
    #[command(flatten)]
    pub start: StartArgs,
    #[command(flatten)]
    pub threads: ThreadArgs,
    #[command(flatten)]
    pub csv: CsvArgs,
}

/// Arguments of `ballast bench work-precision`.
#[derive(Debug, Args)]
pub struct WorkPrecisionArgs {
    /// Sample file (JSON)
    pub file: PathBuf,
    /// Step lengths, ms
    #[arg(long, value_name = "H,...", value_delimiter = ',', default_value = "1,2,5")]
    pub step_ms: Vec<f64>,
    /// Numbers of iterations per step
    #[arg(long, value_name = "K,...", value_delimiter = ',', default_value = "5,10,30,100")]
    pub iterations: Vec<NonZeroU32>,
    /// Factors of the penetration correction; 0: no correction
    #[arg(long, value_name = "F,...", value_delimiter = ',', default_value = "0,0.1")]
    pub correction_factor: Vec<f64>,
    /// Time to simulate with each combination, s
    #[arg(long, value_name = "S", default_value_t = 0.5)]
    pub time: f64,
    #[command(flatten)]
    pub detection: DetectionDistanceArgs,
    #[command(flatten)]
    pub csv: CsvArgs,
}

/// Tables of the study of Hoang et al. 2012.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PublishedTable {
    /// Table 1: by number of processors
    Processors,
    /// Table 2: by version, that is schedule
    Versions,
    /// Both tables
    Both,
}

/// Arguments of `ballast bench hoang2012`.
#[derive(Debug, Args)]
pub struct Hoang2012Args {
    /// Case files (TOML): seven_sleepers for Table 1 of the study, one_sleeper for Table 2
    #[arg(required = true)]
    pub cases: Vec<PathBuf>,
    /// Table to reproduce (default: the table of the study with this case; both for other cases)
    #[arg(long)]
    pub table: Option<PublishedTable>,
    #[command(flatten)]
    pub range: StepRange,
    #[command(flatten)]
    pub stop: StopCriteria,
    /// Omit the rows at equal residual
    #[arg(long)]
    pub fixed_only: bool,
    #[command(flatten)]
    pub start: StartArgs,
    #[command(flatten)]
    pub threads: ThreadArgs,
    #[command(flatten)]
    pub csv: CsvArgs,
}

/// Arguments of `ballast bench subdomains`.
#[derive(Debug, Args)]
pub struct SubdomainsArgs {
    /// Case file (TOML) or sample (JSON)
    pub scene: PathBuf,
    /// Largest number of subdomains; the others are 2, 4, 8, ...
    #[arg(long, value_name = "N", default_value = "32")]
    pub max: NonZeroU32,
    #[command(flatten)]
    pub range: StepRange,
    #[command(flatten)]
    pub stop: StopCriteria,
    #[command(flatten)]
    pub start: StartArgs,
    #[command(flatten)]
    pub csv: CsvArgs,
}

/// Arguments of `ballast bench convergence`.
#[derive(Debug, Args)]
pub struct ConvergenceArgs {
    /// Case file (TOML) or sample (JSON)
    pub scene: PathBuf,
    #[command(flatten)]
    pub range: StepRange,
    /// Residual (QM/16) to reach
    #[arg(long, value_name = "T", default_value_t = 1.666e-4)]
    pub tolerance: f64,
    /// Maximum number of iterations of a step
    #[arg(long, value_name = "K", default_value = "20000")]
    pub max_iterations: NonZeroU32,
    #[command(flatten)]
    pub start: StartArgs,
    #[command(flatten)]
    pub csv: CsvArgs,
}
