//! `ballast top SITE/ID`: a live table of a component: state, who waits for whom, how far, forces.

use super::args::TopArgs;
use crate::console::{Console, is_open};
use crate::exit::{Failure, Outcome};
use crate::interrupt;
use crate::lock::enter;
use ballast_protocol::from_cdr;
use ballast_protocol::lockstep::{StatusReport, WindowProgress};
use ballast_protocol::messages::{Message, SolverStats, WrenchImpulse};
use ballast_protocol::real_time::RealTimeStatus;
use ballast_zenoh::{Connection, HEARTBEAT_INTERVAL, Timeouts};
use serde_json::json;
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Most bodies that are shown.
const MOST: usize = 24;

#[derive(Default)]
struct Told {
    bodies: BTreeMap<String, WrenchImpulse>,
    solver: Option<SolverStats>,
}

impl Told {
    fn take(&mut self, encoding: &str, bytes: &[u8]) {
        if encoding.contains(WrenchImpulse::NAME) {
            if let Ok(body) = from_cdr::<WrenchImpulse>(bytes)
                && (self.bodies.len() < MOST || self.bodies.contains_key(&body.body))
            {
                self.bodies.insert(body.body.clone(), body);
            }
        } else if encoding.contains(SolverStats::NAME) {
            self.solver = from_cdr(bytes).ok();
        }
    }
}

pub fn top(args: TopArgs, console: Console) -> Outcome {
    // It computes no step that would be waited for.
    interrupt::install_with_message("stopping")?;
    let line = Connection::open(&args.key, &args.endpoints.to_connect(), Timeouts::default())?;
    let told = Arc::new(Mutex::new(Told::default()));
    let to = Arc::clone(&told);
    line.listen(move |_, encoding, bytes| {
        enter(&to).take(encoding, bytes);
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
        // Fails when nobody is there, so that the table never shows what is long over.
        let status = line.status()?;
        if k == 0 {
            for (_, encoding, bytes) in line.last_messages()? {
                enter(&told).take(&encoding, &bytes);
            }
        }
        let now = (Instant::now(), status.position.now_ns);
        if let Some((at, ns)) = earlier
            && now.1 > ns
        {
            pace = Some((now.0 - at).as_secs_f64() / ((now.1 - ns) as f64 * 1e-9));
        }
        earlier = Some(now);
        // Not held while it is printed: whoever reads may take its time, and the component would wait for it.
        let table = table(&args.key, &status, pace, &enter(&told));
        console.event("status", json!({ "status": status, "wall_per_simulated": pace }));
        let clear = if std::io::stdout().is_terminal() { "\x1b[H\x1b[J" } else { "" };
        console.result(&format!("{clear}{table}\n"));
    }
    if interrupt::requested() && args.count.is_some() {
        return Err(Failure::Interrupted("stopped".into()));
    }
    Ok(())
}

fn table(key: &str, status: &StatusReport, pace: Option<f64>, told: &Told) -> String {
    let mut lines = whose(key, status);
    lines.extend(work(status, pace));
    if let Some(solver) = &told.solver {
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
    text.extend(forces(&told.bodies));
    text.join("\n")
}

fn seconds(ms: Option<u64>) -> String {
    format!("{:.1} s", ms.unwrap_or(0) as f64 * 1e-3)
}

/// Which run it is, who drives it, and what it waits for.
fn whose(key: &str, status: &StatusReport) -> Vec<(&'static str, String)> {
    let place = &status.position;
    let mut lines = vec![
        ("component", format!("{key}, up for {}", seconds(Some(status.uptime_ms)))),
        ("state", status.state.to_string()),
        (
            "run",
            format!("{}, window {}, kept up to {}", place.run_id, place.seq, status.durable_seq),
        ),
        ("time", format!("{:.6} s", place.now_ns as f64 * 1e-9)),
        ("hash", place.hash.clone()),
    ];
    if let Some(owner) = &status.owner {
        lines.push(("driven by", format!("{owner} for {}", seconds(status.owner_since_ms))));
    }
    if let Some(what) = &status.waiting_for {
        lines.push(("waits for", format!("{what}, for {}", seconds(status.waiting_since_ms))));
    }
    lines
}

/// How far it is, and what that takes.
fn work(status: &StatusReport, pace: Option<f64>) -> Vec<(&'static str, String)> {
    let mut lines = Vec::new();
    if let Some(p) = &status.progress {
        lines.push((
            "computes",
            format!("window {}, step {} of {}, {}", p.seq, p.step, p.steps, pace_of_steps(p)),
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
    if let Some(trouble) = &status.error {
        lines.push(("error", trouble.clone()));
    }
    if let Some(cost) = &status.last_window {
        let mut phases: Vec<_> = cost.phases_ms.iter().collect();
        phases.sort_by(|a, b| b.1.total_cmp(a.1));
        let most = phases.iter().take(3).map(|(name, ms)| format!("{name} {ms:.1}"));
        let (steps, most) = (cost.steps, most.collect::<Vec<_>>().join(", "));
        lines.push((
            "last window",
            format!("{:.1} ms for {steps} steps: {most} ms", cost.wall_time_ms),
        ));
    }
    if let Some(pace) = pace {
        lines.push(("pace", format!("{pace:.0} s per simulated s")));
    }
    lines
}

/// What the last step of a window has told; before there is one, for how long the first has been in work.
fn pace_of_steps(p: &WindowProgress) -> String {
    match (p.iterations, p.residual_qm16, p.remaining_ms) {
        (Some(iterations), Some(residual), left @ Some(_)) => {
            format!("{iterations} iterations, residual {residual:.1e}, {} left", seconds(left))
        }
        _ => format!("the first one for {}", seconds(Some(p.elapsed_ms))),
    }
}

/// What the ballast does to each body, under a line of headings.
fn forces(bodies: &BTreeMap<String, WrenchImpulse>) -> Vec<String> {
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
    fn what_no_step_has_told_yet_is_not_made_up() {
        let told = |progress| {
            let status = StatusReport { progress: Some(progress), ..StatusReport::default() };
            work(&status, None).remove(0).1
        };
        let begun =
            WindowProgress { seq: 5, steps: 1, elapsed_ms: 12_300, ..WindowProgress::default() };
        assert_eq!(told(begun), "window 5, step 0 of 1, the first one for 12.3 s");
        let (iterations, residual_qm16, remaining_ms) = (Some(40), Some(2e-3), Some(1500));
        let on =
            WindowProgress { step: 1, steps: 2, iterations, residual_qm16, remaining_ms, ..begun };
        let expected = "window 5, step 1 of 2, 40 iterations, residual 2.0e-3, 1.5 s left";
        assert_eq!(told(on), expected);
    }
}
