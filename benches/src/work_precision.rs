//! `ballast bench cost SAMPLE`: what a simulated second costs, and how far stones then overlap.
//!
//! The question that decides between programs that solve contacts in different ways. Every choice of a length of
//! the step, a number of iterations and a share of recovery takes the same sample through the same stretch of
//! time, one after another: their states part at once, so there are no steps to take in turn.

use super::StageLabel;
use super::args::WorkPrecisionArgs;
use super::machine_info::MachineInfo;
use super::result_sheet::{ResultSheet, cells};
use super::scene::BenchScene;
use super::stop_rule::StopRule;
use ballast::model::{Model, PenetrationCorrection, Schedule, Solver, Stepping};
use ballast::observe::mean_speed;
use ballast::workspace::Workspace;
use ballast_session::profile::{PhaseTime, Profile};
use ballast_session::{Failure, Reporter, Result};
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

const MAX_STEP_MS: f64 = 100.0;
const MAX_STEPS: f64 = 1e7;

/// Measures the cost of a simulated second and the penetration left.
///
/// # Errors
/// A file that cannot be read or written, or a step that fails.
pub fn work_precision(args: &WorkPrecisionArgs, console: &dyn Reporter) -> Result {
    let machine = MachineInfo::observe();
    let trial_plans = trial_plans(args)?;
    let mut scene = BenchScene::read_sample(&args.file)?;
    args.detection.apply(&mut scene.model.stepping)?;
    let mut sheet = ResultSheet::new(COLUMNS);
    sheet.note("scene", scene.describe());
    sheet.note("detection_distance_m", scene.model.stepping.detection_distance.to_string());
    sheet.note("interval", format!("{} s, synchronous, penetrations of its last step", args.time));
    let whole: f64 = trial_plans.iter().map(|p| p.steps as f64).sum();
    let mut progress = console.start_progress(&scene.name);
    let mut before = 0.0;
    for trial in &trial_plans {
        let step_ms = 1e-6 * trial.step_ns as f64;
        let factor = trial.correction.map_or(0.0, |c| c.factor);
        let label = StageLabel(format!(
            "{step_ms} ms, {} iterations, correction {factor}",
            trial.iterations
        ));
        let result =
            trial.take(&scene, |done| progress.advance((before + done as f64) / whole, &label))?;
        before += trial.steps as f64;
        let per_step = |time: Duration| 1e3 * time.as_secs_f64() / trial.steps as f64;
        sheet.row(cells![
            step_ms,
            trial.iterations.get(),
            factor,
            trial.steps,
            result.contacts,
            per_step(result.spent.wall),
            per_step(result.spent.cpu),
            per_step(result.spent.cpu) / step_ms,
            1e6 * result.depths.iter().sum::<f64>() / result.depths.len().max(1) as f64,
            1e6 * result.depth(0.99),
            1e3 * result.depth(1.0),
            1e3 * result.speed,
        ]);
    }
    progress.finish();
    sheet.publish(&machine, args.csv.csv.as_deref(), console)
}

/// Parameters of one run through the interval.
struct TrialPlan {
    step_ns: u64,
    iterations: NonZeroU32,
    correction: Option<PenetrationCorrection>,
    steps: usize,
}

/// Returns all combinations of step length, correction factor and number of iterations.
fn trial_plans(args: &WorkPrecisionArgs) -> Result<Vec<TrialPlan>> {
    if let Some(factor) = args.correction_factor.iter().find(|f| !(0.0..=1.0).contains(*f)) {
        let text = format!("--correction-factor {factor}: expected factors from 0 to 1");
        return Err(Failure::Usage(text));
    }
    let mut trial_plans = Vec::new();
    for &ms in &args.step_ms {
        let steps = (1e3 * args.time / ms).round();
        if !(ms > 0.0 && ms <= MAX_STEP_MS && (1.0..=MAX_STEPS).contains(&steps)) {
            let text = format!(
                "--step-ms {ms}: expected steps of at most {MAX_STEP_MS} ms, 1 to {MAX_STEPS:e} of them in --time {} s",
                args.time
            );
            return Err(Failure::Usage(text));
        }
        for &factor in &args.correction_factor {
            let correction = (factor != 0.0)
                .then_some(PenetrationCorrection { factor, ..PenetrationCorrection::default() });
            trial_plans.extend(args.iterations.iter().map(|&iterations| TrialPlan {
                step_ns: (1e6 * ms).round() as u64,
                iterations,
                correction,
                steps: steps as usize,
            }));
        }
    }
    Ok(trial_plans)
}

/// Cost and final penetrations of one run.
struct TrialResult {
    spent: PhaseTime,
    contacts: usize,
    /// Penetrations at the end, ascending, m.
    depths: Vec<f64>,
    /// Mean speed of the grains at the end, m/s.
    speed: f64,
}

impl TrialResult {
    /// Returns a quantile of the penetrations, m; 0 if there are none.
    fn depth(&self, quantile: f64) -> f64 {
        let last = self.depths.len().saturating_sub(1);
        self.depths.get((quantile * last as f64) as usize).copied().unwrap_or(0.0)
    }
}

impl TrialPlan {
    fn take(&self, scene: &BenchScene, mut on_step: impl FnMut(usize)) -> Result<TrialResult> {
        let Model { stepping, solver, .. } = scene.model;
        let stepping = Stepping { step_ns: self.step_ns, ..stepping };
        let solver = StopRule::fixed(Some(self.iterations), solver);
        let solver = Solver {
            schedule: Schedule::Synchronous,
            penetration_correction: self.correction,
            ..solver
        };
        let model = Model { stepping, solver, ..scene.model.clone() };
        model.check()?;
        let (mut state, mut workspace) = (scene.state.clone(), Workspace::default());
        let mut profile = Profile::start();
        for done in 1..=self.steps {
            scene.driver.step(&model, &mut state, &mut workspace, &mut profile)?;
            on_step(done);
            profile.output();
        }
        let gaps = workspace.contacts.gap.iter();
        let mut depths: Vec<f64> = gaps.filter(|g| **g < 0.0).map(|g| -g).collect();
        depths.sort_by(f64::total_cmp);
        let (contacts, speed) = (workspace.contacts.len(), mean_speed(&model, &state));
        Ok(TrialResult { spent: profile.steps(), contacts, depths, speed })
    }
}
