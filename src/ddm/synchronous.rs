//! Subdomains in parallel, then the interface (HSDA, Algorithm 1), without a barrier between ([`super::turns`]).
//!
//! One set of contacts (the sequential schedule) is the case without interface. Where a tolerance is asked for,
//! iterations have momentum; where with it neither full nor smaller steps get on, they are accelerated, and
//! begin anew in rounds.

use super::decomposition::Set;
use super::momentum::Start;
use super::round::Round;
use super::turns::{Stretch, Turn};
use super::{Ask, Decomposition, Outcome, deciding, is_solved, next_after};
use crate::cancel::StopReason;
use crate::error::{Error, Result};
use crate::model::{Norm, Solver};

/// Tests after which the threads part for a moment: more than most steps have.
const TESTS_IN_A_ROW: u32 = 32;

/// Iterates until the tolerance or the cap is reached.
///
/// # Errors
/// [`Error::Stopped`] when `ask` says so.
pub(super) fn iterate(
    decomposition: &mut Decomposition,
    solver: &Solver,
    ask: Ask,
) -> Result<Outcome> {
    let mut progress = Progress::new(solver, ask);
    loop {
        decomposition.in_stretches(
            |set, turn, leg: &Leg| leg.visit(set, turn, solver),
            |sets| progress.next(sets),
        );
        if let Some(leg) = progress.leg.take() {
            progress.turn(decomposition, &leg);
        } else if std::mem::take(&mut progress.pauses) {
            // By the calling thread: some ask of what is told to no other one.
            progress.stopped = (progress.ask)();
            if progress.stopped.is_some() {
                break;
            }
        } else {
            break;
        }
    }
    if let Some(stop) = progress.stopped {
        return Err(Error::Stopped(stop));
    }
    let mut outcome = progress.outcome;
    outcome.residuals.natural_map = decomposition.natural_map();
    outcome.visits = decomposition.visits();
    Ok(outcome)
}

/// Iterations up to the next one after which something is looked at or done.
#[derive(Clone, Copy)]
struct Leg {
    start: Start,
    iterations: u32,
    /// Number of the last one.
    done: u32,
    /// Over those asked for.
    sweeps: u32,
    relaxation: f64,
    /// Whether the last iteration ends with a test, and at a point of the momentum.
    measured: bool,
    is_point: bool,
    /// Whether the natural map is asked for then.
    mapped: bool,
}

impl Leg {
    /// Passes before the sweeps.
    fn ahead(&self) -> u32 {
        u32::from(matches!(self.start, Start::GoOn(_)))
    }

    fn passes(&self) -> u32 {
        self.ahead() + self.iterations + u32::from(self.mapped)
    }

    fn visit(&self, set: &mut Set, turn: Turn, solver: &Solver) {
        if turn.pass == 0 {
            set.momentum.start(&mut set.contacts, self.start);
        }
        let Some(iteration) = turn.pass.checked_sub(self.ahead()) else { return };
        if iteration == self.iterations {
            set.map = set.contacts.natural_map();
            return;
        }
        let is_last = iteration + 1 == self.iterations;
        let sweeps =
            if turn.of_interface { solver.interface_sweeps } else { solver.subdomain_sweeps };
        set.sweeps(self.sweeps.saturating_mul(sweeps), self.relaxation, self.measured && is_last);
        if self.is_point && is_last {
            set.momentum.measure(&set.contacts);
        }
    }
}

/// How far the iterations have come.
struct Progress<'a> {
    solver: &'a Solver,
    round: Round<'a>,
    outcome: Outcome,
    /// What the next leg begins with.
    start: Start,
    /// The one under way, or after which [`Self::turn`] is to be called.
    leg: Option<Leg>,
    ask: Ask<'a>,
    stopped: Option<StopReason>,
    /// Tests since the calling thread has asked, and whether it is to.
    tests: u32,
    pauses: bool,
}

impl<'a> Progress<'a> {
    fn new(solver: &'a Solver, ask: Ask<'a>) -> Self {
        let outcome = Outcome { converged: solver.tolerance.is_none(), ..Outcome::default() };
        let (round, start) = (Round::first(solver), Start::Sweeps);
        let (leg, stopped, tests, pauses) = (None, None, 0, false);
        Self { solver, round, outcome, start, leg, ask, stopped, tests, pauses }
    }

    /// The iteration after which the last sweeps are to come: what the cap ends with are sweeps from the best impulses.
    fn closing(&self) -> u32 {
        self.solver.max_iterations.saturating_sub(self.solver.convergence_check_interval)
    }

    /// Ends the leg that is under way, and gives the next one; `None` when all is over, the leg is to be followed by a
    /// turn, or the calling thread is to ask.
    fn next(&mut self, sets: &Decomposition) -> Option<Stretch<Leg>> {
        if let Some(Leg { done, measured, mapped, .. }) = self.leg {
            self.outcome.iterations = done;
            if measured && self.ends(sets, mapped) {
                self.leg = None;
                return None;
            }
            self.tests += u32::from(measured);
            let is_closing = done >= self.closing();
            if self.round.is_at_a_turn(done, measured && !is_closing) {
                return None;
            }
            self.start = match is_closing {
                true => Start::Sweeps,
                false => self.round.start(sets, done, measured),
            };
            if self.tests >= TESTS_IN_A_ROW {
                (self.tests, self.pauses, self.leg) = (0, true, None);
                return None;
            }
        }
        self.leg = (self.outcome.iterations < self.solver.max_iterations).then(|| self.plan());
        self.leg.map(|leg| (leg.passes(), leg))
    }

    /// After a test: whether the iterations end with it.
    fn ends(&mut self, sets: &Decomposition, mapped: bool) -> bool {
        let residuals = &mut self.outcome.residuals;
        let norms = sets.visit_norms();
        let fling = norms.fling(sets.fall);
        *residuals = norms.residuals();
        if mapped {
            residuals.natural_map = sets.last_map();
        }
        if is_solved(self.solver, residuals, fling) {
            self.outcome.converged = true;
            return true;
        }
        // Nothing leads back from what is not a number.
        if residuals.quad.is_nan() {
            return true;
        }
        let residual = deciding(self.solver, residuals);
        self.round.observe(self.outcome.iterations, residual, fling);
        self.stopped = (self.ask)();
        self.stopped.is_some()
    }

    /// The next leg.
    fn plan(&self) -> Leg {
        let (before, closing) = (self.outcome.iterations, self.closing());
        let test = next_after(before, 0, self.solver.convergence_check_interval)
            .min(self.solver.max_iterations);
        let stops = [self.round.next_point(before), (before < closing).then_some(closing)];
        let done = stops.into_iter().flatten().fold(test, u32::min);
        let measured = done == test;
        Leg {
            start: self.start,
            iterations: done - before,
            done,
            sweeps: self.round.sweeps(),
            relaxation: self.round.relaxation(),
            measured,
            is_point: self.round.is_point(done),
            mapped: measured && self.solver.norm == Norm::NaturalMap,
        }
    }

    /// Does what needs all sets at hand after a leg.
    fn turn(&mut self, decomposition: &mut Decomposition, leg: &Leg) {
        if leg.done >= self.closing() {
            self.round.retreat(decomposition);
        } else {
            self.round.go_on(decomposition, leg.done, leg.measured);
        }
        self.start = Start::Sweeps;
    }
}
