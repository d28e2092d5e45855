//! Tamping cycle: energy balance, and influence of the solver settings.

use super::case_run::run_case;
use super::check::{CheckFinding, ValidationCheck, mean_and_error};
use super::listed;
use super::samples_progress::map_parallel;
use super::suite_size::SuiteSize;
use ballast::model::Role;
use ballast_report::plot::{Chart, SeriesStyle};
use ballast_session::Reporter;
use ballast_session::beds;
use ballast_session::case::{self, Case, CaseOverrides};
use ballast_session::record::Column;
use ballast_session::{Failure, Result};
use std::path::Path;

const SMALL: &str = include_str!("cycle.toml");
const FIRST: &str = include_str!("../../examples/first.toml");

/// Number of standard errors that a significant difference exceeds (Student: 96 % of the means of five beds are within,
/// 98 % of eight).
const SIGNIFICANT_ERRORS: f64 = 3.0;

/// Reason why runs with twice the time step of a case may stop.
const COARSE_STEP: &str = "The case is not made for this step: a jammed tine that snaps free would move farther in one step \
                           than a step allows.";

/// Figures of one run of the cycle.
#[derive(Clone)]
struct CycleResult {
    /// Compactness under the tamped sleeper, before and after.
    compactness: [f64; 2],
    /// Mean over the tines of the mean force of single steps while squeezing, N.
    force: f64,
    work: f64,
    balance_error: f64,
    not_converged: f64,
    penetration: f64,
}

/// Settings that differ between runs.
#[derive(Clone, Copy)]
struct CycleSettings {
    seed: u64,
    step_ns: u64,
    iterations: u32,
}

/// Returns the case with another seed of the bed.
fn on_bed(case: &Case, seed: u64) -> Case {
    let mut case = case.clone();
    case.plan.bed.seed = seed;
    case
}

/// Runs `case` with other settings.
fn run(
    case: &Case,
    settings: CycleSettings,
    folder: &Path,
    console: &dyn Reporter,
) -> Result<CycleResult> {
    let mut case = on_bed(case, settings.seed);
    case.plan.run.stepping.step_ns = settings.step_ns;
    case.plan.run.solver.max_iterations = settings.iterations;
    let (setting, summary) = run_case(&case, folder, console)?;
    let tines: Vec<f64> = (setting.tracked.iter().zip(&summary.bodies))
        .filter(|(tracked, _)| tracked.role == Role::Tine)
        .map(|(_, body)| body.squeeze.single.mean())
        .collect();
    let last = |column| summary.last().map_or(f64::NAN, |row| row.get(column));
    Ok(CycleResult {
        compactness: summary.compactness.first().copied().unwrap_or([f64::NAN; 2]),
        force: tines.iter().sum::<f64>() / tines.len().max(1) as f64,
        work: last(Column::ExternalWork),
        balance_error: last(Column::BalanceError),
        not_converged: summary.not_converged as f64 / summary.steps.max(1) as f64,
        penetration: summary.mean_penetration.mean() / setting.grain_size,
    })
}

/// Runs that differ only in their beds.
struct RunGroup {
    /// Value of the setting that distinguishes the groups: time step in ms, or maximum number of iterations.
    value: f64,
    /// Results by bed; `None` for a failed run.
    runs: Vec<Option<CycleResult>>,
}

impl RunGroup {
    /// Returns the mean over the beds.
    fn mean(&self, of: impl Fn(&CycleResult) -> f64) -> f64 {
        mean_and_error(&self.runs.iter().flatten().map(of).collect::<Vec<_>>())[0]
    }

    /// Returns the largest value over the beds; NaN if none is finished or one is NaN.
    fn worst(&self, of: impl Fn(&CycleResult) -> f64) -> f64 {
        let values = self.runs.iter().flatten().map(&of);
        let larger = |worst: f64, x: f64| if x > worst || x.is_nan() { x } else { worst };
        values.reduce(larger).unwrap_or(f64::NAN)
    }
}

