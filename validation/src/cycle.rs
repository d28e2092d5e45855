//! A whole tamping cycle: its energy balance, and what the settings of the solver change.

use super::check::{Check, DIGITS, Finding, Verdict, mean_and_error};
use super::several::side_by_side;
use super::size::Size;
use super::{heed_interrupts, listed};
use ballast::model::Role;
use ballast::observe::Coordination;
use ballast::track;
use ballast::workspace::Workspace;
use ballast_report::plot::{Chart, Mark};
use ballast_session::Reporter;
use ballast_session::beds;
use ballast_session::case::{self, Case, CaseOverrides};
use ballast_session::machine::{self, Machine};
use ballast_session::profile::Profile;
use ballast_session::record::{self, Column};
use ballast_session::recorder::compactness;
use ballast_session::summary::{Setting, Summary};
use ballast_session::{Failure, Outcome};
use std::path::Path;

const SMALL: &str = include_str!("cycle.toml");
const FIRST: &str = include_str!("../../examples/first.toml");

/// A difference larger than so many standard errors is one (Student: 96 % of the means of five beds are within, 98 % of
/// eight).
const ERRORS: f64 = 3.0;

/// What one run of the cycle gave.
#[derive(Clone)]
struct Outcomes {
    /// Under the tamped sleeper, before and after.
    compactness: [f64; 2],
    /// Mean over the tines of the mean force of single steps while squeezing, N.
    force: f64,
    work: f64,
    balance_error: f64,
    not_converged: f64,
    penetration: f64,
}

/// What is changed from run to run.
#[derive(Clone, Copy)]
struct Settings {
    seed: u64,
    step_ns: u64,
    iterations: u32,
}

/// The case on the bed of a seed.
fn on_bed(case: &Case, seed: u64) -> Case {
    let mut case = case.clone();
    case.plan.bed.seed = seed;
    case
}

/// A run of `case` with other settings.
fn run(
    case: &Case,
    settings: Settings,
    folder: &Path,
    console: &dyn Reporter,
) -> Outcome<Outcomes> {
    let mut case = on_bed(case, settings.seed);
    case.plan.run.stepping.step_ns = settings.step_ns;
    case.plan.run.solver.max_iterations = settings.iterations;
    let (model, mut state) = beds::one_of_many(&case, folder, console)?;
    let cycle = machine::cycle(&case, &model, &state)?;
    let setting = Setting::of(&case, &model);
    let mut summary = Summary::new(setting.clone());
    let machine = Machine::new(cycle, &model);
    let mut workspace = Workspace::default();
    let mut watch = Profile::start();
    let zones = track::zones(&case.plan);
    summary.take_zones(&compactness(&model, &state, &zones));
    for _ in 0..case.steps() {
        let stepped = machine.step(&model, &mut state, &mut workspace, &mut watch);
        // Also within the step.
        heed_interrupts()?;
        let (report, _) = stepped?;
        summary.take_step(&record::row(
            model.stepping.h(),
            &state,
            &report,
            machine.cycle.phase(state.time()),
            &Coordination::default(),
            &setting.followed,
        ));
    }
    summary.take_zones(&compactness(&model, &state, &zones));
    let tines: Vec<f64> = (setting.followed.iter().zip(&summary.bodies))
        .filter(|(followed, _)| followed.role == Role::Tine)
        .map(|(_, body)| body.squeeze.single.mean())
        .collect();
    let last = |column| summary.last().map_or(f64::NAN, |row| row.get(column));
    Ok(Outcomes {
        compactness: summary.compactness.first().copied().unwrap_or([f64::NAN; 2]),
        force: tines.iter().sum::<f64>() / tines.len().max(1) as f64,
        work: last(Column::WorkIn),
        balance_error: last(Column::BalanceError),
        not_converged: summary.not_converged as f64 / summary.steps.max(1) as f64,
        penetration: summary.mean_penetration.mean() / setting.grain_size,
    })
}

/// Runs that differ in their beds alone.
struct Group {
    /// The setting that groups differ in: a time step in ms, or a cap of iterations.
    value: f64,
    /// By bed; nothing where a run broke off.
    runs: Vec<Option<Outcomes>>,
}

