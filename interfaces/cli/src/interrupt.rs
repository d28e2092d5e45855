//! Ctrl-C: the first one asks the command to stop, a run after its step; the second one aborts.

use crate::console::write_err;
use crate::exit::{Failure, Outcome};
use std::sync::atomic::{AtomicU32, Ordering};

static REQUESTS: AtomicU32 = AtomicU32::new(0);

/// Takes over SIGINT, SIGTERM and SIGHUP, so that queues and closed terminals stop a run cleanly too.
pub fn install() -> Outcome {
    install_saying("stopping after this step")
}

/// The same, for a command that says what it does when it is asked to stop.
pub fn install_saying(what: &'static str) -> Outcome {
    ctrlc::set_handler(move || {
        if REQUESTS.fetch_add(1, Ordering::SeqCst) == 0 {
            write_err(&format!("\n{what} (Ctrl-C again aborts at once)"));
        } else {
            std::process::exit(130);
        }
    })
    .map_err(|e| Failure::Failed(format!("cannot listen to Ctrl-C: {e}")))
}

/// Whether the person asked to stop.
pub fn requested() -> bool {
    REQUESTS.load(Ordering::SeqCst) > 0
}
