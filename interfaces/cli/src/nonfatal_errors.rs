//! Errors that do not end a run: those of recordings, problem dumps and checkpoints of served runs.
//!
//! Contract: an error is reported at once, the run continues, and the program ends with the first error. The caller
//! decides to give up, as for a recording, or to try again, as for a checkpoint.

use crate::console::Console;
use ballast_session::{Failure, Reporter, Result};

/// Errors of a run that have not ended it.
pub struct NonFatalErrors {
    console: Console,
    /// First error.
    first: Option<Failure>,
}

impl NonFatalErrors {
    pub fn new(console: Console) -> Self {
        Self { console, first: None }
    }

    /// Returns true if `result` is `Ok`; shows an error as a warning.
    pub fn report(&mut self, what: &str, result: Result) -> bool {
        let Err(failure) = result else { return true };
        let more = "; the run continues without it";
        self.console.warning(&format!("{what}: {failure}{more}"));
        self.first.get_or_insert_with(|| failure.with("; the run continued without it"));
        false
    }

    /// Takes the first error, with which the program ends.
    pub fn first_error(&mut self) -> Option<Failure> {
        self.first.take()
    }
}