impl Group {
    /// Mean over the beds.
    fn mean(&self, of: impl Fn(&Outcomes) -> f64) -> f64 {
        mean_and_error(&self.runs.iter().flatten().map(of).collect::<Vec<_>>())[0]
    }

    /// The largest over the beds; not a number if one is missing.
    fn worst(&self, of: impl Fn(&Outcomes) -> f64) -> f64 {
        let values = self.runs.iter().map(|run| run.as_ref().map_or(f64::NAN, &of));
        values.fold(0.0, |worst, x| if x > worst || x.is_nan() { x } else { worst })
    }
}

/// Energy balance of a cycle, and its outcome for other time steps and caps of iterations.
pub fn cycle(size: &Size, folder: &Path, console: &dyn Reporter) -> Outcome<[Check; 2]> {
    let (text, name) = if size.quick { (SMALL, "small_cycle") } else { (FIRST, "first") };
    let case = case::parse(text.into(), name, &CaseOverrides::default(), console)?;
    let which = if size.quick {
        "A small tamping cycle (some 160 stones, one pair of tines)"
    } else {
        "The tamping cycle of examples/first.toml"
    };
    let (own_step, own_cap) = (case.plan.run.stepping.step_ns, case.plan.run.solver.max_iterations);
    let steps = [2 * own_step, own_step, own_step / 2];
    let caps = [own_cap / 4, 4 * own_cap];
    let mut energy = Check::new(
        "energy over a tamping cycle",
        format!(
            "{which}, θ = 1/2: what the ledger (T-14) cannot account for, over the work put in; the worst of {} beds.",
            size.beds()
        ),
        "The ledger closes for θ = 1/2, but for the gyroscopic term, which is of second order in h",
    );
    let mut study = Check::new(
        "settings of a tamping cycle",
        format!(
            "The same cycle on {} beds: time steps of {} ms at {own_cap} iterations at most, and {} iterations instead at \
             {} ms. Ratios bed by bed, their mean and its standard error.",
            size.beds(),
            listed(&steps.map(milliseconds)),
            listed(&caps),
            milliseconds(own_step)
        ),
        "Hoang et al. 2012: outcomes within 1.7 % count as equal; what is beyond that and three standard errors is a difference",
    );
    let seeds: Vec<u64> = (1..=size.beds()).collect();
    // Before the runs, of which several need the same.
    side_by_side("beds", &seeds, console, |seed| {
        unless_broken_off(beds::one_of_many(&on_bed(&case, *seed), folder, console).map(drop))
    })?;
    let of_steps = steps.map(|step_ns| (step_ns, own_cap));
    let of_caps = caps.map(|iterations| (own_step, iterations));
    let settings = of_steps.iter().chain(&of_caps).flat_map(|&(step_ns, iterations)| {
        seeds.iter().map(move |&seed| Settings { seed, step_ns, iterations })
    });
    let runs = side_by_side("cycles", &settings.collect::<Vec<_>>(), console, |settings| {
        unless_broken_off(run(&case, *settings, folder, console))
    })?;
    let mut runs = runs.chunks(seeds.len());
    let mut group = |value: f64, at: &str| {
        let runs = runs.next().into_iter().flatten().zip(&seeds);
        let runs = runs.map(|(out, seed)| told(out, &format!("{at}, bed {seed}"), &mut study));
        let group = Group { value, runs: runs.collect() };
        tell(&mut study, at, &group);
        group
    };
    let by_step = steps.map(milliseconds).map(|ms| group(ms, &format!("h = {ms} ms")));
    let by_cap = caps.map(|cap| group(f64::from(cap), &format!("{cap} iterations")));
    let mut by_cap = Vec::from(by_cap);
    for group in &by_step {
        let worst = group.worst(|out| (out.balance_error / out.work).abs());
        let name = format!("balance error over work, h = {} ms", group.value);
        energy.findings.push(Finding::near(name, worst, 0.0, 1e-3));
    }
    let [_, own, finest] = &by_step;
    compare(&mut study, "half the time step", own, finest);
    let with = format!("{} iterations instead of {own_cap}", 4 * own_cap);
    compare(&mut study, &with, own, &by_cap[1]);
    by_cap.insert(1, Group { value: f64::from(own_cap), runs: own.runs.clone() });
    let title = "Compactness under the sleeper, by the";
    study.charts = vec![
        drawn(&format!("{title} time step"), &by_step, |ms| format!("{ms} ms")),
        drawn(&format!("{title} iterations at most"), &by_cap, |n| format!("{n} iterations")),
    ];
    study.remark = "Tamping of a small bed is chaotic: any change of a setting leads to another arrangement of the \
                    stones, as another bed does. Only a difference that is larger than the scatter over beds says that \
                    a setting is not converged."
        .into();
    Ok([energy, study])
}

