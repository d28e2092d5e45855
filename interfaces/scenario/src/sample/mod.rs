//! Neutral samples, `nscd-sample-1`: a JSON file that any program of non-smooth contact dynamics
//! can read or write. SI units, z up.
//!
//! One object: `format`, `gravity`, `dt`, `theta`, `steps`, `alert`, `friction`, `restitution`,
//! `solver`, `grains`, `fixed`, `meta`.

mod file;
mod read;
mod write;

pub use read::{LONGEST, read};
pub use write::write;

use ballast::model::Model;
use ballast::state::State;
use serde_json::Value;

/// A sample that was read.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Grains as given, fixed bodies as boundaries, one unpartitioned sweep per iteration.
    pub model: Model,
    /// Poses and velocities as given; no remembered contacts.
    pub state: State,
    /// Time steps to run.
    pub steps: u64,
    /// Whatever its maker noted, kept for [`write()`].
    pub meta: Value,
}

/// What is wrong with a sample.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[error("{file}{}: {path}: expected {expected}, found {found}", position(*line, *column))]
pub struct SampleError {
    /// Name of the file as it was given to the reader.
    pub file: String,
    /// Where the text could not be read, from 1; 0 where a value was read but is unusable.
    pub line: usize,
    /// Column in bytes, from 1; 0 like `line`.
    pub column: usize,
    /// Path of the value, for example `grains[3].vertices`.
    pub path: String,
    pub expected: String,
    pub found: String,
}

fn position(line: usize, column: usize) -> String {
    if line == 0 { String::new() } else { format!(":{line}:{column}") }
}
