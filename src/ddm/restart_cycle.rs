//! Control of the synchronous iterations between sweeps: relaxation, acceleration and restarts.
//!
//! Reads: residuals. Writes: impulses and velocities of the sets, between iterations. Contract: every decision
//! depends on residuals and the number of iterations alone.

use super::anderson::AndersonAcceleration;
use super::decomposition::Decomposition;
use super::iteration::AdaptiveRelaxation;
use super::nncg::{Nncg, NncgAction};
use crate::model::{Acceleration, Norm, Solver};

/// Iterations of a cycle, after which NNCG is restarted with more sweeps per iteration.
const CYCLE_ITERATIONS: u32 = 1500;

/// Factor on the sweeps per iteration in the first, second and third cycle; then cyclically.
///
/// NNCG over longer iterations converges on problems in which shorter ones wander. The factors are odd: with even ones,
/// contacts that flip with every sweep would seem to stand still.
const SWEEP_FACTORS: [u32; 3] = [1, 5, 25];

/// Cycle of iterations that starts from the impulses of the previous cycle (T-38).
pub(super) struct RestartCycle<'a> {
    solver: &'a Solver,
    /// Iteration after which the cycle started.
    start: u32,
    /// Number of cycles before this one.
    number: usize,
    relaxation: AdaptiveRelaxation,
    nncg: Option<Nncg>,
    anderson: Option<AndersonAcceleration>,
}

impl<'a> RestartCycle<'a> {
    /// Returns the first cycle of a step.
    pub fn first(solver: &'a Solver) -> Self {
        Self::new(solver, 0, 0)
    }

    fn new(solver: &'a Solver, start: u32, number: usize) -> Self {
        let is_accelerated =
            solver.acceleration == Acceleration::Nncg && solver.tolerance.is_some();
        Self {
            solver,
            start,
            number,
            relaxation: AdaptiveRelaxation::new(solver),
            nncg: is_accelerated.then(Nncg::new),
            anderson: None,
        }
    }

    /// Relaxation factor of the visits.
    pub fn relaxation(&self) -> f64 {
        self.anderson.as_ref().map_or(self.relaxation.relaxation, AndersonAcceleration::relaxation)
    }

    /// Factor on the sweeps per iteration.
    pub fn sweep_factor(&self) -> u32 {
        SWEEP_FACTORS[self.number % SWEEP_FACTORS.len()]
    }

    /// Returns the first iteration after `done` that ends with a mixing or an extrapolation, if there is one.
    pub fn next_acceleration(&self, done: u32) -> Option<u32> {
        match &self.anderson {
            Some(anderson) => Some(anderson.next_mixing(done)),
            None => self.nncg.as_ref()?.next_extrapolation(done),
        }
    }

    /// Returns true if iteration `done` ends with an NNCG extrapolation, so that its sets are measured after their sweeps.
    pub fn extrapolates_after(&self, done: u32) -> bool {
        self.anderson.is_none()
            && self.nncg.as_ref().is_some_and(|nncg| nncg.extrapolates_after(done))
    }

    /// Returns true if sets that have converged are skipped: until the iterations have stagnated with reduced relaxation, too.
    pub fn skips_converged(&self) -> bool {
        self.solver.skip_converged_subdomains
            && self.solver.norm != Norm::NaturalMap
            && self.nncg.is_some()
            && self.number == 0
            && !self.relaxation.has_stagnated_twice()
    }

    /// Records the residual and the relative velocity change of an unsolved test after iteration `done`.
    pub fn observe(&mut self, done: u32, residual: f64, relative_dv: f64) {
        self.relaxation.observe(done, residual, relative_dv);
    }

    /// Returns true if [`Self::advance`] is to be called after iteration `done`, instead of [`Self::nncg_action`].
    pub fn needs_exclusive_access(&self, done: u32, test: bool) -> bool {
        self.anderson.is_some() || test && (self.is_finished(done) || self.needs_anderson())
    }

    fn is_finished(&self, done: u32) -> bool {
        self.nncg.is_some() && done - self.start >= CYCLE_ITERATIONS
    }

    fn needs_anderson(&self) -> bool {
        self.relaxation.is_exhausted()
    }

    /// Returns the NNCG action of all sets after iteration `done`.
    pub fn nncg_action(&mut self, sets: &Decomposition, done: u32, test: bool) -> NncgAction {
        self.nncg.as_mut().map_or(NncgAction::Idle, |nncg| {
            nncg.action(done, test, || sets.sum(|set| set.nncg.change_squared))
        })
    }

    /// Starts the next cycle when this one is finished; otherwise starts or advances Anderson acceleration.
    pub fn advance(&mut self, decomposition: &mut Decomposition, done: u32, test: bool) {
        if test && self.is_finished(done) {
            self.restore_best(decomposition);
            // The next test finds the active contacts.
            *self = Self::new(self.solver, done, self.number + 1);
            return;
        }
        if test && self.needs_anderson() && self.anderson.is_none() {
            let relaxations = [self.relaxation.relaxation, self.solver.relaxation];
            self.anderson = Some(AndersonAcceleration::start(decomposition, done, relaxations));
        }
        if let Some(anderson) = &mut self.anderson {
            anderson.advance(decomposition, done);
        }
    }

    /// Ends Anderson acceleration, if active, and restores its best impulses.
    pub fn restore_best(&mut self, decomposition: &mut Decomposition) {
        if let Some(mut anderson) = self.anderson.take() {
            anderson.restore(decomposition);
        }
    }
}
