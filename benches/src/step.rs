//! `ballast bench step SCENE`: each phase of a step on 1 to P threads.

use super::args::StepArgs;
use super::machine_info::MachineInfo;
use super::pools::pools;
use super::result_sheet::{ResultSheet, cells};
use super::scene::BenchScene;
use super::stop_rule::StopRule;
use super::variant::{Variant, alternate, mean, ratios};
use ballast::model::Schedule;
use ballast::step::Phase;
use ballast_session::statistics::Quartiles;
use ballast_session::table::on_threads;
use ballast_session::{Reporter, Result};

const COLUMNS: &[&str] = &[
    "phase",
    "threads",
    "wall_mean_ms",
    "wall_deviation_ms",
    "wall_median_ms",
    "share_percent",
    "cpu_mean_ms",
    "speedup",
    "speedup_low",
    "speedup_high",
    "efficiency_percent",
    "mvisits_per_s",
];

/// Measures each phase of a step.
///
/// # Errors
/// A file that cannot be read or written, or a step that fails.
pub fn step(args: &StepArgs, console: &dyn Reporter) -> Result {
    let machine = MachineInfo::observe();
    let scene = BenchScene::load(&args.scene, &args.start, console)?;
    let solver = StopRule::fixed(args.iterations, scene.model.solver);
    let mut variants: Vec<Variant> = pools(&args.threads)?
        .iter()
        .map(|pool| {
            let label = on_threads(pool.current_num_threads());
            Variant::new(label, &scene, solver, pool)
        })
        .collect();
    alternate(&scene, &mut variants, &args.range, console)?;
    let mut sheet = ResultSheet::new(COLUMNS);
    notes(&mut sheet, &scene, &variants, args);
    for variant in &variants {
        section(&mut sheet, variant, &variants[0]);
    }
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

fn notes(sheet: &mut ResultSheet, scene: &BenchScene, variants: &[Variant], args: &StepArgs) {
    let leader = &variants[0];
    let first = scene.state.step + u64::from(args.range.warm_up);
    let solver = leader.model.solver;
    sheet.note("scene", scene.describe());
    sheet.note(
        "steps measured",
        format!("{} to {}, alternating", first + 1, first + leader.samples.len() as u64),
    );
    sheet.note("schedule", solver.schedule.name());
    let stop = solver.tolerance.map_or("no tolerance".into(), |t| format!("until {t:e}"));
    sheet.note(
        "iterations",
        format!(
            "mean {:.1}, at most {}, {stop}",
            leader.mean(|r| r.iterations.into()),
            solver.max_iterations
        ),
    );
    sheet.note("contacts", format!("mean {:.0}", leader.mean(|r| r.contacts as f64)));
    sheet.note("subdomains", format!("{:.0}", leader.mean(|r| r.subdomains as f64)));
    sheet.note("visits of a step", format!("{:.0}", leader.mean(|r| r.visits as f64)));
    sheet.note("residual (QM/16)", format!("{:.2e}", leader.mean(|r| r.residuals.qm16())));
    let hashes: Vec<String> =
        variants.iter().map(|c| format!("{:032x} ({})", c.hash, c.label)).collect();
    sheet.note("state hash", hashes.join(", "));
    let same = if variants.iter().all(|c| c.same_bytes) { "yes" } else { "no" };
    sheet.note("same bytes for every number of threads", same);
    if solver.schedule == Schedule::Asynchronous {
        sheet.note("asynchronous", "the bytes may differ between numbers of threads");
    }
}

fn section(sheet: &mut ResultSheet, variant: &Variant, leader: &Variant) {
    sheet.section(variant.label.clone());
    let whole = mean(variant.walls(&Phase::ALL).into_iter());
    let parts = Phase::ALL.iter().map(|phase| (phase.name(), std::slice::from_ref(phase)));
    for (name, phases) in parts.chain([("whole step", &Phase::ALL[..])]) {
        let walls = variant.walls(phases);
        let wall = mean(walls.iter().copied());
        // A phase that the case does not use.
        if wall == 0.0 {
            continue;
        }
        let deviation = mean(walls.iter().map(|w| (w - wall).powi(2))).sqrt();
        let cpu = mean(variant.samples.iter().map(|s| s.of(phases).cpu.as_secs_f64()));
        let speedup = ratios(&leader.walls(phases), &walls);
        let visits = phases.contains(&Phase::Solve).then(|| 1e-6 * variant.visits_per_second());
        sheet.row(cells![
            name,
            variant.threads(),
            1e3 * wall,
            1e3 * deviation,
            1e3 * Quartiles::of(&walls).median,
            100.0 * wall / whole,
            1e3 * cpu,
            speedup.median,
            speedup.low,
            speedup.high,
            100.0 * speedup.median / variant.threads() as f64,
            visits.filter(|_| phases.len() == 1),
        ]);
    }
}
