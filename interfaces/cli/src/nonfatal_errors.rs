//! What is done beside a run, and is not worth its end: recordings, problems that are kept, checkpoints of what is served.
//!
//! Contract: what cannot be written is told at once, the run goes on to its own end, and the program ends with the first
//! failure. Whether it is given up, as a recording, or tried again, as a checkpoint, is for who writes it.

use crate::console::Console;
use crate::exit::{Failure, Outcome};

/// What has gone wrong so far.
pub struct NonFatalErrors {
    console: Console,
    /// The first of it.
    first: Option<Failure>,
}

impl NonFatalErrors {
    pub fn new(console: Console) -> Self {
        Self { console, first: None }
    }

    /// Whether it went well; tells it if it did not.
    pub fn report(&mut self, what: &str, result: Outcome) -> bool {
        let Err(failure) = result else { return true };
        let more = "; the run goes on without it";
        self.console.warning(&format!("{what}: {failure}{more}"));
        self.first.get_or_insert_with(|| failure.with("; the run went on without it"));
        false
    }

    /// What the program ends with, if anything went wrong.
    pub fn first_error(&mut self) -> Option<Failure> {
        self.first.take()
    }
}
