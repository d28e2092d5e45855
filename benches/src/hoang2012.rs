//! `ballast bench hoang2012 CASE...`: the two tables of Hoang et al. 2012 with figures measured here.

use super::args::{Hoang2012Args, PublishedTable};
use super::machine_info::MachineInfo;
use super::pools::pools;
use super::published::{self, PublishedRow};
use super::result_sheet::{ResultSheet, cells};
use super::scene::BenchScene;
use super::stop_rule::StopRule;
use super::variant::{DETECTION, Variant, alternate, mean, ratios};
use ballast::model::{Schedule, Solver};
use ballast::step::Phase;
use ballast_session::statistics::Quartiles;
use ballast_session::table::on_threads;
use ballast_session::{Failure, Reporter, Result};
use rayon::ThreadPool;
use std::path::Path;
use std::sync::Arc;

const COLUMNS: &[&str] = &[
    "case",
    "row",
    "rule",
    "threads",
    "subdomains",
    "contacts",
    "iterations",
    "residual_qm16",
    "converged",
    "step_s",
    "step_low_s",
    "step_high_s",
    "cpu_s",
    "run_min",
    "speedup",
    "solve_percent",
    "detection_percent",
    "rest_percent",
    "detection_s",
    "mvisits_per_s",
    "run_min_is",
    "source",
];

