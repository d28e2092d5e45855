//! Ways to take a step, measured in turn: each takes every step from the same state.

use super::Said;
use super::args::Window;
use super::scene::Scene;
use ballast::model::{Model, Solver};
use ballast::state::State;
use ballast::step::{Phase, StepReport};
use ballast::workspace::Workspace;
use ballast_session::Outcome;
use ballast_session::Reporter;
use ballast_session::profile::{Profile, Spent};
use ballast_session::statistics::Quartiles;
use rayon::ThreadPool;
use std::sync::Arc;

/// One way to take a step.
pub struct Contender {
    pub label: String,
    pub model: Model,
    pub pool: Arc<ThreadPool>,
    workspace: Workspace,
    pub samples: Vec<Sample>,
    /// Fingerprint of the state after the last step, and whether all states were those of the first contender.
    pub hash: u128,
    pub same_bytes: bool,
}

/// A step that was measured.
pub struct Sample {
    pub phases: [Spent; Phase::ALL.len()],
    pub report: StepReport,
}

impl Sample {
    /// Time of some phases.
    pub fn of(&self, phases: &[Phase]) -> Spent {
        phases.iter().map(|&phase| self.phases[phase as usize]).sum()
    }

    /// Wall time of some phases, s.
    pub fn wall(&self, phases: &[Phase]) -> f64 {
        self.of(phases).wall.as_secs_f64()
    }
}

/// What the field calls detection.
pub const DETECTION: [Phase; 2] = [Phase::BroadPhase, Phase::NarrowPhase];

impl Contender {
    /// Steps of the scene's model with another solver, on the threads of `pool`.
    pub fn new(label: String, scene: &Scene, solver: Solver, pool: &Arc<ThreadPool>) -> Self {
        let model = Model { solver, ..scene.model.clone() };
        let (workspace, samples) = (Workspace::default(), Vec::new());
        Self { label, model, pool: pool.clone(), workspace, samples, hash: 0, same_bytes: true }
    }

    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// The step from `state`, which is replaced by the one after it.
    fn step(&mut self, scene: &Scene, state: &mut State) -> Outcome<Sample> {
        let Self { model, pool, workspace, .. } = self;
        pool.install(|| {
            let mut profile = Profile::start();
            let report = scene.mover.step(model, state, workspace, &mut profile)?;
            Ok(Sample { phases: Phase::ALL.map(|phase| profile.of(phase)), report })
        })
    }

    /// Wall time of some phases step by step, s.
    pub fn walls(&self, phases: &[Phase]) -> Vec<f64> {
        self.samples.iter().map(|sample| sample.wall(phases)).collect()
    }

    /// CPU time of all threads for a step, mean, s.
    pub fn cpu(&self) -> f64 {
        mean(self.samples.iter().map(|sample| sample.of(&Phase::ALL).cpu.as_secs_f64()))
    }

    /// Mean over the steps of a figure of their reports.
    pub fn mean(&self, figure: impl Fn(&StepReport) -> f64) -> f64 {
        mean(self.samples.iter().map(|sample| figure(&sample.report)))
    }

    /// Whether every step reached its tolerance, where there is one: `yes` or `no`.
    pub fn converged(&self) -> Option<&'static str> {
        let all = self.samples.iter().all(|sample| sample.report.converged);
        self.model.solver.tolerance.map(|_| if all { "yes" } else { "no" })
    }

    /// Contact visits per second of the solve.
    pub fn visits_per_second(&self) -> f64 {
        let visits: u64 = self.samples.iter().map(|sample| sample.report.visits).sum();
        let wall: f64 = self.walls(&[Phase::Solve]).iter().sum();
        if wall > 0.0 { visits as f64 / wall } else { 0.0 }
    }
}

/// Mean; 0 of nothing.
pub fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0.0, 0.0), |(n, sum), x| (n + 1.0, sum + x));
    if count > 0.0 { sum / count } else { 0.0 }
}

/// Ratio of two contenders' times, step by step.
pub fn ratios(above: &[f64], below: &[f64]) -> Quartiles {
    let of = above.iter().zip(below).filter(|(_, b)| **b > 0.0);
    Quartiles::of(&of.map(|(a, b)| a / b).collect::<Vec<_>>())
}

/// Measures the steps of `window` with all contenders in turn. The first one leads: its state after a step is
/// what all take the next step from. Returns the state at the end.
pub fn alternate(
    scene: &Scene,
    contenders: &mut [Contender],
    window: &Window,
    console: &dyn Reporter,
) -> Outcome<State> {
    let (warm_up, steps) = (window.warm_up, window.steps);
    // All warm up: the lists that detection keeps are then made anew in the same steps.
    let all = contenders.len() as f64 * f64::from(warm_up + steps);
    let mut progress = console.start_progress(&scene.name);
    let (mut state, mut done) = (scene.state.clone(), 0.0);
    for round in 0..warm_up + steps {
        let measured = round >= warm_up;
        let mut next = None;
        for turn in 0..contenders.len() {
            // Nobody is always first, with the caches that the others' outputs have left.
            let k = (turn + round as usize) % contenders.len();
            let mut after = state.clone();
            let contender = &mut contenders[k];
            let sample = contender.step(scene, &mut after)?;
            if measured {
                contender.samples.push(sample);
                contender.hash = ballast_hdf5::state_hash(&scene.model, &after);
            }
            done += 1.0;
            let label = &contender.label;
            progress.advance(done / all, &Said(format!("step {} · {label}", state.step)));
            if k == 0 {
                next = Some(after);
            }
        }
        state = next.expect("the first contender takes every step");
        let leader = contenders[0].hash;
        contenders.iter_mut().for_each(|c| c.same_bytes &= c.hash == leader);
    }
    progress.finish();
    Ok(state)
}
