//! Content of a sample, and the error of reading one.

use ballast::model::Model;
use ballast::state::State;
use serde_json::Value;

/// Content of a sample file.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Grains as given, fixed bodies as boundaries, one unpartitioned sweep per iteration.
    pub model: Model,
    /// Poses and velocities as given, without contact memory.
    pub state: State,
    /// Number of time steps to run.
    pub steps: u64,
    /// Notes of the sample's author, which [`write()`](super::write()) preserves.
    pub meta: Value,
}

/// Error in a sample file.
#[derive(Debug, Clone, PartialEq, thiserror::Error, serde::Serialize)]
#[error("{file}{}: {path}: expected {expected}, found {found}", position(*line, *column))]
pub struct SampleError {
    /// Name of the file as it was given to the reader.
    pub file: String,
    /// Line of a syntax error, from 1; 0 for a value that was read but is invalid.
    pub line: usize,
    /// Column of a syntax error in bytes, from 1; 0 like `line`.
    pub column: usize,
    /// Path of the value, for example `grains[3].vertices`.
    pub path: String,
    /// Description of the valid values.
    pub expected: String,
    /// Description of the invalid value.
    pub found: String,
}

fn position(line: usize, column: usize) -> String {
    if line == 0 { String::new() } else { format!(":{line}:{column}") }
}
