//! `ballast bench subdomains SCENE`: time, residual and interface against number of subdomains and schedule, as
//! Figures 4 and 5 of Hoang et al. 2012.

use super::args::SubdomainsArgs;
use super::machine_info::MachineInfo;
use super::pools::pool;
use super::result_sheet::{ResultSheet, cells};
use super::scene::BenchScene;
use super::stop_rule::StopRule;
use super::variant::{Variant, alternate, ratios};
use ballast::model::{PartitionRule, Schedule, Solver};
use ballast::step::Phase;
use ballast_session::statistics::Quartiles;
use ballast_session::{Failure, Reporter, Result};

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

/// Measures steps with different numbers of subdomains and schedules.
///
/// # Errors
/// A file that cannot be read or written, or a step that fails.
pub fn subdomains(args: &SubdomainsArgs, console: &dyn Reporter) -> Result {
    args.stop.check()?;
    let machine = MachineInfo::observe();
    let scene = BenchScene::load(&args.scene, &args.start, console)?;
    let max = args.max.get();
    let grains = scene.model.grains.len();
    if max as usize > grains {
        let text = format!("--max {max}: expected at most one subdomain per grain, {grains}");
        return Err(Failure::Usage(text));
    }
    let pool = pool(rayon::current_num_threads())?;
    let mut variants = Vec::new();
    for rule in args.stop.rules(&scene.model.solver) {
        for (schedule, n) in configurations(max, args.start.overrides.schedule.map(Into::into)) {
            let partition = PartitionRule::Balanced(n);
            let solver = Solver { schedule, partition, ..rule.apply(scene.model.solver) };
            let label = format!("{}, {n} subdomains, {}", schedule.name(), rule.name());
            variants.push(Variant::new(label, &scene, solver, &pool));
        }
    }
    alternate(&scene, &mut variants, &args.range, console)?;
    let mut sheet = ResultSheet::new(COLUMNS);
    sheet.note("scene", scene.describe());
    sheet.note("steps", format!("{} measured, alternating from the same states", args.range.steps));
    sheet.note("step_ms", "wall time: median, low and high quartile; cpu_ms: of all threads, mean");
    sheet.note("over_sequential", "time over that of one set without subdomains, step by step");
    sheet.note("interface_percent", "share of the contacts that lie in the interface");
    let per_rule = variants.len() / 2;
    for group in variants.chunks(per_rule) {
        sheet.section(StopRule::of_solver(&group[0].model.solver).name());
        group.iter().for_each(|variant| row(&mut sheet, variant, &group[0]));
    }
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

/// Returns one set without subdomains, then each schedule with 2, 4, 8, ... and `max` subdomains.
fn configurations(max: u32, only: Option<Schedule>) -> Vec<(Schedule, u32)> {
    let mut numbers: Vec<u32> = (1..32).map(|k| 1_u32 << k).take_while(|&n| n < max).collect();
    numbers.extend((max > 1).then_some(max));
    let mut all = vec![(Schedule::Sequential, 1)];
    for schedule in [Schedule::Synchronous, Schedule::Asynchronous] {
        if only.is_none_or(|only| only == schedule) {
            all.extend(numbers.iter().map(|&n| (schedule, n)));
        }
    }
    all
}

fn row(sheet: &mut ResultSheet, variant: &Variant, sequential: &Variant) {
    let walls = variant.walls(&Phase::ALL);
    let step = Quartiles::of(&walls);
    let solve = Quartiles::of(&variant.walls(&[Phase::Solve]));
    let interface = variant.mean(|r| r.interface_contacts as f64);
    let contacts = variant.mean(|r| r.contacts as f64).max(1.0);
    sheet.row(cells![
        variant.model.solver.schedule.name(),
        if variant.model.solver.tolerance.is_some() { "tolerance" } else { "fixed" },
        variant.mean(|r| r.subdomains as f64),
        1e3 * step.median,
        1e3 * step.low,
        1e3 * step.high,
        1e3 * solve.median,
        1e3 * variant.cpu(),
        ratios(&walls, &sequential.walls(&Phase::ALL)).median,
        100.0 * interface / contacts,
        variant.mean(|r| r.iterations.into()),
        variant.mean(|r| r.residuals.qm16()),
        variant.converged(),
        1e-6 * variant.visits_per_second(),
    ]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subdomain_counts_double_up_to_the_maximum() {
        let numbers: Vec<u32> =
            configurations(12, Some(Schedule::Synchronous)).iter().map(|w| w.1).collect();
        assert_eq!(numbers, [1, 2, 4, 8, 12]);
        assert_eq!(configurations(1, None).len(), 1);
        assert_eq!(configurations(8, None).len(), 7);
    }
}
