//! `ballast check CASE`: what a case asks for, or everything that is wrong with it.

use crate::args::Check;
use crate::case::{self, Choices};
use crate::console::Console;
use crate::exit::Outcome;
use crate::table::figure;
use ballast::track::plan::Plan;
use serde_json::json;

pub fn check(args: Check, console: Console) -> Outcome {
    let case = case::load(&args.case, &Choices::default(), console)?;
    console.result(&text(&case.plan));
    let run = &case.plan.run;
    console.event(
        "case",
        json!({
            "name": case.plan.name, "steps": case.steps(), "step_ns": run.stepping.step_ns,
            "duration_ns": run.duration_ns, "sleepers": case.plan.sleepers.len(),
            "tines": case.plan.tines.len(), "bed_key": case.bed_key(),
        }),
    );
    Ok(())
}

fn text(plan: &Plan) -> String {
    let (size, run) = (&plan.bed.size, &plan.run);
    let step_ms = run.stepping.step_ns as f64 * 1e-6;
    let steps = run.duration_ns / run.stepping.step_ns.max(1);
    let tolerance = run.solver.tolerance.map_or("none".into(), |t| format!("{t:e}"));
    let lines = [
        ("case", plan.name.clone()),
        ("box", format!("{} × {} × {} m", size.x, size.y, size.z)),
        ("grain sizes", sizes(plan)),
        ("sleepers", plan.sleepers.len().to_string()),
        ("tines", plan.tines.len().to_string()),
        ("simulated time", format!("{} s", figure(run.duration_ns as f64 * 1e-9, 6))),
        ("time step", format!("{} ms, {steps} steps", figure(step_ms, 3))),
        ("schedule", run.solver.schedule.name().into()),
        ("iterations", format!("at most {}, tolerance {tolerance}", run.solver.iterations)),
    ];
    let lines = lines.map(|(label, value)| format!("{label:<16}{value}"));
    lines.join("\n")
}

fn sizes(plan: &Plan) -> String {
    let classes = plan.bed.grains.classes.iter();
    let text =
        classes.map(|c| format!("{:.0} % of {} mm", 100.0 * c.share, figure(1e3 * c.size, 3)));
    text.collect::<Vec<_>>().join(", ")
}
