//! `ballast bench subdomains SCENE`: time, residual and interface against number of subdomains and schedule, as
//! Figures 4 and 5 of Hoang et al. 2012.

use super::args::BenchSubdomains;
use super::machine::Machine;
use super::pools::pool;
use super::rule::Rule;
use super::scene::Scene;
use super::sheet::{Sheet, cells};
use super::trial::{Contender, alternate, ratios};
use ballast::model::{PartitionRule, Schedule, Solver};
use ballast::step::Phase;
use ballast_session::Reporter;
use ballast_session::statistics::Quartiles;
use ballast_session::{Failure, Outcome};

const COLUMNS: &[&str] = &[
    "schedule",
    "rule",
    "subdomains",
    "step_ms",
    "step_low_ms",
    "step_high_ms",
    "solve_ms",
    "cpu_ms",
    "over_sequential",
    "interface_percent",
    "iterations",
    "residual_qm16",
    "converged",
    "mvisits_per_s",
];

pub fn subdomains(args: &BenchSubdomains, console: &dyn Reporter) -> Outcome {
    args.ends.check()?;
    let machine = Machine::watch();
    let scene = Scene::load(&args.scene, &args.start, console)?;
    let (most, grains) = (args.max.get(), scene.model.grains.len());
    if most as usize > grains {
        let text = format!("--max {most}: expected at most one subdomain per grain, {grains}");
        return Err(Failure::Usage(text));
    }
    let pool = pool(rayon::current_num_threads())?;
    let mut contenders = Vec::new();
    for rule in args.ends.rules(&scene.model.solver) {
        for (schedule, n) in ways(most, args.start.overrides.schedule.map(Into::into)) {
            let partition = PartitionRule::Balanced(n);
            let solver = Solver { schedule, partition, ..rule.of(scene.model.solver) };
            let label = format!("{}, {n} subdomains, {}", schedule.name(), rule.name());
            contenders.push(Contender::new(label, &scene, solver, &pool));
        }
    }
    alternate(&scene, &mut contenders, &args.window, console)?;
    let mut sheet = Sheet::new(COLUMNS);
    sheet.note("scene", scene.describe());
    sheet.note("steps", format!("{} measured, in turn from the same states", args.window.steps));
    sheet.note("step_ms", "wall time: median, low and high quartile; cpu_ms: of all threads, mean");
    sheet.note("over_sequential", "time over that of one set without subdomains, step by step");
    sheet.note("interface_percent", "contacts of the interface, of all");
    let per_rule = contenders.len() / 2;
    for group in contenders.chunks(per_rule) {
        sheet.section(Rule::of_solver(&group[0].model.solver).name());
        group.iter().for_each(|contender| row(&mut sheet, contender, &group[0]));
    }
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

/// One set without subdomains, then each schedule with 2, 4, 8, ... and `most` subdomains.
fn ways(most: u32, only: Option<Schedule>) -> Vec<(Schedule, u32)> {
    let mut numbers: Vec<u32> = (1..32).map(|k| 1_u32 << k).take_while(|&n| n < most).collect();
    numbers.extend((most > 1).then_some(most));
    let mut all = vec![(Schedule::Sequential, 1)];
    for schedule in [Schedule::Synchronous, Schedule::Asynchronous] {
        if only.is_none_or(|only| only == schedule) {
            all.extend(numbers.iter().map(|&n| (schedule, n)));
        }
    }
    all
}

fn row(sheet: &mut Sheet, contender: &Contender, sequential: &Contender) {
    let walls = contender.walls(&Phase::ALL);
    let step = Quartiles::of(&walls);
    let solve = Quartiles::of(&contender.walls(&[Phase::Solve]));
    let interface = contender.mean(|r| r.interface_contacts as f64);
    let contacts = contender.mean(|r| r.contacts as f64).max(1.0);
    sheet.row(cells![
        contender.model.solver.schedule.name(),
        if contender.model.solver.tolerance.is_some() { "tolerance" } else { "fixed" },
        contender.mean(|r| r.subdomains as f64),
        1e3 * step.median,
        1e3 * step.low,
        1e3 * step.high,
        1e3 * solve.median,
        1e3 * contender.cpu(),
        ratios(&walls, &sequential.walls(&Phase::ALL)).median,
        100.0 * interface / contacts,
        contender.mean(|r| r.iterations.into()),
        contender.mean(|r| r.residuals.qm16()),
        contender.converged(),
        1e-6 * contender.visits_per_second(),
    ]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_subdomains_double_up_to_the_largest() {
        let numbers: Vec<u32> = ways(12, Some(Schedule::Synchronous)).iter().map(|w| w.1).collect();
        assert_eq!(numbers, [1, 2, 4, 8, 12]);
        assert_eq!(ways(1, None).len(), 1);
        assert_eq!(ways(8, None).len(), 7);
    }
}
