//! `ballast bench cost SAMPLE`: what a simulated second costs, and how far stones then overlap.
//!
//! The question that decides between programs that solve contacts in different ways. Every choice of a length of
//! the step, a number of iterations and a share of recovery takes the same sample through the same stretch of
//! time, one after another: their states part at once, so there are no steps to take in turn.

use super::Said;
use super::args::BenchCost;
use super::machine::Machine;
use super::rule::Rule;
use super::scene::Scene;
use super::sheet::{Sheet, cells};
use ballast::model::{Model, PenetrationCorrection, Schedule, Solver, Stepping};
use ballast::observe::mean_speed;
use ballast::workspace::Workspace;
use ballast_session::Reporter;
use ballast_session::profile::{Profile, Spent};
use ballast_session::{Failure, Outcome};
use std::num::NonZeroU32;
use std::time::Duration;

const COLUMNS: &[&str] = &[
    "step_ms",
    "iterations",
    "recovery",
    "steps",
    "contacts",
    "wall_ms_per_step",
    "cpu_ms_per_step",
    "cpu_s_per_simulated_s",
    "mean_penetration_um",
    "p99_penetration_um",
    "max_penetration_mm",
    "mean_speed_mm_per_s",
];

/// Longest step, ms, and most steps that are worth asking for.
const LONGEST_MS: f64 = 100.0;
const MOST_STEPS: f64 = 1e7;

pub fn cost(args: &BenchCost, console: &dyn Reporter) -> Outcome {
    let machine = Machine::watch();
    let plans = plans(args)?;
    let mut scene = Scene::of_sample(&args.file)?;
    args.alert.choose(&mut scene.model.stepping)?;
    let mut sheet = Sheet::new(COLUMNS);
    sheet.note("scene", scene.describe());
    sheet.note("alert_m", scene.model.stepping.detection_distance.to_string());
    sheet.note("stretch", format!("{} s, synchronous, penetrations of its last step", args.time));
    let whole: f64 = plans.iter().map(|p| p.steps as f64).sum();
    let (mut progress, mut before) = (console.start_progress(&scene.name), 0.0);
    for plan in &plans {
        let step_ms = 1e-6 * plan.step_ns as f64;
        let share = plan.recovery.map_or(0.0, |r| r.factor);
        let told = Said(format!("{step_ms} ms, {} iterations, recovery {share}", plan.iterations));
        let taken =
            plan.take(&scene, |done| progress.advance((before + done as f64) / whole, &told))?;
        before += plan.steps as f64;
        let per_step = |time: Duration| 1e3 * time.as_secs_f64() / plan.steps as f64;
        sheet.row(cells![
            step_ms,
            plan.iterations.get(),
            share,
            plan.steps,
            taken.contacts,
            per_step(taken.spent.wall),
            per_step(taken.spent.cpu),
            per_step(taken.spent.cpu) / step_ms,
            1e6 * taken.depths.iter().sum::<f64>() / taken.depths.len().max(1) as f64,
            1e6 * taken.depth(0.99),
            1e3 * taken.depth(1.0),
            1e3 * taken.speed,
        ]);
    }
    progress.finish();
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

/// A way through the stretch of time.
struct Plan {
    step_ns: u64,
    iterations: NonZeroU32,
    recovery: Option<PenetrationCorrection>,
    steps: usize,
}

/// Every length of the step with every share of recovery and every number of iterations.
fn plans(args: &BenchCost) -> Outcome<Vec<Plan>> {
    if let Some(share) = args.recovery.iter().find(|share| !(0.0..=1.0).contains(*share)) {
        let text = format!("--recovery {share}: expected shares from 0 to 1");
        return Err(Failure::Usage(text));
    }
    let mut plans = Vec::new();
    for &ms in &args.step_ms {
        let steps = (1e3 * args.time / ms).round();
        if !(ms > 0.0 && ms <= LONGEST_MS && (1.0..=MOST_STEPS).contains(&steps)) {
            let text = format!(
                "--step-ms {ms}: expected steps of at most {LONGEST_MS} ms, 1 to {MOST_STEPS:e} of them in --time {} s",
                args.time
            );
            return Err(Failure::Usage(text));
        }
        for &share in &args.recovery {
            let recovery = (share != 0.0).then_some(PenetrationCorrection {
                factor: share,
                ..PenetrationCorrection::default()
            });
            plans.extend(args.iterations.iter().map(|&iterations| Plan {
                step_ns: (1e6 * ms).round() as u64,
                iterations,
                recovery,
                steps: steps as usize,
            }));
        }
    }
    Ok(plans)
}

/// What became of the sample.
struct Taken {
    spent: Spent,
    contacts: usize,
    /// Penetrations at the end, ascending, m.
    depths: Vec<f64>,
    /// Mean of the grains at the end, m/s.
    speed: f64,
}

impl Taken {
    /// What this share of the penetrating points stays below, m; 0 if there is none.
    fn depth(&self, share: f64) -> f64 {
        let last = self.depths.len().saturating_sub(1);
        self.depths.get((share * last as f64) as usize).copied().unwrap_or(0.0)
    }
}

impl Plan {
    fn take(&self, scene: &Scene, mut tell: impl FnMut(usize)) -> Outcome<Taken> {
        let Model { stepping, solver, .. } = scene.model;
        let stepping = Stepping { step_ns: self.step_ns, ..stepping };
        let solver = Rule::fixed(Some(self.iterations), solver);
        let solver = Solver {
            schedule: Schedule::Synchronous,
            penetration_correction: self.recovery,
            ..solver
        };
        let model = Model { stepping, solver, ..scene.model.clone() };
        model.check()?;
        let (mut state, mut workspace) = (scene.state.clone(), Workspace::default());
        let mut profile = Profile::start();
        for done in 1..=self.steps {
            scene.mover.step(&model, &mut state, &mut workspace, &mut profile)?;
            tell(done);
            profile.output();
        }
        let gaps = workspace.contacts.gap.iter();
        let mut depths: Vec<f64> = gaps.filter(|g| **g < 0.0).map(|g| -g).collect();
        depths.sort_by(f64::total_cmp);
        let (contacts, speed) = (workspace.contacts.len(), mean_speed(&model, &state));
        Ok(Taken { spent: profile.steps(), contacts, depths, speed })
    }
}
