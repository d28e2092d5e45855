//! `ballast top SITE/ID`: live table of a component with state, owner, progress and forces.

use super::args::TopArgs;
use crate::console::{Console, is_open};
use crate::interrupt;
use crate::lock::enter;
use ballast_protocol::from_cdr;
use ballast_protocol::lockstep::{StatusReport, WindowProgress};
use ballast_protocol::messages::{Message, SolverStats, WrenchImpulse};
use ballast_protocol::real_time::RealTimeStatus;
use ballast_session::{Failure, Reporter, Result};
use ballast_zenoh::{Connection, HEARTBEAT_INTERVAL, Timeouts};
use serde_json::json;
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Maximum number of bodies in the table.
const MAX_BODIES: usize = 24;

/// Last published results of a window.
#[derive(Default)]
struct LatestResults {
    bodies: BTreeMap<String, WrenchImpulse>,
    solver: Option<SolverStats>,
}

impl LatestResults {
    fn update(&mut self, encoding: &str, bytes: &[u8]) {
        if encoding.contains(WrenchImpulse::NAME) {
            if let Ok(body) = from_cdr::<WrenchImpulse>(bytes)
                && (self.bodies.len() < MAX_BODIES || self.bodies.contains_key(&body.body))
            {
                self.bodies.insert(body.body.clone(), body);
            }
        } else if encoding.contains(SolverStats::NAME) {
            self.solver = from_cdr(bytes).ok();
        }
    }
}

pub fn top(args: TopArgs, console: Console) -> Result {
    super::log::install();
    // No running step has to finish first.
    interrupt::install_with_message("stopping")?;
    let connection =
        Connection::open(&args.key, &args.endpoints.to_connect(), Timeouts::default())?;
    let results = Arc::new(Mutex::new(LatestResults::default()));
    let to = Arc::clone(&results);
    connection.subscribe(move |_, encoding, bytes| {
        enter(&to).update(encoding, bytes);
    })?;
    let mut earlier: Option<(Instant, u64)> = None;
    let mut pace = None;
    for k in 0.. {
        if interrupt::requested() || !is_open() || args.count.is_some_and(|n| k >= n.get()) {
            break;
        }
        if k > 0 {
            std::thread::sleep(HEARTBEAT_INTERVAL);
        }
        // Fails when the component is disconnected, so that the table never shows old values.
        let status = connection.status()?;
        if k == 0 {
            for (_, encoding, bytes) in connection.last_messages()? {
                enter(&results).update(&encoding, &bytes);
            }
        }
        let now = (Instant::now(), status.position.now_ns);
        if let Some((at, ns)) = earlier
            && now.1 > ns
        {
            pace = Some((now.0 - at).as_secs_f64() / ((now.1 - ns) as f64 * 1e-9));
        }
        earlier = Some(now);
        // The lock is not held while printing, which may block; the component would wait for this subscriber.
        let table = table(&args.key, &status, pace, &enter(&results));
        console.event("status", json!({ "status": status, "wall_per_simulated": pace }));
        let clear = if std::io::stdout().is_terminal() { "\x1b[H\x1b[J" } else { "" };
        console.result(&format!("{clear}{table}\n"));
    }
    if interrupt::requested() && args.count.is_some() {
        return Err(Failure::Interrupted("stopped".into()));
    }
    Ok(())
}

fn table(key: &str, status: &StatusReport, pace: Option<f64>, results: &LatestResults) -> String {
    let mut lines = run_lines(key, status);
    lines.extend(progress_lines(status, pace));
    if let Some(solver) = &results.solver {
        lines.push((
            "solver",
            format!(
                "{} of {} contacts, residual {:.1e}, penetration {:.1e} m",
                solver.active_contacts,
                solver.contacts,
                solver.residual_qm16,
                solver.max_penetration
            ),
        ));
    }
    let mut text: Vec<_> = lines.iter().map(|(label, v)| format!("{label:<12}{v}")).collect();
    text.extend(force_lines(&results.bodies));
    text.join("\n")
}

fn seconds(ms: Option<u64>) -> String {
    format!("{:.1} s", ms.unwrap_or(0) as f64 * 1e-3)
}