/// Checks the energy balance of a cycle, and its results for other time steps and numbers of iterations.
pub fn cycle(
    size: &SuiteSize,
    folder: &Path,
    console: &dyn Reporter,
) -> Result<[ValidationCheck; 2]> {
    let (text, name) = if size.quick { (SMALL, "small_cycle") } else { (FIRST, "first") };
    let case = case::parse(text.into(), name, &CaseOverrides::default(), console)?;
    let which = if size.quick {
        "A small tamping cycle (some 160 stones, one pair of tines)"
    } else {
        "The tamping cycle of examples/first.toml"
    };
    let (own_step, own_cap) = (case.plan.run.stepping.step_ns, case.plan.run.solver.max_iterations);
    // From coarse to fine. The finest ones take longest and are left out of the quick check.
    let mut steps = vec![2 * own_step, own_step, own_step / 2];
    let mut caps = vec![own_cap / 4, 4 * own_cap];
    if size.quick {
        steps.pop();
        caps.pop();
    }
    let mut energy = ValidationCheck::new(
        "energy over a tamping cycle",
        format!(
            "{which}, θ = 1/2: balance error of the ledger (T-14) over the external work; largest of {} beds.",
            size.beds()
        ),
        "The ledger closes for θ = 1/2 up to the gyroscopic term, which is of second order in h",
    );
    let mut study = ValidationCheck::new(
        "settings of a tamping cycle",
        format!(
            "The same cycle on {} beds: time steps of {} ms at {own_cap} iterations at most, and {} iterations instead at \
             {} ms. Ratios bed by bed, their mean and its standard error.",
            size.beds(),
            listed(&steps.iter().map(|ns| milliseconds(*ns)).collect::<Vec<_>>()),
            listed(&caps),
            milliseconds(own_step)
        ),
        "Hoang et al. 2012: results within 1.7 % count as equal; a difference exceeds that and three standard errors",
    );
    let seeds: Vec<u64> = (1..=size.beds()).collect();
    // Before the runs, since several of them use the same bed.
    map_parallel("beds", &seeds, console, |seed| {
        failure_as_text(
            beds::scene_without_progress(&on_bed(&case, *seed), folder, console).map(drop),
        )
    })?;
    let of_steps = steps.iter().map(|step_ns| (*step_ns, own_cap));
    let of_caps = caps.iter().map(|iterations| (own_step, *iterations));
    let settings = of_steps.chain(of_caps).flat_map(|(step_ns, iterations)| {
        seeds.iter().map(move |&seed| CycleSettings { seed, step_ns, iterations })
    });
    let runs = map_parallel("cycles", &settings.collect::<Vec<_>>(), console, |settings| {
        failure_as_text(run(&case, *settings, folder, console))
    })?;
    let mut runs = runs.chunks(seeds.len());
    let mut group = |value: f64, at: &str, known: Option<&str>| {
        let runs = runs.next().into_iter().flatten().zip(&seeds);
        let runs = runs.map(|(out, seed)| {
            result_or_finding(out, &format!("{at}, bed {seed}"), known, &mut study)
        });
        let group = RunGroup { value, runs: runs.collect() };
        add_means(&mut study, at, &group);
        group
    };
    let by_step = steps.iter().map(|&step_ns| {
        let known = (step_ns > own_step).then_some(COARSE_STEP);
        let ms = milliseconds(step_ns);
        group(ms, &format!("h = {ms} ms"), known)
    });
    let by_step: Vec<RunGroup> = by_step.collect();
    let by_cap = caps.iter().map(|cap| group(f64::from(*cap), &format!("{cap} iterations"), None));
    let mut by_cap: Vec<RunGroup> = by_cap.collect();
    by_cap.insert(1, RunGroup { value: f64::from(own_cap), runs: by_step[1].runs.clone() });
    for group in &by_step {
        let worst = group.worst(|out| (out.balance_error / out.work).abs());
        let name = format!("balance error over work, h = {} ms", group.value);
        energy.findings.push(CheckFinding::near(name, worst, 0.0, 1e-3));
    }
    if let [.., coarser, finest] = &by_step[..] {
        compare(&mut study, "half the time step", coarser, finest);
    }
    if let [.., fewer, most] = &by_cap[..] {
        let with = format!("{} iterations instead of {}", most.value, fewer.value);
        compare(&mut study, &with, fewer, most);
    }
    let title = "Compactness under the sleeper, by the";
    study.charts = vec![
        chart(&format!("{title} time step"), &by_step, |ms| format!("{ms} ms")),
        chart(&format!("{title} iterations at most"), &by_cap, |n| format!("{n} iterations")),
    ];
    study.remark = "Tamping of a small bed is chaotic: any change of a setting leads to another arrangement of the \
                    stones, as another bed does. Only a difference larger than the scatter over beds shows that a \
                    setting is not converged."
        .into();
    Ok([energy, study])
}

