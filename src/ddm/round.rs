//! What the iterations of the synchronous schedule go by besides sweeps: smaller steps, momentum, acceleration.
//!
//! Reads: residuals. Writes: impulses and lines of the sets, between iterations. Contract: whether anything is done
//! depends on residuals and the number of iterations alone.

use super::acceleration::AndersonAcceleration;
use super::momentum::{Momentum, Start};
use super::{Decomposition, Softening};
use crate::model::{Acceleration, Solver};

/// Iterations after which what has not reached the tolerance begins anew.
const LENGTH: u32 = 1500;

/// Sweeps per iteration in the first round, the second and the third, over those asked for; then the first again.
/// Momentum over longer iterations gets through problems that shorter ones wander about in. Odd, or contacts that flip with
/// every sweep would look as if they stood still.
const SWEEPS: [u32; 3] = [1, 5, 25];

/// A round of iterations, from the impulses of the one before (T-38).
pub(super) struct Round<'a> {
    solver: &'a Solver,
    /// Iteration after which it began, and how many were before it.
    began: u32,
    number: usize,
    softening: Softening,
    momentum: Option<Momentum>,
    acceleration: Option<AndersonAcceleration>,
}

impl<'a> Round<'a> {
    pub fn first(solver: &'a Solver) -> Self {
        Self::new(solver, 0, 0)
    }

    fn new(solver: &'a Solver, began: u32, number: usize) -> Self {
        let momentum = (solver.acceleration == Acceleration::Nncg && solver.tolerance.is_some())
            .then(Momentum::new);
        let softening = Softening::new(solver);
        Self { solver, began, number, softening, momentum, acceleration: None }
    }

    /// Relaxation of the visits.
    pub fn relaxation(&self) -> f64 {
        self.acceleration
            .as_ref()
            .map_or(self.softening.relaxation, AndersonAcceleration::relaxation)
    }

    /// How many times as many sweeps as asked for.
    pub fn sweeps(&self) -> u32 {
        SWEEPS[self.number % SWEEPS.len()]
    }

    /// The iteration after `done` that ends at a point, from which something may lead on, if there are points.
    pub fn next_point(&self, done: u32) -> Option<u32> {
        match &self.acceleration {
            Some(acceleration) => Some(acceleration.next_point(done)),
            None => self.momentum.as_ref()?.next_point(done),
        }
    }

    /// Whether iteration `done` ends at a point of the momentum: its sets are to be measured after their sweeps.
    pub fn is_point(&self, done: u32) -> bool {
        self.acceleration.is_none()
            && self.momentum.as_ref().is_some_and(|momentum| momentum.is_point(done))
    }

    /// Takes note of the residual after iteration `done`, which is not small enough, or of what is flung.
    pub fn observe(&mut self, done: u32, residual: f64, fling: f64) {
        self.softening.observe(done, residual, fling);
    }

    /// Whether after iteration `done`, which has ended with a `test` or not, something is to be done between the sweeps:
    /// [`Self::go_on`]. Otherwise [`Self::start`] says all.
    pub fn is_at_a_turn(&self, done: u32, test: bool) -> bool {
        self.acceleration.is_some() || test && (self.is_over(done) || self.needs_acceleration())
    }

    fn is_over(&self, done: u32) -> bool {
        self.momentum.is_some() && done - self.began >= LENGTH
    }

    fn needs_acceleration(&self) -> bool {
        self.softening.is_spent()
    }

    /// What all sets begin the next iterations with.
    pub fn start(&mut self, sets: &Decomposition, done: u32, test: bool) -> Start {
        let momentum = self.momentum.as_mut();
        momentum.map_or(Start::Sweeps, |momentum| momentum.start(sets, done, test))
    }

    /// Goes on to where the next iteration begins. What does not get on is accelerated, and when a round is over, the
    /// next one begins.
    pub fn go_on(&mut self, decomposition: &mut Decomposition, done: u32, test: bool) {
        if test && self.is_over(done) {
            self.retreat(decomposition);
            // The next test says what carries now.
            *self = Self::new(self.solver, done, self.number + 1);
            return;
        }
        if test && self.needs_acceleration() && self.acceleration.is_none() {
            let relaxations = [self.softening.relaxation, self.solver.relaxation];
            self.acceleration = Some(AndersonAcceleration::begin(decomposition, done, relaxations));
        }
        if let Some(acceleration) = &mut self.acceleration {
            acceleration.go_on(decomposition, done);
        }
    }

    /// Back to the best impulses, if an acceleration has led elsewhere.
    pub fn retreat(&mut self, decomposition: &mut Decomposition) {
        if let Some(mut acceleration) = self.acceleration.take() {
            acceleration.retreat(decomposition);
        }
    }
}
