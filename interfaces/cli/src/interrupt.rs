//! Signals that stop a command: a run ends its step and writes its checkpoint. A second demand aborts.

use crate::console::write_err;
use ballast_session::interrupt;
pub use ballast_session::interrupt::{flow, requested};
use ballast_session::{Failure, Result};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGUSR2, SIGXCPU};
use signal_hook::iterator::Signals;
use signal_hook::low_level::signal_name;
use std::time::{Duration, Instant};

/// Signals of a user, a supervisor or a closed terminal.
const DEMANDS: [i32; 3] = [SIGINT, SIGTERM, SIGHUP];

/// Signals by which a scheduler warns before it ends a job. Linux repeats SIGXCPU with every second of computing time.
const WARNINGS: [i32; 3] = [SIGUSR1, SIGUSR2, SIGXCPU];

/// Time within which further demands count as one: a group of processes is often signalled more than once.
const MIN_ABORT_DELAY: Duration = Duration::from_secs(1);

/// Exit code of a command that a second demand aborts.
const ABORTED: i32 = 1;

/// Installs the handler of [`DEMANDS`] and [`WARNINGS`].
///
/// # Errors
/// The operating system refuses it.
pub fn install() -> Result {
    install_with_message("stopping")
}

/// Installs the handler; `what` describes in its message what the command does when it is stopped.
///
/// # Errors
/// See [`install`].
pub fn install_with_message(what: &'static str) -> Result {
    let refused = |e: std::io::Error| Failure::Failed(format!("cannot handle signals: {e}"));
    let mut signals = Signals::new(DEMANDS.iter().chain(&WARNINGS)).map_err(refused)?;
    let listen = move || {
        let mut first_demand = None;
        for signal in signals.forever() {
            if interrupt::request() {
                write_err(&message(what, signal));
            }
            if aborts(signal, Instant::now(), &mut first_demand) {
                std::process::exit(ABORTED);
            }
        }
    };
    let thread = std::thread::Builder::new().name("signals".into());
    thread.spawn(listen).map(drop).map_err(refused)
}

fn message(what: &str, signal: i32) -> String {
    let aborts = "Ctrl-C again after a second aborts at once";
    match signal {
        SIGINT => format!("\n{what} ({aborts})"),
        _ => format!("\n{what} after {} ({aborts})", signal_name(signal).unwrap_or("a signal")),
    }
}

/// True if the command aborts: a demand follows the first one after a second. Warnings never abort.
fn aborts(signal: i32, now: Instant, first_demand: &mut Option<Instant>) -> bool {
    if !DEMANDS.contains(&signal) {
        return false;
    }
    let first = *first_demand.get_or_insert(now);
    now.duration_since(first) >= MIN_ABORT_DELAY
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_second_demand_aborts() {
        let start = Instant::now();
        let mut first = None;
        for (signal, ms, expected) in [
            (SIGUSR1, 0, false),
            (SIGXCPU, 2000, false),
            (SIGXCPU, 4000, false),
            // The scheduler's SIGTERM after its warning is a first demand.
            (SIGTERM, 5000, false),
            (SIGINT, 5500, false),
            (SIGUSR2, 7000, false),
            (SIGINT, 7000, true),
        ] {
            let now = start + Duration::from_millis(ms);
            assert_eq!(aborts(signal, now, &mut first), expected, "signal {signal} at {ms} ms");
        }
    }
}
