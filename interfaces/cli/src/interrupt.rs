//! Ctrl-C: the first signal requests a stop, also within a step; a later one aborts.

use crate::console::write_err;
use ballast_session::interrupt;
pub use ballast_session::interrupt::{flow, requested};
use ballast_session::{Failure, Result};
use std::time::Duration;

/// Time within which several signals count as one request, as those to a group of processes.
const SIGNAL_BURST: Duration = Duration::from_secs(1);

/// Exit code of an aborted command.
const ABORTED: i32 = 1;

/// Handles SIGINT, SIGTERM and SIGHUP, so that batch systems and closed terminals stop a run cleanly, too.
pub fn install() -> Result {
    install_with_message("stopping")
}

/// Handles the signals, with a message about what the command does on a request to stop.
pub fn install_with_message(message: &'static str) -> Result {
    ctrlc::set_handler(move || match interrupt::request() {
        None => write_err(&format!("\n{message} (Ctrl-C again after a second aborts at once)")),
        Some(since) if since >= SIGNAL_BURST => std::process::exit(ABORTED),
        Some(_) => {}
    })
    .map_err(|e| Failure::Failed(format!("cannot handle Ctrl-C: {e}")))
}
