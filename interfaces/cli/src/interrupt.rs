//! Ctrl-C: the first one asks the command to stop, a run within its step, once its bed is there; another one aborts.

use crate::console::write_err;
use crate::exit::{Failure, Outcome};
use std::ops::ControlFlow;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

static REQUESTED: OnceLock<Instant> = OnceLock::new();

/// Who stops a group of processes sends a signal more than once, within an instant: that is one request.
const ONE_REQUEST: Duration = Duration::from_secs(1);

/// Exit code of a command that was not left the time to stop.
const ABORTED: i32 = 1;

/// Takes over SIGINT, SIGTERM and SIGHUP, so that queues and closed terminals stop a run cleanly too.
pub fn install() -> Outcome {
    install_saying("stopping")
}

/// The same, for a command that says what it does when it is asked to stop.
pub fn install_saying(what: &'static str) -> Outcome {
    ctrlc::set_handler(move || match REQUESTED.get() {
        None => {
            let _ = REQUESTED.set(Instant::now());
            write_err(&format!("\n{what} (Ctrl-C again after a second aborts at once)"));
        }
        Some(first) if first.elapsed() >= ONE_REQUEST => std::process::exit(ABORTED),
        Some(_) => {}
    })
    .map_err(|e| Failure::Failed(format!("cannot listen to Ctrl-C: {e}")))
}

/// Whether the person asked to stop.
pub fn requested() -> bool {
    REQUESTED.get().is_some()
}

/// The same for what watches long work.
pub fn flow() -> ControlFlow<()> {
    if requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}