/// Converts nanoseconds to milliseconds, rounded to their resolution.
fn milliseconds(ns: u64) -> f64 {
    (ns as f64 / 1e3).round() / 1e3
}

/// Draws the beds of each group and their mean with its standard error.
fn chart(title: &str, groups: &[RunGroup], name: impl Fn(f64) -> String) -> String {
    let mut beds = vec![];
    let mut means = vec![];
    for (k, group) in groups.iter().enumerate() {
        let found: Vec<f64> = group.runs.iter().flatten().map(|out| out.compactness[1]).collect();
        let [mean, error] = mean_and_error(&found);
        // Offset, so that the marks do not overlap.
        beds.extend(found.iter().map(|phi| [k as f64 - 0.06, *phi]));
        means.push([k as f64 + 0.06, mean, error]);
    }
    let names = groups.iter().map(|group| name(group.value));
    let chart = Chart::with_names(title, "compactness, end", names);
    let chart = chart.with("one bed each", beds, SeriesStyle::Dots);
    chart.with_error_bars("mean over the beds, ± its standard error", &means).svg()
}

/// Returns the reason of a failed run as a text, which does not end the check.
fn failure_as_text<T>(run: Result<T>) -> Result<Result<T, String>> {
    match run {
        Ok(out) => Ok(Ok(out)),
        Err(Failure::Failed(why)) => Ok(Err(why)),
        Err(other) => Err(other),
    }
}

/// Returns the result of a run; a failed run adds a finding, a known deviation if there is a reason.
fn result_or_finding(
    found: &Result<CycleResult, String>,
    at: &str,
    known: Option<&str>,
    check: &mut ValidationCheck,
) -> Option<CycleResult> {
    let add_finding = |why: &String| {
        let texts = ["a whole cycle".into(), "none".into()];
        let quantity = format!("run with {at}: {why}");
        let found = CheckFinding::at_distance(quantity, f64::NAN, texts, f64::INFINITY);
        check.findings.push(match known {
            Some(reason) => found.with_known_deviation(f64::INFINITY, reason),
            None => found,
        });
    };
    found.as_ref().map_err(add_finding).ok().cloned()
}

/// Adds the means over the beds of a group.
fn add_means(check: &mut ValidationCheck, at: &str, group: &RunGroup) {
    let mut add = |what: &str, value: f64| {
        check.findings.push(CheckFinding::informational(format!("{what}, {at}"), value, ""));
    };
    add("compactness under the sleeper, end", group.mean(|out| out.compactness[1]));
    add("mean force on a tine while squeezing (N)", group.mean(|out| out.force));
    add("mean penetration over d", group.mean(|out| out.penetration));
    add("fraction of steps not converged", group.mean(|out| out.not_converged));
}

/// Adds the ratios of two groups, bed by bed.
fn compare(check: &mut ValidationCheck, with: &str, own: &RunGroup, other: &RunGroup) {
    let beds = own.runs.iter().zip(&other.runs);
    let pairs: Vec<_> = beds.filter_map(|(a, b)| a.as_ref().zip(b.as_ref())).collect();
    let ratio = |of: fn(&CycleResult) -> f64| {
        mean_and_error(&pairs.iter().map(|(a, b)| of(a) / of(b)).collect::<Vec<_>>())
    };
    let [compactness, error] = ratio(|out| out.compactness[1]);
    let [force, force_error] = ratio(|out| out.force);
    let excess = (compactness - 1.0).abs() - (0.017 + SIGNIFICANT_ERRORS * error);
    let distance = if pairs.len() == own.runs.len() { excess } else { f64::INFINITY };
    let texts = ["1".into(), format!("± 0.017 and {SIGNIFICANT_ERRORS} × {error:.3}")];
    let quantity = format!("compactness over that with {with}");
    check.findings.push(CheckFinding::at_distance(quantity, compactness, texts, distance));
    let name = format!("tine force over that with {with}");
    check.findings.push(CheckFinding::informational(
        name,
        force,
        format!("1 ± {SIGNIFICANT_ERRORS} × {force_error:.2}"),
    ));
}