/// Reproduces the tables of Hoang et al. 2012.
///
/// # Errors
/// A file that cannot be read or written, or a step that fails.
pub fn hoang2012(args: &Hoang2012Args, console: &dyn Reporter) -> Result {
    args.stop.check()?;
    if args.start.from_checkpoint.is_some() && args.cases.len() > 1 {
        let text = format!("--from-checkpoint: expected one case, found {}", args.cases.len());
        return Err(Failure::Usage(text));
    }
    let machine = MachineInfo::observe();
    let pools = pools(&args.threads)?;
    let mut sheet = ResultSheet::new(COLUMNS);
    sheet.note("published rows", published::CITATION);
    sheet.note(
        "published times",
        "two machines of 2012: times are comparable neither between the tables nor with those measured here",
    );
    sheet.note(
        "step_s",
        "wall time of a step: median, low and high quartile; cpu_s: of all threads, mean",
    );
    sheet.note("shares", "solve; broad and narrow phase; all other phases of the step");
    for path in &args.cases {
        case(&mut sheet, path, &pools, args, console)?;
    }
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

fn case(
    sheet: &mut ResultSheet,
    path: &Path,
    pools: &[Arc<ThreadPool>],
    args: &Hoang2012Args,
    console: &dyn Reporter,
) -> Result {
    let mut scene = BenchScene::load(path, &args.start, console)?;
    let name = scene.name.clone();
    if name == "one_sleeper" {
        // The program of the study corrects no penetration (decision 013).
        scene.model.solver.penetration_correction = None;
    }
    let all = args.stop.rules(&scene.model.solver);
    let rules = if args.fixed_only { &all[..1] } else { &all[..] };
    let (first, steps) = (scene.state.step + u64::from(args.range.warm_up), args.range.steps);
    sheet.note(
        &name,
        format!(
            "{}; steps {} to {} measured, alternating; run_min extrapolates their mean to all {} steps",
            scene.describe(),
            first + 1,
            first + u64::from(steps),
            scene.steps
        ),
    );
    let table = args.table.unwrap_or(match name.as_str() {
        "seven_sleepers" => PublishedTable::Processors,
        "one_sleeper" => PublishedTable::Versions,
        _ => PublishedTable::Both,
    });
    if table != PublishedTable::Versions {
        let mut variants = by_processors(&scene, rules, pools);
        alternate(&scene, &mut variants, &args.range, console)?;
        sheet.section(format!("{name} by number of processors (Table 1 of the study)"));
        section(sheet, &scene, &variants, rules.len(), published::by_processors(&name));
    }
    if table != PublishedTable::Processors {
        let mut variants = by_version(&scene, rules, pools);
        alternate(&scene, &mut variants, &args.range, console)?;
        sheet.section(format!("{name} by version (Table 2 of the study)"));
        section(sheet, &scene, &variants, rules.len(), published::by_version(&name));
    }
    Ok(())
}

/// Variants with the schedule of the case on 1 to P threads.
fn by_processors(
    scene: &BenchScene,
    rules: &[StopRule],
    pools: &[Arc<ThreadPool>],
) -> Vec<Variant> {
    let variant = |rule: &StopRule, pool: &Arc<ThreadPool>| {
        let label = on_threads(pool.current_num_threads());
        Variant::new(label, scene, rule.apply(scene.model.solver), pool)
    };
    rules.iter().flat_map(|rule| pools.iter().map(move |pool| variant(rule, pool))).collect()
}

/// Variants with the three schedules: sequential on one thread, the others on P.
fn by_version(scene: &BenchScene, rules: &[StopRule], pools: &[Arc<ThreadPool>]) -> Vec<Variant> {
    let variant = |rule: &StopRule, schedule: Schedule| {
        let alone = schedule == Schedule::Sequential;
        let pool = if alone { &pools[0] } else { &pools[pools.len() - 1] };
        let label = format!("{}, {}", schedule.name(), on_threads(pool.current_num_threads()));
        let solver = Solver { schedule, ..rule.apply(scene.model.solver) };
        Variant::new(label, scene, solver, pool)
    };
    rules.iter().flat_map(|rule| Schedule::ALL.map(|schedule| variant(rule, schedule))).collect()
}

fn section(
    sheet: &mut ResultSheet,
    scene: &BenchScene,
    variants: &[Variant],
    rules: usize,
    published: &[PublishedRow],
) {
    for group in variants.chunks(variants.len() / rules) {
        group.iter().for_each(|variant| measured_row(sheet, scene, variant, &group[0]));
    }
    published.iter().for_each(|row| published_row(sheet, &scene.name, row));
}

fn measured_row(sheet: &mut ResultSheet, scene: &BenchScene, variant: &Variant, first: &Variant) {
    let walls = variant.walls(&Phase::ALL);
    let (step, whole) = (Quartiles::of(&walls), mean(walls.iter().copied()));
    let solve = mean(variant.walls(&[Phase::Solve]).into_iter());
    let detection = mean(variant.walls(&DETECTION).into_iter());
    let percent = |part: f64| if whole > 0.0 { 100.0 * part / whole } else { 0.0 };
    let solver = &variant.model.solver;
    sheet.row(cells![
        scene.name.clone(),
        variant.label.clone(),
        StopRule::of_solver(solver).name(),
        variant.threads(),
        variant.mean(|r| r.subdomains as f64),
        variant.mean(|r| r.contacts as f64),
        variant.mean(|r| r.iterations.into()),
        variant.mean(|r| r.residuals.qm16()),
        variant.converged(),
        step.median,
        step.low,
        step.high,
        variant.cpu(),
        whole * scene.steps as f64 / 60.0,
        ratios(&first.walls(&Phase::ALL), &walls).median,
        percent(solve),
        percent(detection),
        percent(whole - solve - detection),
        detection,
        1e-6 * variant.visits_per_second(),
        format!("extrapolated from {} steps", walls.len()),
        "measured here",
    ]);
}

fn published_row(sheet: &mut ResultSheet, case: &str, row: &PublishedRow) {
    let share = |i: usize| row.shares.map(|shares| shares[i]);
    sheet.row(cells![
        case,
        row.by,
        row.rule,
        row.threads,
        row.subdomains,
        row.contacts,
        None::<f64>,
        None::<f64>,
        None::<&str>,
        None::<f64>,
        None::<f64>,
        None::<f64>,
        None::<f64>,
        row.run_min,
        None::<f64>,
        share(0),
        share(1),
        share(2),
        row.detection,
        row.mvisits_per_s,
        row.run_min.map(|_| "published"),
        "Hoang et al. 2012",
    ]);
}
