//! The command line of `ballast bench`.

pub use super::shared_args::*;
use ballast::model::Stepping;
use ballast_session::{Failure, Outcome};
use clap::{Args, Subcommand, ValueEnum, value_parser};
use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;

#[derive(Debug, Subcommand)]
pub enum Bench {
    /// Run a neutral sample (nscd-sample-1) and print one line of JSON with its timings
    Sample(BenchSample),
    /// Contact visits per second of the kernel, against what memory and arithmetic deliver at most
    Kernel(BenchKernel),
    /// Cost of detection per grain and step: from nothing, nearly still, in a run
    Detection(BenchDetection),
    /// Time of each phase of a step on 1 to P threads, in turn from the same states
    Step(BenchStep),
    /// The two tables of the study of domain decomposition for tamping (Hoang et al. 2012), with our figures
    Tables(BenchTables),
    /// Cost of a simulated second and the penetration left, by length of the step and number of iterations
    Cost(BenchCost),
    /// Time, residual and interface against the number of subdomains and the schedule
    Subdomains(BenchSubdomains),
    /// Iterations and time to a residual: from nothing, from the last step, with momentum, with subdomains
    Iterations(BenchIterations),
}

#[derive(Debug, Args)]
pub struct BenchSample {
    /// Sample file (JSON)
    pub file: PathBuf,
    /// Steps to run; by default the sample's
    #[arg(long, value_name = "N")]
    pub steps: Option<u64>,
    /// Exactly this many iterations per step
    #[arg(long, value_name = "K", conflicts_with = "tolerance", value_parser = one_or_more::<NonZeroU32>)]
    pub iterations: Option<NonZeroU32>,
    /// Iterate until the sample's norm is below this
    #[arg(long, value_name = "T")]
    pub tolerance: Option<f64>,
    /// Order of the sweeps
    #[arg(long, default_value = "synchronous")]
    pub schedule: ScheduleName,
    /// Number of subdomains; by default subdomains of some thousand contacts
    #[arg(long, value_name = "N", value_parser = one_or_more::<NonZeroU32>)]
    pub subdomains: Option<NonZeroU32>,
    #[command(flatten)]
    pub alert: Alert,
    /// Write the final state as a sample
    #[arg(long, value_name = "FILE", value_parser = ballast_session::files::sample)]
    pub save: Option<PathBuf>,
    #[command(flatten)]
    pub csv: Csv,
}

/// How far contacts of a sample are looked for.
#[derive(Debug, Args)]
pub struct Alert {
    /// Look for contacts at least this far, m, instead of the sample's `alert`; further where a step can reach
    /// further. Cases that say nothing have 0.5 m/s times the step
    #[arg(long, value_name = "M")]
    pub alert_m: Option<f64>,
}

impl Alert {
    /// Puts the distance in the place of the sample's.
    pub fn choose(&self, stepping: &mut Stepping) -> Outcome {
        let Some(alert) = self.alert_m else { return Ok(()) };
        if !(alert > 0.0 && alert.is_finite()) {
            return Err(Failure::Usage(format!(
                "--alert-m {alert}: expected a distance above 0, m"
            )));
        }
        stepping.detection_distance = alert;
        Ok(())
    }
}

/// Where tables go besides stdout.
#[derive(Debug, Args)]
pub struct Csv {
    /// Write the table as CSV, with the machine in comment lines
    #[arg(long, value_name = "FILE", value_parser = ballast_session::files::table)]
    pub csv: Option<PathBuf>,
}

/// On how many threads.
#[derive(Debug, Args)]
pub struct Threads {
    /// Measure on 1, 2, 3, 4, 8, 16, ... up to P threads; by default as many as --threads says
    #[arg(long, value_name = "P", value_parser = threads)]
    pub threads_up_to: Option<NonZeroUsize>,
}

/// More than anybody waits for.
const MOST_STEPS: i64 = 1_000_000_000;

/// Which steps are measured.
#[derive(Debug, Args)]
pub struct Window {
    /// Steps to measure
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = value_parser!(u32).range(1..=MOST_STEPS))]
    pub steps: u32,
    /// Steps before that
    #[arg(long, value_name = "M", default_value_t = 5, value_parser = value_parser!(u32).range(..=MOST_STEPS))]
    pub warm_up: u32,
}

/// When steps are done: at fixed iterations, and at a common residual.
#[derive(Debug, Args)]
pub struct Ends {
    /// Iterations that are fixed, instead of the case's
    #[arg(long, value_name = "K", value_parser = one_or_more::<NonZeroU32>)]
    pub iterations: Option<NonZeroU32>,
    /// Residual (QM/16) of the common tolerance
    #[arg(long, value_name = "T", default_value_t = 1.666e-4)]
    pub tolerance: f64,
    /// Most iterations at the common tolerance; by default four times the fixed ones
    #[arg(long, value_name = "K", value_parser = one_or_more::<NonZeroU32>)]
    pub max_iterations: Option<NonZeroU32>,
}

