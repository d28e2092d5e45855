//! Sweeps with tests of the error.

use super::{Settings, Solution};
use crate::math::Vec3;
use crate::nlgs::reference::Assembled;

/// The course of a solution.
pub(super) struct Search<'a> {
    pub problem: &'a Assembled,
    pub settings: &'a Settings,
    pub impulse: Vec<Vec3>,
    pub best: Vec<Vec3>,
    pub best_error: f64,
    pub sweeps: u64,
    pub newton_steps: u64,
}

impl<'a> Search<'a> {
    pub fn new(problem: &'a Assembled, impulse: Vec<Vec3>, settings: &'a Settings) -> Self {
        let best_error = problem.natural_map(&impulse).abh;
        let best = impulse.clone();
        Self { problem, settings, impulse, best, best_error, sweeps: 0, newton_steps: 0 }
    }

    /// Compares the present impulses with the best ones.
    pub fn test(&mut self) -> f64 {
        let error = self.problem.natural_map(&self.impulse).abh;
        if error < self.best_error || self.best_error.is_nan() {
            self.best_error = error;
            self.best.clone_from(&self.impulse);
        }
        error
    }

    pub fn is_solved(&self) -> bool {
        self.best_error <= self.settings.tolerance
    }

    /// Sweeps until the problem is solved or the sweeps are spent.
    pub fn sweeps(&mut self) {
        let count = self.problem.contact_count() as u32;
        let mut next = 1;
        while !self.is_solved() && self.sweeps < self.settings.max_sweeps {
            self.problem.sweep(&mut self.impulse, 0..count, 1.0);
            self.sweeps += 1;
            if self.sweeps >= next || self.sweeps == self.settings.max_sweeps {
                let e = self.test();
                if self.sweeps.is_power_of_two() { #[cfg(any())] { e; } }
                let _ = e;
                // Tests cost an eighth of the sweeps at most.
                next = self.sweeps + (self.sweeps / 8).clamp(1, 50);
            }
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
