//! The course of a solution: sweeps, accelerated sweeps, Newton steps, and tests of the error.

use super::{Solution, SolutionSettings, newton};
use crate::math::{Mat3, Vec3, cone};
use crate::nlgs::acceleration::{Guard, History, Mixing, PERIOD, Verdict};
use crate::nlgs::assembled_problem::AssembledProblem;

/// Least share of a Newton step that is tried.
const SHORTEST: f64 = 0.1;
/// Bounds of the regularisation, relative to the contacts' own W.
const SOFTEST: f64 = 1e-14;
const STIFFEST: f64 = 1.0;

pub(super) struct Search<'a> {
    problem: &'a AssembledProblem,
    settings: &'a SolutionSettings,
    impulse: Vec<Vec3>,
    best: Vec<Vec3>,
    best_error: f64,
    sweeps: u64,
    newton_steps: u64,
    regularisation: f64,
    /// Products that Newton's method has cost more than the sweeps since.
    owed: f64,
}

impl<'a> Search<'a> {
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
            owed: newton::cost(3 * problem.contact_count()),
        }
    }

    /// Solved, or without sweeps left.
    pub fn is_over(&self) -> bool {
        self.best_error <= self.settings.tolerance || self.sweeps >= self.settings.max_sweeps
    }

    /// Sweeps that cost as much as Newton's method did since the last ones.
    pub fn sweeps_owed(&mut self) -> u64 {
        // A block is nine products and sums; the law of a contact costs some thirty blocks.
        let sweep = 18.0 * (self.problem.blocks.len() + 30 * self.problem.contact_count()) as f64;
        (std::mem::take(&mut self.owed) / sweep.max(1.0)) as u64
    }

    /// Sweeps at most `count` times more.
    pub fn sweep(&mut self, count: u64) {
        self.sweep_with(count, |_| {});
    }

    /// Sweeps at most `count` times more, with Anderson's acceleration (T-32).
    pub fn sweep_accelerated(&mut self, count: u64) {
        let weight = |w: &Mat3| [(w.trace() / 3.0).sqrt(); 3];
        let (mut history, mut mixing) = (History::default(), Mixing::default());
        history.begin(self.problem.diagonal.iter().flat_map(weight));
        let mut guard = Guard::new(self.sweeps);
        let mut safe = self.impulse.clone();
        let (mut before, mut point) = (flat(&self.impulse), Vec::new());
        self.sweep_with(count, |search| {
            let (slot, remembered) = (mixing.slot(), mixing.remembered());
            let products = history.observe(slot, remembered, &before, &flat(&search.impulse));
            let shares = mixing.shares(&products);
            let verdict = guard.judge(products.change_squared.sqrt(), search.sweeps);
            if verdict == Verdict::Best {
                safe.clone_from(&search.impulse);
            }
            if verdict == Verdict::Astray {
                mixing.forget();
                search.impulse.clone_from(&safe);
            } else if search.sweeps.is_multiple_of(u64::from(PERIOD)) && !guard.rests(search.sweeps)
            {
                history.combine(&shares, &mut point);
                search.impulse =
                    search.admissible(point.chunks_exact(3).map(Vec3::from_column_slice));
            }
            before = flat(&search.impulse);
        });
    }

    fn sweep_with(&mut self, count: u64, mut after: impl FnMut(&mut Self)) {
        let last = self.sweeps.saturating_add(count).min(self.settings.max_sweeps);
        let contacts = self.problem.contact_count() as u32;
        let mut next_test = self.sweeps + 1;
        while self.sweeps < last && !self.is_over() {
            self.problem.sweep(&mut self.impulse, 0..contacts, 1.0);
            self.sweeps += 1;
            if self.sweeps >= next_test || self.sweeps == last {
                self.test();
                next_test = self.sweeps + (self.sweeps / 8).clamp(1, 50);
            }
            after(self);
        }
    }

    /// Newton steps (T-33) as long as they bring the impulses nearer to a solution.
    pub fn newton(&mut self) {
        let mut here = self.problem.natural_map(&self.impulse).unit_free;
        while self.best_error > self.settings.tolerance {
            let system = newton::System::new(self.problem, &self.impulse);
            self.newton_steps += 1;
            self.owed += newton::cost(system.size());
            let step = system.step(self.regularisation);
            let Some((share, trial, error)) = step.and_then(|s| self.along(&s, here)) else {
                self.regularisation = (3.0 * self.regularisation).min(STIFFEST);
                return;
            };
            if share == 1.0 {
                self.regularisation = (0.3 * self.regularisation).max(SOFTEST);
            }
            self.impulse = trial;
            here = error;
            self.test();
        }
    }

    /// The longest part of a step that leads to a clearly smaller error: its share, end and error.
    fn along(&self, step: &[Vec3], here: f64) -> Option<(f64, Vec<Vec3>, f64)> {
        let mut share = 1.0;
        while share > SHORTEST {
            let end = self.admissible(self.impulse.iter().zip(step).map(|(r, d)| r + d * share));
            let error = self.problem.natural_map(&end).unit_free;
            if error < here * (1.0 - 0.1 * share) {
                return Some((share, end, error));
            }
            share *= 0.5;
        }
        None
    }

    /// The nearest impulses within Coulomb's cones.
    fn admissible(&self, impulse: impl Iterator<Item = Vec3>) -> Vec<Vec3> {
        impulse.zip(&self.problem.friction).map(|(r, &mu)| cone::project(&r, mu)).collect()
    }

    /// Compares the present impulses with the best ones.
    fn test(&mut self) {
        let error = self.problem.natural_map(&self.impulse).abh;
        if error < self.best_error || self.best_error.is_nan() {
            self.best_error = error;
            self.best.clone_from(&self.impulse);
        }
    }

    pub fn end(self) -> Solution {
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

/// The numbers of all impulses end to end.
fn flat(impulse: &[Vec3]) -> Vec<f64> {
    impulse.iter().flat_map(|r| [r.x, r.y, r.z]).collect()
}
