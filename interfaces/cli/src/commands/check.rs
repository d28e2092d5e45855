//! `ballast check CASE`: summary of a case, or everything that is wrong with it.

use crate::args::CheckArgs;
use crate::case::{self, CaseOverrides};
use crate::console::Console;
use crate::table::figure;
use ballast::track::TampingPhase;
use ballast::track::plan::{LoadCycles, Plan, SieveFraction, TampingPlan};
use ballast_session::{Reporter, Result};
use serde_json::json;

pub fn check(args: CheckArgs, console: Console) -> Result {
    let case = case::load(&args.case, &CaseOverrides::default(), &console)?;
    console.result(&text(&case.plan));
    let run = &case.plan.run;
    console.event(
        "case",
        json!({
            "name": case.plan.name, "steps": case.steps(), "step_ns": run.stepping.step_ns,
            "duration_ns": run.duration_ns, "sleepers": case.plan.sleepers.len(),
            "tines": case.plan.tines.len(), "plates": case.plan.plates.len(), "bed_key": case.bed_key(),
            "expected_grains": rounded(case.plan.bed.expected_grains()),
        }),
    );
    Ok(())
}

fn text(plan: &Plan) -> String {
    let (size, run) = (&plan.bed.size, &plan.run);
    let step_ms = run.stepping.step_ns as f64 * 1e-6;
    let steps = run.duration_ns / run.stepping.step_ns.max(1);
    let tolerance = run.solver.tolerance.map_or("none".into(), |t| format!("{t:e}"));
    let mut lines = vec![
        ("case", plan.name.clone()),
        ("box", format!("{} × {} × {} m", size.x, size.y, size.z)),
        ("grain sizes", sizes(plan)),
        ("grains", format!("about {}", rounded(plan.bed.expected_grains()))),
        ("sleepers", plan.sleepers.len().to_string()),
        ("tines", plan.tines.len().to_string()),
    ];
    if !plan.plates.is_empty() {
        lines.push(("plates", plan.plates.len().to_string()));
    }
    lines.extend(plan.bed.traffic.map(|traffic| ("bed traffic", loads(&traffic.load))));
    lines.extend(plan.tamping.iter().flat_map(cycle));
    lines.extend([
        ("simulated time", seconds(run.duration_ns)),
        ("time step", format!("{} ms, {steps} steps", figure(step_ms, 3))),
        ("results", every("a frame", run.output_ns, "none")),
        ("checkpoints", every("one", run.checkpoint_ns, "by wall time")),
        ("schedule", run.solver.schedule.name().into()),
        ("iterations", format!("at most {}, tolerance {tolerance}", run.solver.max_iterations)),
    ]);
    let lines = lines.into_iter().map(|(label, value)| format!("{label:<16}{value}"));
    lines.collect::<Vec<_>>().join("\n")
}

/// Returns number, range and frequency of load cycles.
fn loads(load: &LoadCycles) -> String {
    let [low, high] = [load.min_load, load.max_load].map(|n| plain(1e-3 * n));
    format!("{} cycles of {low} to {high} kN per sleeper at {} Hz", load.cycles, load.frequency)
}

fn mm(metres: f64) -> String {
    format!("{} mm", plain(1e3 * metres))
}

/// Returns the phases of the tamping cycle with their times.
fn cycle(plan: &TampingPlan) -> Vec<(&'static str, String)> {
    let limit = |force: f64| match force.is_finite() {
        true => format!(", halts above {} kN", plain(1e-3 * force)),
        false => String::new(),
    };
    let TampingPlan { lift, insertion, squeeze, vibration, release, traffic, .. } = plan;
    let details = [
        format!(", {}", mm(lift.height)),
        format!(", {} below the sleeper{}", mm(insertion.depth), limit(insertion.force_limit)),
        format!(", up to {} per side{}", mm(squeeze.stroke), limit(squeeze.force_limit)),
        String::new(),
        String::new(),
        release.map_or(String::new(), |r| format!(", down to {}", mm(r.height))),
        traffic.map_or(String::new(), |load| format!(", {}", loads(&load))),
    ];
    let ends = plan.ends();
    let starts = [plan.start].into_iter().chain(ends);
    // The first phase precedes the cycle.
    let phases = TampingPhase::ALL[1..].iter().map(|phase| phase.name());
    let mut lines: Vec<_> = (phases.zip(starts.zip(ends)).zip(details))
        .filter(|((_, (from, to)), _)| to > from)
        .map(|((name, (from, to)), detail)| {
            (name, format!("{} to {} s{detail}", plain(from), plain(to)))
        })
        .collect();
    let swing = format!("{} Hz, {}", vibration.frequency, mm(vibration.amplitude));
    lines.push(("vibration", vibration.period().map_or("none".into(), |_| swing)));
    lines
}

fn every(what: &str, ns: u64, never: &str) -> String {
    match ns {
        0 => never.into(),
        ns => format!("{what} every {}", seconds(ns)),
    }
}

fn seconds(ns: u64) -> String {
    format!("{} s", plain(ns as f64 * 1e-9))
}

/// Rounds to six decimals.
fn plain(value: f64) -> f64 {
    (1e6 * value).round() / 1e6
}

/// Rounds an estimate to two significant digits.
fn rounded(count: f64) -> u64 {
    let unit = 10f64.powf((count.log10() - 1.0).floor());
    ((count / unit).round() * unit) as u64
}

fn sizes(plan: &Plan) -> String {
    let classes = plan.bed.grains.classes.iter();
    let text = classes.map(|c| match c.fraction {
        Some(SieveFraction { sieves: [low, high], mass_share }) => format!(
            "{:.0} % by mass of {} to {} mm",
            100.0 * mass_share,
            figure(1e3 * low, 3),
            figure(1e3 * high, 3)
        ),
        None => format!("{:.0} % of {} mm", 100.0 * c.share, figure(1e3 * c.size, 3)),
    });
    text.collect::<Vec<_>>().join(", ")
}
