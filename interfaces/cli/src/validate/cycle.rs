//! A whole tamping cycle: its energy balance, and what the settings of the solver change.

use super::check::{Check, Finding, Verdict};
use super::size::Size;
use crate::case::{self, Case, Choices};
use crate::console::Console;
use crate::engine::Engine;
use crate::exit::{Failure, Outcome};
use crate::plot::{Chart, Mark};
use crate::profile::Profile;
use crate::record::{self, Column};
use crate::recorder::zones;
use crate::summary::{Setting, Summary};
use crate::{beds, session};
use ballast::model::Role;
use ballast::observe;
use std::path::Path;

const SMALL: &str = include_str!("cycle.toml");
const FIRST: &str = include_str!("../../../../examples/first.toml");

/// What one run of the cycle gave.
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

/// A run of `case` with another time step (ns) and cap of iterations.
fn run(
    case: &Case,
    step_ns: u64,
    iterations: u32,
    folder: &Path,
    console: Console,
) -> Outcome<Outcomes> {
    let mut case = case.clone();
    case.plan.run.stepping.step_ns = step_ns;
    case.plan.run.solver.iterations = iterations;
    let (model, state) = beds::scene(&case, folder, console)?;
    let cycle = session::cycle(&case, &model, &state)?;
    let setting = Setting::of(&case, &model);
    let mut summary = Summary::new(setting.clone());
    let mut engine = Engine::machine(model, state, cycle);
    let mut watch = Profile::start();
    let observe = |engine: &Engine, summary: &mut Summary| -> Outcome {
        let measured = zones(&case).into_iter().map(|zone| {
            Ok(observe::compactness(engine.model(), engine.state(), &zone)?.compactness)
        });
        let measured: ballast::Result<Vec<f64>> = measured.collect();
        summary.take_zones(&measured.map_err(|e| Failure::Failed(e.to_string()))?);
        Ok(())
    };
    observe(&engine, &mut summary)?;
    for _ in 0..case.steps() {
        let Some(stepped) = engine.step(&mut watch)? else { break };
        let h = engine.model().stepping.h();
        let state = engine.state();
        summary.take_step(&record::row(
            h,
            state,
            &stepped.report,
            engine.phase(),
            0.0,
            &setting.followed,
        ));
    }
    observe(&engine, &mut summary)?;
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

/// Energy balance of a cycle, and its outcome for other time steps and caps of iterations.
pub fn cycle(size: &Size, folder: &Path, console: Console) -> Outcome<[Check; 2]> {
    let (text, name) = if size.quick { (SMALL, "small_cycle") } else { (FIRST, "first") };
    let case = case::parse(text.into(), name, &Choices::default(), console)?;
    let (own_step, own_cap) = (case.plan.run.stepping.step_ns, case.plan.run.solver.iterations);
    let steps = [2 * own_step, own_step, own_step / 2];
    let caps =
        if size.quick { vec![100, own_cap] } else { vec![own_cap / 4, own_cap, 4 * own_cap] };
    let mut energy = Check::new(
        "energy over a tamping cycle",
        format!(
            "The cycle of `{name}`, θ = 1/2: what the ledger (T-14) cannot account for, over the work put in."
        ),
        "The ledger closes for θ = 1/2, but for the gyroscopic term, which is of second order in h",
    );
    let mut study = Check::new(
        "settings of a tamping cycle",
        format!(
            "The cycle of `{name}` from one bed: time steps {steps:?} ns at {own_cap} iterations at most, and \
             {caps:?} iterations at the case's own step."
        ),
        "Hoang et al. 2012: outcomes within 1.7 % count as equal; finest setting against the case's own",
    );
    let mut by_step = vec![];
    for step in steps {
        let at = format!("h = {} ms", step as f64 * 1e-6);
        let Some(out) = told(run(&case, step, own_cap, folder, console), &at, &mut study)? else {
            continue;
        };
        let share = (out.balance_error / out.work).abs();
        let name = format!("balance error over work, h = {} ms", step as f64 * 1e-6);
        energy.findings.push(Finding::near(name, share, 0.0, 1e-3));
        by_step.push((step as f64 * 1e-6, out));
    }
    let mut by_cap = vec![];
    for cap in caps {
        let at = format!("{cap} iterations");
        let Some(out) = told(run(&case, own_step, cap, folder, console), &at, &mut study)? else {
            continue;
        };
        by_cap.push((f64::from(cap), out));
    }
    tell(&mut study, "h = ", " ms", &by_step);
    tell(&mut study, "", " iterations", &by_cap);
    if let [.., own, finest] = &by_step[..] {
        compare(&mut study, "half the time step", &finest.1, &own.1);
    }
    if let [.., own, finest] = &by_cap[..] {
        let with = format!("{} iterations instead of {}", finest.0, own.0);
        compare(&mut study, &with, &finest.1, &own.1);
    }
    for (runs, title, axis) in [
        (&by_step, "Compactness under the sleeper against the time step", "time step (ms)"),
        (
            &by_cap,
            "Compactness under the sleeper against the cap of iterations",
            "iterations at most",
        ),
    ] {
        let points = runs.iter().map(|(x, out)| [*x, out.compactness[1]]).collect();
        study.charts.push(
            Chart::new(title, axis, "compactness, end").with("end", points, Mark::Points).svg(),
        );
    }
    study.remark = "Tamping of a small bed is chaotic: any change of a setting leads to another arrangement of the \
                    stones, as another seed does. A difference here is that of single runs; only one that is larger \
                    than the scatter over seeds says that a setting is not converged."
        .into();
    Ok([energy, study])
}

/// What a run gave; a run that breaks off is a finding of its own.
fn told(found: Outcome<Outcomes>, at: &str, check: &mut Check) -> Outcome<Option<Outcomes>> {
    match found {
        Ok(out) => Ok(Some(out)),
        Err(Failure::Failed(why)) => {
            check.findings.push(Finding {
                quantity: format!("run with {at}: {why}"),
                measured: f64::NAN,
                expected: "a whole cycle".into(),
                tolerance: "none".into(),
                verdict: Verdict::Failed,
            });
            Ok(None)
        }
        Err(other) => Err(other),
    }
}

fn tell(check: &mut Check, before: &str, unit: &str, runs: &[(f64, Outcomes)]) {
    for (value, out) in runs {
        let at = format!("{before}{value}{unit}");
        let mut add = |what: &str, value: f64| {
            check.findings.push(Finding::told(format!("{what}, {at}"), value, ""));
        };
        add("compactness under the sleeper, end", out.compactness[1]);
        add("mean force on a tine while squeezing (N)", out.force);
        add("mean penetration over d", out.penetration);
        add("share of steps not converged", out.not_converged);
    }
}

fn compare(check: &mut Check, with: &str, finest: &Outcomes, own: &Outcomes) {
    let ratio = own.compactness[1] / finest.compactness[1];
    check.findings.push(Finding::near(
        format!("compactness over that with {with}"),
        ratio,
        1.0,
        0.017,
    ));
    let ratio = own.force / finest.force;
    check.findings.push(Finding::told(format!("tine force over that with {with}"), ratio, "1"));
}
