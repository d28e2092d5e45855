//! `ballast bench step SCENE`: each phase of a step on 1 to P threads.

use super::args::BenchStep;
use super::machine::Machine;
use super::pools::pools;
use super::rule::Rule;
use super::scene::Scene;
use super::sheet::{Sheet, cells};
use super::trial::{Contender, alternate, mean, ratios};
use ballast::model::Schedule;
use ballast::step::Phase;
use ballast_session::Outcome;
use ballast_session::Reporter;
use ballast_session::statistics::Quartiles;
use ballast_session::table::on_threads;

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

pub fn step(args: &BenchStep, console: &dyn Reporter) -> Outcome {
    let machine = Machine::watch();
    let scene = Scene::load(&args.scene, &args.start, console)?;
    let solver = Rule::fixed(args.iterations, scene.model.solver);
    let mut contenders: Vec<Contender> = pools(&args.threads)?
        .iter()
        .map(|pool| {
            let label = on_threads(pool.current_num_threads());
            Contender::new(label, &scene, solver, pool)
        })
        .collect();
    alternate(&scene, &mut contenders, &args.window, console)?;
    let mut sheet = Sheet::new(COLUMNS);
    notes(&mut sheet, &scene, &contenders, args);
    for contender in &contenders {
        section(&mut sheet, contender, &contenders[0]);
    }
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

fn notes(sheet: &mut Sheet, scene: &Scene, contenders: &[Contender], args: &BenchStep) {
    let leader = &contenders[0];
    let (first, solver) = (scene.state.step + u64::from(args.window.warm_up), leader.model.solver);
    sheet.note("scene", scene.describe());
    sheet.note(
        "steps measured",
        format!("{} to {}, in turn", first + 1, first + leader.samples.len() as u64),
    );
    sheet.note("schedule", solver.schedule.name());
    let asked = solver.tolerance.map_or("all of them".into(), |t| format!("until {t:e}"));
    sheet.note(
        "iterations",
        format!(
            "{:.1} in the mean of at most {}, {asked}",
            leader.mean(|r| r.iterations.into()),
            solver.max_iterations
        ),
    );
    sheet.note("contacts", format!("{:.0} in the mean", leader.mean(|r| r.contacts as f64)));
    sheet.note("subdomains", format!("{:.0}", leader.mean(|r| r.subdomains as f64)));
    sheet.note("visits of a step", format!("{:.0}", leader.mean(|r| r.visits as f64)));
    let hashes: Vec<String> =
        contenders.iter().map(|c| format!("{:032x} ({})", c.hash, c.label)).collect();
    sheet.note("state hash", hashes.join(", "));
    let same = if contenders.iter().all(|c| c.same_bytes) { "yes" } else { "no" };
    sheet.note("same bytes for every number of threads", same);
    if solver.schedule == Schedule::Asynchronous {
        sheet.note("asynchronous", "the bytes may differ between numbers of threads");
    }
}

fn section(sheet: &mut Sheet, contender: &Contender, leader: &Contender) {
    sheet.section(contender.label.clone());
    let whole = mean(contender.walls(&Phase::ALL).into_iter());
    let parts = Phase::ALL.iter().map(|phase| (phase.name(), std::slice::from_ref(phase)));
    for (name, phases) in parts.chain([("whole step", &Phase::ALL[..])]) {
        let walls = contender.walls(phases);
        let wall = mean(walls.iter().copied());
        // A phase that the case does not ask for.
        if wall == 0.0 {
            continue;
        }
        let deviation = mean(walls.iter().map(|w| (w - wall).powi(2))).sqrt();
        let cpu = mean(contender.samples.iter().map(|s| s.of(phases).cpu.as_secs_f64()));
        let speedup = ratios(&leader.walls(phases), &walls);
        let visits = phases.contains(&Phase::Solve).then(|| 1e-6 * contender.visits_per_second());
        sheet.row(cells![
            name,
            contender.threads(),
            1e3 * wall,
            1e3 * deviation,
            1e3 * Quartiles::of(&walls).median,
            100.0 * wall / whole,
            1e3 * cpu,
            speedup.median,
            speedup.low,
            speedup.high,
            100.0 * speedup.median / contender.threads() as f64,
            visits.filter(|_| phases.len() == 1),
        ]);
    }
}
