//! Request to stop, set by a signal handler and polled by long computations.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

static IS_REQUESTED: AtomicBool = AtomicBool::new(false);

/// Requests a stop; returns true if this is the first request.
pub fn request() -> bool {
    !IS_REQUESTED.swap(true, Ordering::Relaxed)
}

/// Returns true if a stop was requested.
pub fn requested() -> bool {
    IS_REQUESTED.load(Ordering::Relaxed)
}

/// Returns [`ControlFlow::Break`] if a stop was requested.
pub fn flow() -> ControlFlow<()> {
    if requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}
