//! `ballast bench convergence SCENE`: iterations to a residual from a cold and a warm start, with NNCG, and with the
//! subdomains of the case.

use super::args::ConvergenceArgs;
use super::machine_info::MachineInfo;
use super::pools::pool;
use super::result_sheet::{ResultSheet, cells};
use super::scene::BenchScene;
use super::stop_rule::{StopRule, check_tolerance};
use super::variant::{Variant, alternate, ratios};
use ballast::model::{Acceleration, Schedule, Solver};
use ballast::step::Phase;
use ballast_session::statistics::Quartiles;
use ballast_session::{Reporter, Result};

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

/// Measures iterations and time to a residual.
///
/// # Errors
/// A file that cannot be read or written, or a step that fails.
pub fn convergence(args: &ConvergenceArgs, console: &dyn Reporter) -> Result {
    check_tolerance(args.tolerance)?;
    let machine = MachineInfo::observe();
    let scene = BenchScene::load(&args.scene, &args.start, console)?;
    let rule = StopRule { iterations: args.max_iterations.get(), tolerance: Some(args.tolerance) };
    let case = rule.apply(scene.model.solver);
    let alone = pool(1)?;
    let mut variants: Vec<Variant> = sequential(case)
        .map(|(way, solver)| Variant::new(way.into(), &scene, solver, &alone))
        .into();
    if case.schedule != Schedule::Sequential {
        let mut threads = vec![1, rayon::current_num_threads()];
        threads.dedup();
        for threads in threads {
            let way = format!("{}, subdomains of the case", case.schedule.name());
            variants.push(Variant::new(way, &scene, case, &pool(threads)?));
        }
    }
    alternate(&scene, &mut variants, &args.range, console)?;
    let mut sheet = ResultSheet::new(COLUMNS);
    sheet.note("scene", scene.describe());
    sheet.note("steps", format!("{} measured, alternating from the same states", args.range.steps));
    sheet.note("ends", rule.name());
    sheet.note("impulses of the last step", format!("times {}", case.warm_start_factor));
    sheet.note("solve_ms, step_ms", "wall time, median; mvisits: millions of contact visits, mean");
    sheet.note(
        "plain_over_solve",
        "time of the first row's solve over this one's, step by step: median and quartiles",
    );
    let plain = variants[0].walls(&[Phase::Solve]);
    variants.iter().for_each(|variant| row(&mut sheet, variant, &plain));
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

/// Solvers with all contacts in one set: plain sweeps and NNCG, each from a cold and a warm start.
fn sequential(case: Solver) -> [(&'static str, Solver); 4] {
    let case = Solver { schedule: Schedule::Sequential, acceleration: Acceleration::Nncg, ..case };
    let cold = Solver { warm_start_factor: 0.0, ..case };
    [
        ("plain, from nothing", Solver { acceleration: Acceleration::None, ..cold }),
        ("plain, from the last step", Solver { acceleration: Acceleration::None, ..case }),
        ("NNCG, from nothing", cold),
        ("NNCG, from the last step", case),
    ]
}

fn row(sheet: &mut ResultSheet, variant: &Variant, plain: &[f64]) {
    let solves = variant.walls(&[Phase::Solve]);
    let faster = ratios(plain, &solves);
    sheet.row(cells![
        variant.label.clone(),
        variant.threads(),
        variant.mean(|r| r.iterations.into()),
        variant.mean(|r| r.residuals.qm16()),
        variant.converged(),
        1e3 * Quartiles::of(&solves).median,
        faster.median,
        faster.low,
        faster.high,
        1e3 * Quartiles::of(&variant.walls(&Phase::ALL)).median,
        1e-6 * variant.mean(|r| r.visits as f64),
    ]);
}
