//! Arguments that the commands of a run and those of a measurement share.

use ballast::model::Schedule;
use ballast_session::case::CaseOverrides;
use clap::{Args, ValueEnum};
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::str::FromStr;

/// A number of threads that can be started: thousands that wait for each other are as good as a hang.
pub fn threads(text: &str) -> Result<NonZeroUsize, String> {
    few(text, "threads")
}

/// A number of runs at a time, each of which a thread waits for.
pub fn jobs(text: &str) -> Result<NonZeroUsize, String> {
    few(text, "runs at a time")
}

fn few(text: &str, what: &str) -> Result<NonZeroUsize, String> {
    let most = ballast::step::MAX_THREADS;
    let found = text.parse().ok().filter(|n: &NonZeroUsize| n.get() <= most);
    found.ok_or_else(|| format!("expected 1 to {most} {what}"))
}

/// A number that nothing can be without.
pub fn one_or_more<N: FromStr>(text: &str) -> Result<N, String> {
    text.parse().map_err(|_| format!("expected a whole number, 1 to {}", u32::MAX))
}

/// What overrides the case file; runs that differ in these are different runs.
#[derive(Debug, Args)]
pub struct Overrides {
    /// Order of the sweeps, instead of the case's
    #[arg(long)]
    pub schedule: Option<ScheduleName>,
    /// Seed of the bed, instead of the case's: another bed of the same kind
    #[arg(long)]
    pub seed: Option<u64>,
}

/// Where prepared beds are kept.
#[derive(Debug, Args)]
pub struct Beds {
    /// Folder of prepared beds, one file per bed, found again by content
    #[arg(long, value_name = "DIR", default_value = "runs/beds")]
    pub beds: PathBuf,
}

impl From<&Overrides> for CaseOverrides {
    fn from(args: &Overrides) -> Self {
        Self { schedule: args.schedule.map(Into::into), seed: args.seed }
    }
}

/// The schedules by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum ScheduleName {
    /// One set of contacts, no decomposition
    Sequential,
    /// Subdomains in parallel, then the interface: same bytes for any number of threads
    Synchronous,
    /// Interface beside the subdomains, newest values, in no order: bytes may differ
    Asynchronous,
}

impl From<ScheduleName> for Schedule {
    fn from(name: ScheduleName) -> Self {
        match name {
            ScheduleName::Sequential => Schedule::Sequential,
            ScheduleName::Synchronous => Schedule::Synchronous,
            ScheduleName::Asynchronous => Schedule::Asynchronous,
        }
    }
}
