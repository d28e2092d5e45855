//! Variants of a step, measured in alternation from the same states.

use super::StageLabel;
use super::args::StepRange;
use super::scene::BenchScene;
use ballast::model::{Model, Solver};
use ballast::state::State;
use ballast::step::{Phase, StepReport};
use ballast::workspace::Workspace;
use ballast_session::profile::{PhaseTime, Profile};
use ballast_session::statistics::Quartiles;
use ballast_session::{Reporter, Result};
use rayon::ThreadPool;
use std::sync::Arc;

/// One variant of the step: a solver on a number of threads.
pub struct Variant {
    pub label: String,
    pub model: Model,
    pub pool: Arc<ThreadPool>,
    workspace: Workspace,
    pub samples: Vec<StepSample>,
    /// Hash of the state after the last step.
    pub hash: u128,
    /// True if all states were bitwise those of the first variant.
    pub same_bytes: bool,
}

/// Measurement of one step.
pub struct StepSample {
    pub phases: [PhaseTime; Phase::ALL.len()],
    pub report: StepReport,
}

impl StepSample {
    /// Returns the time of some phases.
    pub fn of(&self, phases: &[Phase]) -> PhaseTime {
        phases.iter().map(|&phase| self.phases[phase as usize]).sum()
    }

    /// Returns the wall time of some phases, s.
    pub fn wall(&self, phases: &[Phase]) -> f64 {
        self.of(phases).wall.as_secs_f64()
    }
}

/// Phases that together are contact detection.
pub const DETECTION: [Phase; 2] = [Phase::BroadPhase, Phase::NarrowPhase];

impl Variant {
    /// Creates a variant that steps the scene's model with `solver` on the threads of `pool`.
    pub fn new(label: String, scene: &BenchScene, solver: Solver, pool: &Arc<ThreadPool>) -> Self {
        let model = Model { solver, ..scene.model.clone() };
        Self {
            label,
            model,
            pool: pool.clone(),
            workspace: Workspace::default(),
            samples: Vec::new(),
            hash: 0,
            same_bytes: true,
        }
    }

    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// Advances `state` by one step and measures it.
    fn step(&mut self, scene: &BenchScene, state: &mut State) -> Result<StepSample> {
        let Self { model, pool, workspace, .. } = self;
        pool.install(|| {
            let mut profile = Profile::start();
            let report = scene.driver.step(model, state, workspace, &mut profile)?;
            Ok(StepSample { phases: Phase::ALL.map(|phase| profile.of(phase)), report })
        })
    }

    /// Returns the wall time of some phases for each step, s.
    pub fn walls(&self, phases: &[Phase]) -> Vec<f64> {
        self.samples.iter().map(|sample| sample.wall(phases)).collect()
    }

    /// Returns the mean CPU time of all threads per step, s.
    pub fn cpu(&self) -> f64 {
        mean(self.samples.iter().map(|sample| sample.of(&Phase::ALL).cpu.as_secs_f64()))
    }

    /// Returns the mean over the steps of a figure of their reports.
    pub fn mean(&self, figure: impl Fn(&StepReport) -> f64) -> f64 {
        mean(self.samples.iter().map(|sample| figure(&sample.report)))
    }

    /// Returns `yes` if every step reached the tolerance, `no` otherwise; `None` without a tolerance.
    pub fn converged(&self) -> Option<&'static str> {
        let all = self.samples.iter().all(|sample| sample.report.converged);
        self.model.solver.tolerance.map(|_| if all { "yes" } else { "no" })
    }

    /// Returns the contact visits per second of the solve.
    pub fn visits_per_second(&self) -> f64 {
        let visits: u64 = self.samples.iter().map(|sample| sample.report.visits).sum();
        let wall: f64 = self.walls(&[Phase::Solve]).iter().sum();
        if wall > 0.0 { visits as f64 / wall } else { 0.0 }
    }
}

/// Mean of `values`; 0 if there are none.
pub fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0, 0.0), |(n, sum), x| (n + 1.0, sum + x));
    if count > 0.0 { sum / count } else { 0.0 }
}

/// Quartiles of the step-by-step ratio of two variants' times.
pub fn ratios(above: &[f64], below: &[f64]) -> Quartiles {
    let of = above.iter().zip(below).filter(|(_, b)| **b > 0.0);
    Quartiles::of(&of.map(|(a, b)| a / b).collect::<Vec<_>>())
}

/// Measures the steps of `range` with all variants in alternation, and returns the final state.
///
/// All variants take the next step from the state that the first variant has reached.
pub fn alternate(
    scene: &BenchScene,
    variants: &mut [Variant],
    range: &StepRange,
    console: &dyn Reporter,
) -> Result<State> {
    let StepRange { warm_up, steps } = *range;
    // All variants warm up, so that detection rebuilds its lists in the same steps.
    let all = variants.len() as f64 * f64::from(warm_up + steps);
    let mut progress = console.start_progress(&scene.name);
    let mut state = scene.state.clone();
    let mut done = 0.0;
    for round in 0..warm_up + steps {
        let measured = round >= warm_up;
        let mut next = None;
        for slot in 0..variants.len() {
            // The order rotates: the first variant finds the caches as the others left them.
            let k = (slot + round as usize) % variants.len();
            let mut after = state.clone();
            let variant = &mut variants[k];
            let sample = variant.step(scene, &mut after)?;
            if measured {
                variant.samples.push(sample);
                variant.hash = ballast_hdf5::state_hash(&scene.model, &after);
            }
            done += 1.0;
            let label = &variant.label;
            progress.advance(done / all, &StageLabel(format!("step {} · {label}", state.step)));
            if k == 0 {
                next = Some(after);
            }
        }
        state = next.expect("the first variant takes every step");
        let leader = variants[0].hash;
        variants.iter_mut().for_each(|c| c.same_bytes &= c.hash == leader);
    }
    progress.finish();
    Ok(state)
}
