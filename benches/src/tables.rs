//! `ballast bench tables CASE...`: the two tables of Hoang et al. 2012, with our figures.

use super::args::{BenchTables, TableName};
use super::machine::Machine;
use super::pools::pools;
use super::published::{self, Row};
use super::rule::Rule;
use super::scene::Scene;
use super::sheet::{Sheet, cells};
use super::trial::{Contender, DETECTION, alternate, mean, ratios};
use ballast::model::{Schedule, Solver};
use ballast::step::Phase;
use ballast_session::Reporter;
use ballast_session::statistics::Quartiles;
use ballast_session::table::on_threads;
use ballast_session::{Failure, Outcome};
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

pub fn tables(args: &BenchTables, console: &dyn Reporter) -> Outcome {
    args.ends.check()?;
    if args.start.from.is_some() && args.cases.len() > 1 {
        let text = format!("--from belongs to one case, found {} cases", args.cases.len());
        return Err(Failure::Usage(text));
    }
    let machine = Machine::watch();
    let pools = pools(&args.threads)?;
    let mut sheet = Sheet::new(COLUMNS);
    sheet.note("published rows", published::SOURCE);
    sheet.note(
        "published times",
        "two machines of 2012: their tables are to be compared neither with each other nor in time with ours",
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
    sheet: &mut Sheet,
    path: &Path,
    pools: &[Arc<ThreadPool>],
    args: &BenchTables,
    console: &dyn Reporter,
) -> Outcome {
    let mut scene = Scene::load(path, &args.start, console)?;
    let name = scene.name.clone();
    if name == "one_sleeper" {
        // Compared with the study, whose program takes nothing back (decision 013).
        scene.model.solver.penetration_correction = None;
    }
    let all = args.ends.rules(&scene.model.solver);
    let rules = if args.fixed_only { &all[..1] } else { &all[..] };
    let (first, steps) = (scene.state.step + u64::from(args.window.warm_up), args.window.steps);
    sheet.note(
        &name,
        format!(
            "{}; steps {} to {} measured, in turn; run_min extrapolates their mean to all {} steps",
            scene.describe(),
            first + 1,
            first + u64::from(steps),
            scene.steps
        ),
    );
    let table = args.table.unwrap_or(match name.as_str() {
        "seven_sleepers" => TableName::Processors,
        "one_sleeper" => TableName::Versions,
        _ => TableName::Both,
    });
    if table != TableName::Versions {
        let mut contenders = by_processors(&scene, rules, pools);
        alternate(&scene, &mut contenders, &args.window, console)?;
        sheet.section(format!("{name} by number of processors (Table 1 of the study)"));
        section(sheet, &scene, &contenders, rules.len(), published::by_processors(&name));
    }
    if table != TableName::Processors {
        let mut contenders = by_version(&scene, rules, pools);
        alternate(&scene, &mut contenders, &args.window, console)?;
        sheet.section(format!("{name} by version (Table 2 of the study)"));
        section(sheet, &scene, &contenders, rules.len(), published::by_version(&name));
    }
    Ok(())
}

/// The case's schedule on 1 to P threads.
fn by_processors(scene: &Scene, rules: &[Rule], pools: &[Arc<ThreadPool>]) -> Vec<Contender> {
    let contender = |rule: &Rule, pool: &Arc<ThreadPool>| {
        let label = on_threads(pool.current_num_threads());
        Contender::new(label, scene, rule.of(scene.model.solver), pool)
    };
    rules.iter().flat_map(|rule| pools.iter().map(move |pool| contender(rule, pool))).collect()
}

/// The three schedules: one set on one thread, the others on P.
fn by_version(scene: &Scene, rules: &[Rule], pools: &[Arc<ThreadPool>]) -> Vec<Contender> {
    let contender = |rule: &Rule, schedule: Schedule| {
        let alone = schedule == Schedule::Sequential;
        let pool = if alone { &pools[0] } else { &pools[pools.len() - 1] };
        let label = format!("{}, {}", schedule.name(), on_threads(pool.current_num_threads()));
        let solver = Solver { schedule, ..rule.of(scene.model.solver) };
        Contender::new(label, scene, solver, pool)
    };
    rules.iter().flat_map(|rule| Schedule::ALL.map(|schedule| contender(rule, schedule))).collect()
}

fn section(
    sheet: &mut Sheet,
    scene: &Scene,
    contenders: &[Contender],
    rules: usize,
    published: &[Row],
) {
    for group in contenders.chunks(contenders.len() / rules) {
        group.iter().for_each(|contender| ours(sheet, scene, contender, &group[0]));
    }
    published.iter().for_each(|row| theirs(sheet, &scene.name, row));
}

fn ours(sheet: &mut Sheet, scene: &Scene, contender: &Contender, first: &Contender) {
    let walls = contender.walls(&Phase::ALL);
    let (step, whole) = (Quartiles::of(&walls), mean(walls.iter().copied()));
    let solve = mean(contender.walls(&[Phase::Solve]).into_iter());
    let detection = mean(contender.walls(&DETECTION).into_iter());
    let percent = |part: f64| if whole > 0.0 { 100.0 * part / whole } else { 0.0 };
    let solver = &contender.model.solver;
    sheet.row(cells![
        scene.name.clone(),
        contender.label.clone(),
        Rule::of_solver(solver).name(),
        contender.threads(),
        contender.mean(|r| r.subdomains as f64),
        contender.mean(|r| r.contacts as f64),
        contender.mean(|r| r.iterations.into()),
        contender.mean(|r| r.residuals.qm16()),
        contender.converged(),
        step.median,
        step.low,
        step.high,
        contender.cpu(),
        whole * scene.steps as f64 / 60.0,
        ratios(&first.walls(&Phase::ALL), &walls).median,
        percent(solve),
        percent(detection),
        percent(whole - solve - detection),
        detection,
        1e-6 * contender.visits_per_second(),
        format!("extrapolated from {} steps", walls.len()),
        "measured here",
    ]);
}

fn theirs(sheet: &mut Sheet, case: &str, row: &Row) {
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
