//! Wall time between checkpoints of a run, which bounds the computing that a crash can cost.

use std::time::{Duration, Instant};

/// Timer that starts again with every checkpoint.
#[derive(Debug)]
pub struct CheckpointTimer {
    interval: Duration,
    written: Instant,
}

impl CheckpointTimer {
    /// Starts a timer.
    pub fn start(interval: Duration) -> Self {
        Self { interval, written: Instant::now() }
    }

    /// True if the last checkpoint is at least as old as the interval.
    pub fn is_due(&self) -> bool {
        self.written.elapsed() >= self.interval
    }

    /// Starts the time until the next checkpoint.
    pub fn restart(&mut self) {
        self.written = Instant::now();
    }
}
