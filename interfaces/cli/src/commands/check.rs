//! `ballast check CASE`: what a case asks for, or everything that is wrong with it.

use crate::args::Check;
use crate::case::{self, Choices};
use crate::console::Console;
use crate::exit::Outcome;
use crate::table::{Table, figure};
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
    let mut table = Table::new("case", [plan.name.as_str()]);
    let mut row = |label: &str, value: String| table.row([label.to_string(), value]);
    row("box", format!("{} × {} × {} m", size.x, size.y, size.z));
    row("grain sizes", sizes(plan));
    row("sleepers, tines", format!("{}, {}", plan.sleepers.len(), plan.tines.len()));
    row("simulated time", format!("{} s", run.duration_ns as f64 * 1e-9));
    row(
        "time step",
        format!(
            "{} ms, {} steps",
            figure(run.stepping.step_ns as f64 * 1e-6, 3),
            run.duration_ns / run.stepping.step_ns.max(1)
        ),
    );
    row("schedule", format!("{:?}", run.solver.schedule).to_lowercase());
    let tolerance = run.solver.tolerance.map_or("none".into(), |t| format!("{t:e}"));
    row("iterations, tolerance", format!("at most {}, {tolerance}", run.solver.iterations));
    table.text().trim_end().to_string()
}

fn sizes(plan: &Plan) -> String {
    let classes = plan.bed.grains.classes.iter();
    let text =
        classes.map(|c| format!("{:.0} % of {} mm", 100.0 * c.share, figure(1e3 * c.size, 3)));
    text.collect::<Vec<_>>().join(", ")
}
