//! `ballast bench iterations SCENE`: how many iterations a residual takes from nothing, from the last step's impulses,
//! with momentum, and with the case's subdomains.

use super::args::BenchIterations;
use super::machine::Machine;
use super::pools::pool;
use super::rule::{Rule, is_tolerance};
use super::scene::Scene;
use super::sheet::{Sheet, cells};
use super::trial::{Contender, alternate, ratios};
use ballast::model::{Acceleration, Schedule, Solver};
use ballast::step::Phase;
use ballast_session::Outcome;
use ballast_session::Reporter;
use ballast_session::statistics::Quartiles;

const COLUMNS: &[&str] = &[
    "way",
    "threads",
    "iterations",
    "residual_qm16",
    "converged",
    "solve_ms",
    "plain_over_solve",
    "plain_over_low",
    "plain_over_high",
    "step_ms",
    "mvisits",
];

pub fn iterations(args: &BenchIterations, console: &dyn Reporter) -> Outcome {
    is_tolerance(args.tolerance)?;
    let machine = Machine::watch();
    let scene = Scene::load(&args.scene, &args.start, console)?;
    let rule = Rule { iterations: args.max_iterations.get(), tolerance: Some(args.tolerance) };
    let case = rule.of(scene.model.solver);
    let alone = pool(1)?;
    let mut contenders: Vec<Contender> = sequential(case)
        .map(|(way, solver)| Contender::new(way.into(), &scene, solver, &alone))
        .into();
    if case.schedule != Schedule::Sequential {
        let mut threads = vec![1, rayon::current_num_threads()];
        threads.dedup();
        for threads in threads {
            let way = format!("{}, subdomains of the case", case.schedule.name());
            contenders.push(Contender::new(way, &scene, case, &pool(threads)?));
        }
    }
    alternate(&scene, &mut contenders, &args.window, console)?;
    let mut sheet = Sheet::new(COLUMNS);
    sheet.note("scene", scene.describe());
    sheet.note("steps", format!("{} measured, in turn from the same states", args.window.steps));
    sheet.note("ends", rule.name());
    sheet.note("impulses of the last step", format!("a share of {}", case.warm_start_factor));
    sheet.note("solve_ms, step_ms", "wall time, median; mvisits: millions of contact visits, mean");
    sheet.note(
        "plain_over_solve",
        "time of the first row's solve over this one's, step by step: median and quartiles",
    );
    let plain = contenders[0].walls(&[Phase::Solve]);
    contenders.iter().for_each(|contender| row(&mut sheet, contender, &plain));
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

/// Sweeps over all contacts in one set: as the first studies had them, and what has been added since.
fn sequential(case: Solver) -> [(&'static str, Solver); 4] {
    let case = Solver { schedule: Schedule::Sequential, acceleration: Acceleration::Nncg, ..case };
    let nothing = Solver { warm_start_factor: 0.0, ..case };
    [
        ("plain, from nothing", Solver { acceleration: Acceleration::None, ..nothing }),
        ("plain, from the last step", Solver { acceleration: Acceleration::None, ..case }),
        ("momentum, from nothing", nothing),
        ("momentum, from the last step", case),
    ]
}

fn row(sheet: &mut Sheet, contender: &Contender, plain: &[f64]) {
    let solves = contender.walls(&[Phase::Solve]);
    let faster = ratios(plain, &solves);
    sheet.row(cells![
        contender.label.clone(),
        contender.threads(),
        contender.mean(|r| r.iterations.into()),
        contender.mean(|r| r.residuals.qm16()),
        contender.converged(),
        1e3 * Quartiles::of(&solves).median,
        faster.median,
        faster.low,
        faster.high,
        1e3 * Quartiles::of(&contender.walls(&Phase::ALL)).median,
        1e-6 * contender.mean(|r| r.visits as f64),
    ]);
}
