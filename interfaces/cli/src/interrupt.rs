//! Ctrl-C: the first one asks the command to stop, a run within its step, once its bed is there; another one aborts.

use crate::console::write_err;
use ballast_session::interrupt;
pub use ballast_session::interrupt::{flow, requested};
use ballast_session::{Failure, Result};
use std::time::Duration;

/// Who stops a group of processes sends a signal more than once, within an instant: that is one request.
const ONE_REQUEST: Duration = Duration::from_secs(1);

/// Exit code of a command that was not left the time to stop.
const ABORTED: i32 = 1;

/// Takes over SIGINT, SIGTERM and SIGHUP, so that queues and closed terminals stop a run cleanly too.
pub fn install() -> Result {
    install_saying("stopping")
}

/// The same, for a command that says what it does when it is asked to stop.
pub fn install_saying(what: &'static str) -> Result {
    ctrlc::set_handler(move || match interrupt::request() {
        None => write_err(&format!("\n{what} (Ctrl-C again after a second aborts at once)")),
        Some(since) if since >= ONE_REQUEST => std::process::exit(ABORTED),
        Some(_) => {}
    })
    .map_err(|e| Failure::Failed(format!("cannot listen to Ctrl-C: {e}")))
}
