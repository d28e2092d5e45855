//! Hybrid solver: sweeps, accelerated sweeps and Newton steps, with tests of the error.

use super::newton;
use super::settings::{Solution, SolutionSettings};
use crate::math::{Mat3, Vec3, cone};
use crate::nlgs::anderson::{AndersonMixing, History, MIXING_PERIOD, Safeguard, SafeguardVerdict};
use crate::nlgs::assembled_problem::AssembledProblem;

/// Minimum fraction of a Newton step in the line search.
const MIN_STEP_FRACTION: f64 = 0.1;
/// Minimum regularisation, relative to the contacts' own blocks of W.
const MIN_REGULARISATION: f64 = 1e-14;
/// Maximum regularisation.
const MAX_REGULARISATION: f64 = 1.0;

/// Solver state: current and best impulses, and the work done.
pub(super) struct HybridSolver<'a> {
    problem: &'a AssembledProblem,
    settings: &'a SolutionSettings,
    impulse: Vec<Vec3>,
    best: Vec<Vec3>,
    best_error: f64,
    sweeps: u64,
    newton_steps: u64,
    regularisation: f64,
    /// Products of Newton's method that sweeps have not balanced yet.
    newton_cost: f64,
}

impl<'a> HybridSolver<'a> {
    pub fn new(
        problem: &'a AssembledProblem,
        impulse: Vec<Vec3>,
        settings: &'a SolutionSettings,
    ) -> Self {
        Self {
            problem,
            settings,
            best: impulse.clone(),
            best_error: problem.natural_map(&impulse).abh,
            impulse,
            sweeps: 0,
            newton_steps: 0,
            regularisation: 1e-3,
            newton_cost: newton::cost(3 * problem.contact_count()),
        }
    }

    /// Returns true if the problem is solved or no sweeps are left.
    pub fn is_finished(&self) -> bool {
        self.best_error <= self.settings.tolerance || self.sweeps >= self.settings.max_sweeps
    }

    /// Returns the number of sweeps that cost as much as Newton's method since the last call.
    pub fn balancing_sweeps(&mut self) -> u64 {
        // A block is nine products and sums; the law of a contact costs some thirty blocks.
        let sweep = 18.0 * (self.problem.blocks.len() + 30 * self.problem.contact_count()) as f64;
        (std::mem::take(&mut self.newton_cost) / sweep.max(1.0)) as u64
    }

    /// Makes at most `count` more sweeps.
    pub fn sweep(&mut self, count: u64) {
        self.sweep_with(count, |_| {});
    }

    /// Makes at most `count` more sweeps with Anderson acceleration (T-32).
    pub fn sweep_accelerated(&mut self, count: u64) {
        let weight = |w: &Mat3| [(w.trace() / 3.0).sqrt(); 3];
        let (mut history, mut mixing) = (History::default(), AndersonMixing::default());
        history.reset(self.problem.diagonal.iter().flat_map(weight));
        let mut safeguard = Safeguard::new(self.sweeps);
        let mut safe = self.impulse.clone();
        let (mut before, mut point) = (flatten(&self.impulse), Vec::new());
        self.sweep_with(count, |solver| {
            let (slot, stored) = (mixing.next_slot(), mixing.stored());
            let products = history.observe(slot, stored, &before, &flatten(&solver.impulse));
            let coefficients = mixing.coefficients(&products);
            let verdict = safeguard.assess(products.change_squared.sqrt(), solver.sweeps);
            if verdict == SafeguardVerdict::NewBest {
                safe.clone_from(&solver.impulse);
            }
            if verdict == SafeguardVerdict::Diverging {
                mixing.reset();
                solver.impulse.clone_from(&safe);
            } else if solver.sweeps.is_multiple_of(u64::from(MIXING_PERIOD))
                && !safeguard.is_cooling_down(solver.sweeps)
            {
                history.combine(&coefficients, &mut point);
                solver.impulse =
                    solver.project_to_cones(point.chunks_exact(3).map(Vec3::from_column_slice));
            }
            before = flatten(&solver.impulse);
        });
    }

    fn sweep_with(&mut self, count: u64, mut after: impl FnMut(&mut Self)) {
        let last = self.sweeps.saturating_add(count).min(self.settings.max_sweeps);
        let contacts = self.problem.contact_count() as u32;
        let mut next_update = self.sweeps + 1;
        while self.sweeps < last && !self.is_finished() {
            self.problem.sweep(&mut self.impulse, 0..contacts, 1.0);
            self.sweeps += 1;
            if self.sweeps >= next_update || self.sweeps == last {
                self.update_best();
                next_update = self.sweeps + (self.sweeps / 8).clamp(1, 50);
            }
            after(self);
        }
    }

    /// Makes Newton steps (T-33) as long as they reduce the error.
    pub fn newton(&mut self) {
        let mut current = self.problem.natural_map(&self.impulse).unit_free;
        while self.best_error > self.settings.tolerance {
            let system = newton::NewtonSystem::new(self.problem, &self.impulse);
            self.newton_steps += 1;
            self.newton_cost += newton::cost(system.size());
            let step = system.step(self.regularisation);
            let Some((fraction, trial, error)) = step.and_then(|s| self.line_search(&s, current))
            else {
                self.regularisation = (3.0 * self.regularisation).min(MAX_REGULARISATION);
                return;
            };
            if fraction == 1.0 {
                self.regularisation = (0.3 * self.regularisation).max(MIN_REGULARISATION);
            }
            self.impulse = trial;
            current = error;
            self.update_best();
        }
    }

    /// Finds the longest fraction of a step with a clearly smaller error; returns fraction, impulses and error.
    fn line_search(&self, step: &[Vec3], current: f64) -> Option<(f64, Vec<Vec3>, f64)> {
        let mut fraction = 1.0;
        while fraction > MIN_STEP_FRACTION {
            let end =
                self.project_to_cones(self.impulse.iter().zip(step).map(|(r, d)| r + d * fraction));
            let error = self.problem.natural_map(&end).unit_free;
            if error < current * (1.0 - 0.1 * fraction) {
                return Some((fraction, end, error));
            }
            fraction *= 0.5;
        }
        None
    }

    /// Projects impulses onto Coulomb's cones.
    fn project_to_cones(&self, impulse: impl Iterator<Item = Vec3>) -> Vec<Vec3> {
        impulse.zip(&self.problem.friction).map(|(r, &mu)| cone::project(&r, mu)).collect()
    }

    /// Stores the current impulses if they are the best so far.
    fn update_best(&mut self) {
        let error = self.problem.natural_map(&self.impulse).abh;
        if error < self.best_error || self.best_error.is_nan() {
            self.best_error = error;
            self.best.clone_from(&self.impulse);
        }
    }

    /// Returns the best impulses and their errors.
    pub fn finish(self) -> Solution {
        let errors = self.problem.natural_map(&self.best);
        Solution {
            converged: errors.abh <= self.settings.tolerance,
            errors,
            impulse: self.best,
            sweeps: self.sweeps,
            newton_steps: self.newton_steps,
        }
    }
}

/// Returns the components of all impulses in one vector.
fn flatten(impulse: &[Vec3]) -> Vec<f64> {
    impulse.iter().flat_map(|r| [r.x, r.y, r.z]).collect()
}