/// Returns the lines on run, owner and awaited event.
fn run_lines(key: &str, status: &StatusReport) -> Vec<(&'static str, String)> {
    let position = &status.position;
    let mut lines = vec![
        ("component", format!("{key}, up for {}", seconds(Some(status.uptime_ms)))),
        ("state", status.state.to_string()),
        (
            "run",
            format!(
                "{}, window {}, checkpoint up to {}",
                position.run_id, position.seq, status.durable_seq
            ),
        ),
        ("time", format!("{:.6} s", position.now_ns as f64 * 1e-9)),
        ("hash", position.hash.clone()),
    ];
    if let Some(owner) = &status.owner {
        lines.push(("owner", format!("{owner}, for {}", seconds(status.owner_since_ms))));
    }
    if let Some(what) = &status.waiting_for {
        lines.push(("waiting for", format!("{what}, for {}", seconds(status.waiting_since_ms))));
    }
    lines
}

/// Returns the lines on progress and computing time.
fn progress_lines(status: &StatusReport, pace: Option<f64>) -> Vec<(&'static str, String)> {
    let mut lines = Vec::new();
    if let Some(p) = &status.progress {
        lines.push((
            "computing",
            format!("window {}, step {} of {}, {}", p.seq, p.step, p.steps, step_progress(p)),
        ));
    }
    if let Some(run) = &status.real_time {
        let behind = run.lag_ns as f64 * 1e-6;
        let RealTimeStatus { real_time_factor, dropped_samples, overruns, .. } = run;
        lines.push((
            "real time",
            format!(
                "real-time factor {real_time_factor}, {behind:.1} ms behind, {dropped_samples} samples dropped, \
                 {overruns} overruns"
            ),
        ));
    }
    if let Some(error) = &status.error {
        lines.push(("error", error.clone()));
    }
    if let Some(timing) = &status.last_window {
        let mut phases: Vec<_> = timing.phases_ms.iter().collect();
        phases.sort_by(|a, b| b.1.total_cmp(a.1));
        let longest = phases.iter().take(3).map(|(name, ms)| format!("{name} {ms:.1}"));
        let (steps, longest) = (timing.steps, longest.collect::<Vec<_>>().join(", "));
        lines.push((
            "last window",
            format!("{:.1} ms for {steps} steps: {longest} ms", timing.wall_time_ms),
        ));
    }
    if let Some(pace) = pace {
        lines.push(("pace", format!("{pace:.0} s per simulated s")));
    }
    lines
}

/// Describes the last step of a window, or the running time of the first one.
fn step_progress(p: &WindowProgress) -> String {
    match (p.iterations, p.residual_qm16, p.remaining_ms) {
        (Some(iterations), Some(residual), left @ Some(_)) => {
            format!("{iterations} iterations, residual {residual:.1e}, {} remaining", seconds(left))
        }
        _ => format!("first step running for {}", seconds(Some(p.elapsed_ms))),
    }
}

/// Returns the table of the forces on the bodies.
fn force_lines(bodies: &BTreeMap<String, WrenchImpulse>) -> Vec<String> {
    let head =
        format!("{:<20}{:>12}{:>12}{:>12}{:>10}", "body", "Fx (N)", "Fy (N)", "Fz (N)", "contacts");
    let row = |(name, body): (&String, &WrenchImpulse)| {
        let f = body.moving_average.force;
        format!("{name:<20}{:>12.1}{:>12.1}{:>12.1}{:>10}", f.x, f.y, f.z, body.contacts)
    };
    let head = (!bodies.is_empty()).then_some(head);
    head.into_iter().chain(bodies.iter().map(row)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_a_step_appear_after_the_first_one() {
        let text = |progress| {
            let status = StatusReport { progress: Some(progress), ..StatusReport::default() };
            progress_lines(&status, None).remove(0).1
        };
        let begun =
            WindowProgress { seq: 5, steps: 1, elapsed_ms: 12_300, ..WindowProgress::default() };
        assert_eq!(text(begun), "window 5, step 0 of 1, first step running for 12.3 s");
        let (iterations, residual_qm16, remaining_ms) = (Some(40), Some(2e-3), Some(1500));
        let on =
            WindowProgress { step: 1, steps: 2, iterations, residual_qm16, remaining_ms, ..begun };
        let expected = "window 5, step 1 of 2, 40 iterations, residual 2.0e-3, 1.5 s remaining";
        assert_eq!(text(on), expected);
    }
}