/// A time in ms; rounded, for one in nanoseconds has no more digits than that.
fn milliseconds(ns: u64) -> f64 {
    (ns as f64 / 1e3).round() / 1e3
}

/// The beds of each group, and what their mean is worth.
fn drawn(title: &str, groups: &[Group], name: impl Fn(f64) -> String) -> String {
    let (mut beds, mut means) = (vec![], vec![]);
    for (k, group) in groups.iter().enumerate() {
        let found: Vec<f64> = group.runs.iter().flatten().map(|out| out.compactness[1]).collect();
        let [mean, error] = mean_and_error(&found);
        // Beside each other.
        beds.extend(found.iter().map(|phi| [k as f64 - 0.06, *phi]));
        means.push([k as f64 + 0.06, mean, error]);
    }
    let names = groups.iter().map(|group| name(group.value));
    let chart = Chart::of_names(title, "compactness, end", names);
    let chart = chart.with("one bed each", beds, Mark::Dots);
    chart.with_bars("mean over the beds, ± its standard error", &means).svg()
}

/// What a run gave, or why it broke off, which is no reason to end the check.
fn unless_broken_off<T>(run: Outcome<T>) -> Outcome<Result<T, String>> {
    match run {
        Ok(out) => Ok(Ok(out)),
        Err(Failure::Failed(why)) => Ok(Err(why)),
        Err(other) => Err(other),
    }
}

/// What a run gave; a run that broke off is a finding of its own.
fn told(found: &Result<Outcomes, String>, at: &str, check: &mut Check) -> Option<Outcomes> {
    let broken_off = |why: &String| {
        check.findings.push(Finding {
            quantity: format!("run with {at}: {why}"),
            measured: f64::NAN,
            digits: DIGITS,
            expected: "a whole cycle".into(),
            tolerance: "none".into(),
            verdict: Verdict::Failed,
        });
    };
    found.as_ref().map_err(broken_off).ok().cloned()
}

fn tell(check: &mut Check, at: &str, group: &Group) {
    let mut add = |what: &str, value: f64| {
        check.findings.push(Finding::told(format!("{what}, {at}"), value, ""));
    };
    add("compactness under the sleeper, end", group.mean(|out| out.compactness[1]));
    add("mean force on a tine while squeezing (N)", group.mean(|out| out.force));
    add("mean penetration over d", group.mean(|out| out.penetration));
    add("share of steps not converged", group.mean(|out| out.not_converged));
}

fn compare(check: &mut Check, with: &str, own: &Group, other: &Group) {
    let beds = own.runs.iter().zip(&other.runs);
    let pairs: Vec<_> = beds.filter_map(|(a, b)| a.as_ref().zip(b.as_ref())).collect();
    let ratio = |of: fn(&Outcomes) -> f64| {
        mean_and_error(&pairs.iter().map(|(a, b)| of(a) / of(b)).collect::<Vec<_>>())
    };
    let [compactness, error] = ratio(|out| out.compactness[1]);
    let [force, force_error] = ratio(|out| out.force);
    let equal =
        pairs.len() == own.runs.len() && (compactness - 1.0).abs() <= 0.017 + ERRORS * error;
    check.findings.push(Finding {
        quantity: format!("compactness over that with {with}"),
        measured: compactness,
        digits: DIGITS,
        expected: "1".into(),
        tolerance: format!("± 0.017 and {ERRORS} × {error:.3}"),
        verdict: Verdict::of(equal),
    });
    let name = format!("tine force over that with {with}");
    check.findings.push(Finding::told(name, force, format!("1 ± {ERRORS} × {force_error:.2}")));
}