/// What state a measurement begins with.
#[derive(Debug, Args)]
pub struct Start {
    #[command(flatten)]
    pub overrides: Overrides,
    #[command(flatten)]
    pub beds: Beds,
    /// Begin at the checkpoint of a run of the case, instead of at its start
    #[arg(long, value_name = "CHECKPOINT")]
    pub from: Option<PathBuf>,
}

#[derive(Debug, Args)]
pub struct BenchKernel {
    /// Grains along an edge of the largest lattice; 40 give 310 000 contacts
    #[arg(long, value_name = "N", default_value = "40", value_parser = one_or_more::<NonZeroUsize>)]
    pub edge: NonZeroUsize,
    /// Turns of the measurement
    #[arg(long, value_name = "N", default_value = "7", value_parser = one_or_more::<NonZeroU32>)]
    pub rounds: NonZeroU32,
    /// Time of each figure in each turn, s
    #[arg(long, value_name = "S", default_value_t = 0.05)]
    pub seconds: f64,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub csv: Csv,
}

#[derive(Debug, Args)]
pub struct BenchDetection {
    /// Case file (TOML) or sample (JSON)
    pub scene: PathBuf,
    #[command(flatten)]
    pub window: Window,
    /// Exactly this many iterations per step of the run; detection does not depend on it, the motion does
    #[arg(long, value_name = "K", value_parser = one_or_more::<NonZeroU32>)]
    pub iterations: Option<NonZeroU32>,
    #[command(flatten)]
    pub start: Start,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub csv: Csv,
}

#[derive(Debug, Args)]
pub struct BenchStep {
    /// Case file (TOML) or sample (JSON)
    pub scene: PathBuf,
    #[command(flatten)]
    pub window: Window,
    /// Exactly this many iterations per step, instead of what the case says
    #[arg(long, value_name = "K", value_parser = one_or_more::<NonZeroU32>)]
    pub iterations: Option<NonZeroU32>,
    #[command(flatten)]
    pub start: Start,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub csv: Csv,
}

#[derive(Debug, Args)]
pub struct BenchCost {
    /// Sample file (JSON)
    pub file: PathBuf,
    /// Lengths of the step, ms
    #[arg(long, value_name = "H,...", value_delimiter = ',', default_value = "1,2,5")]
    pub step_ms: Vec<f64>,
    /// Iterations per step
    #[arg(long, value_name = "K,...", value_delimiter = ',', default_value = "5,10,30,100")]
    pub iterations: Vec<NonZeroU32>,
    /// Shares of the penetration that a step takes back; 0: nothing
    #[arg(long, value_name = "S,...", value_delimiter = ',', default_value = "0,0.1")]
    pub recovery: Vec<f64>,
    /// Time to simulate with each of them, s
    #[arg(long, value_name = "S", default_value_t = 0.5)]
    pub time: f64,
    #[command(flatten)]
    pub alert: Alert,
    #[command(flatten)]
    pub csv: Csv,
}

/// A table of the study.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TableName {
    /// Its Table 1: by number of processors
    Processors,
    /// Its Table 2: by version, that is schedule
    Versions,
    /// Both
    Both,
}

#[derive(Debug, Args)]
pub struct BenchTables {
    /// Case files (TOML): seven_sleepers is the study's Table 1, one_sleeper its Table 2
    #[arg(required = true)]
    pub cases: Vec<PathBuf>,
    /// Which table; by default the one that the study has of the case, of others both
    #[arg(long)]
    pub table: Option<TableName>,
    #[command(flatten)]
    pub window: Window,
    #[command(flatten)]
    pub ends: Ends,
    /// Leave out the rows at equal residual
    #[arg(long)]
    pub fixed_only: bool,
    #[command(flatten)]
    pub start: Start,
    #[command(flatten)]
    pub threads: Threads,
    #[command(flatten)]
    pub csv: Csv,
}

#[derive(Debug, Args)]
pub struct BenchSubdomains {
    /// Case file (TOML) or sample (JSON)
    pub scene: PathBuf,
    /// Largest number of subdomains; the others are 2, 4, 8, ...
    #[arg(long, value_name = "N", default_value = "32", value_parser = one_or_more::<NonZeroU32>)]
    pub max: NonZeroU32,
    #[command(flatten)]
    pub window: Window,
    #[command(flatten)]
    pub ends: Ends,
    #[command(flatten)]
    pub start: Start,
    #[command(flatten)]
    pub csv: Csv,
}

#[derive(Debug, Args)]
pub struct BenchIterations {
    /// Case file (TOML) or sample (JSON)
    pub scene: PathBuf,
    #[command(flatten)]
    pub window: Window,
    /// Residual (QM/16) to be reached
    #[arg(long, value_name = "T", default_value_t = 1.666e-4)]
    pub tolerance: f64,
    /// Most iterations of a step
    #[arg(long, value_name = "K", default_value = "20000", value_parser = one_or_more::<NonZeroU32>)]
    pub max_iterations: NonZeroU32,
    #[command(flatten)]
    pub start: Start,
    #[command(flatten)]
    pub csv: Csv,
}
