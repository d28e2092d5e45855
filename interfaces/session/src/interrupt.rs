//! Request to stop, set by a signal handler and polled by long computations.

use std::ops::ControlFlow;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

static REQUESTED: OnceLock<Instant> = OnceLock::new();

/// Requests a stop; returns the time since the first request, or `None` if this is the first.
pub fn request() -> Option<Duration> {
    let mut is_first = false;
    let first = REQUESTED.get_or_init(|| {
        is_first = true;
        Instant::now()
    });
    (!is_first).then(|| first.elapsed())
}

/// Returns true if a stop was requested.
pub fn requested() -> bool {
    REQUESTED.get().is_some()
}

/// Returns [`ControlFlow::Break`] if a stop was requested.
pub fn flow() -> ControlFlow<()> {
    if requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}
