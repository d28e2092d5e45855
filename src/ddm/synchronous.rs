//! Synchronous schedule: subdomains in parallel, then the interface (HSDA, Algorithm 1), without barriers
//! ([`super::sweep_scheduler`]).
//!
//! The sequential schedule is the case of one set without an interface. Iterations to a tolerance use NNCG; where
//! they stagnate with both full and reduced relaxation, Anderson acceleration and restarts follow
//! ([`super::restart_cycle`]).

use super::decomposition::Decomposition;
use super::iteration::{CancelCheck, SolveOutcome, is_solved, next_multiple, selected_residual};
use super::nncg::NncgAction;
use super::restart_cycle::RestartCycle;
use super::sweep_scheduler::{PassBatch, SweepTask};
use super::sweep_set::SweepSet;
use crate::cancel::StopReason;
use crate::error::{Error, Result};
use crate::model::{Norm, Solver};

/// Tests after which the calling thread polls for cancellation: more than most steps have.
const TESTS_BETWEEN_POLLS: u32 = 32;

/// Tests without the sets that have converged, after which one measures all sets.
const PARTIAL_TESTS: u32 = 3;

/// Iterates until the tolerance or the maximum number of iterations is reached.
///
/// # Errors
/// [`Error::Stopped`] when `cancelled` returns a reason.
pub(super) fn iterate(
    decomposition: &mut Decomposition,
    solver: &Solver,
    cancelled: CancelCheck,
) -> Result<SolveOutcome> {
    let mut control = IterationControl::new(solver, cancelled);
    loop {
        decomposition.for_each_pass(
            |set, task, batch: &IterationBatch| batch.needs_visit(set, task),
            |set, task, batch| batch.visit(set, task, solver),
            |sets| control.next_batch(sets),
        );
        if let Some(batch) = control.batch.take() {
            control.advance(decomposition, &batch);
        } else if std::mem::take(&mut control.must_poll) {
            // On the calling thread: some observers see signals there alone.
            control.stopped = (control.cancelled)();
            if control.stopped.is_some() {
                break;
            }
        } else {
            break;
        }
    }
    if let Some(reason) = control.stopped {
        return Err(Error::Stopped(reason));
    }
    let mut outcome = control.outcome;
    (outcome.residuals.natural_map, outcome.complementarity) = decomposition.law_errors();
    outcome.visits = decomposition.visits();
    Ok(outcome)
}

/// Iterations up to the next convergence test or acceleration.
#[derive(Clone, Copy)]
struct IterationBatch {
    action: NncgAction,
    iterations: u32,
    /// Number of the last iteration.
    done: u32,
    /// Factor on the sweeps of the solver.
    sweep_factor: u32,
    relaxation: f64,
    /// True if the last iteration ends with a convergence test.
    is_tested: bool,
    /// True if the last iteration ends with an NNCG extrapolation.
    extrapolates: bool,
    /// True if the test needs the natural map.
    maps: bool,
    /// True if sets that have converged are skipped.
    skips_converged: bool,
    /// True if the test measures these sets as well.
    tests_all: bool,
}

impl IterationBatch {
    /// Number of passes before the sweeps.
    fn leading_passes(&self) -> u32 {
        u32::from(matches!(self.action, NncgAction::Extrapolate(_)))
    }

    fn passes(&self) -> u32 {
        self.leading_passes() + self.iterations + u32::from(self.maps)
    }

    /// Returns true if the set is to be visited: sets that have converged only are where the batch begins a search or tests.
    fn needs_visit(&self, set: &SweepSet, task: SweepTask) -> bool {
        let begins = task.pass == 0 && self.action == NncgAction::Init;
        let tests = self.tests_all && task.pass + 1 >= self.leading_passes() + self.iterations;
        !(self.skips_converged && set.is_converged) || begins || tests
    }

    fn visit(&self, set: &mut SweepSet, task: SweepTask, solver: &Solver) {
        let is_skipped = self.skips_converged && set.is_converged;
        if task.pass == 0 {
            let was_skipped = std::mem::take(&mut set.was_skipped);
            let action = match self.action {
                NncgAction::Init => NncgAction::Init,
                _ if is_skipped => NncgAction::Idle,
                _ if was_skipped => NncgAction::Restart,
                action => action,
            };
            set.nncg.apply(&mut set.contacts, action);
        }
        let Some(iteration) = task.pass.checked_sub(self.leading_passes()) else { return };
        if iteration == self.iterations {
            set.law = set.contacts.law_sums();
            return;
        }
        let is_last = iteration + 1 == self.iterations;
        let sweeps =
            if task.is_interface { solver.interface_sweeps } else { solver.subdomain_sweeps };
        set.sweeps(
            self.sweep_factor.saturating_mul(sweeps),
            self.relaxation,
            self.is_tested && is_last,
        );
        if self.extrapolates && is_last && !is_skipped {
            set.nncg.measure(&set.contacts);
        }
    }
}

/// Control of the iterations of a step.
struct IterationControl<'a> {
    solver: &'a Solver,
    cycle: RestartCycle<'a>,
    outcome: SolveOutcome,
    /// First action of the next batch.
    action: NncgAction,
    /// Batch in progress, or the one after which [`Self::advance`] is to be called.
    batch: Option<IterationBatch>,
    cancelled: CancelCheck<'a>,
    stopped: Option<StopReason>,
    /// Tests since the calling thread last polled for cancellation.
    tests: u32,
    /// Tests since the last one that measured all sets.
    partial_tests: u32,
    /// True if the last test would have ended the iterations, had it measured all sets.
    must_test_all: bool,
    /// True if the calling thread is to poll for cancellation.
    must_poll: bool,
}

impl<'a> IterationControl<'a> {
    fn new(solver: &'a Solver, cancelled: CancelCheck<'a>) -> Self {
        Self {
            solver,
            cycle: RestartCycle::first(solver),
            outcome: SolveOutcome {
                converged: solver.tolerance.is_none(),
                ..SolveOutcome::default()
            },
            action: NncgAction::Idle,
            batch: None,
            cancelled,
            stopped: None,
            tests: 0,
            partial_tests: 0,
            must_test_all: false,
            must_poll: false,
        }
    }

    /// Iteration after which plain sweeps from the best impulses close the iterations at the maximum.
    fn closing(&self) -> u32 {
        self.solver.max_iterations.saturating_sub(self.solver.convergence_check_interval)
    }

    /// Evaluates the finished batch and returns the next one.
    ///
    /// `None` ends the iterations, unless the batch stays for [`Self::advance`] or the calling thread must poll.
    fn next_batch(&mut self, sets: &Decomposition) -> Option<PassBatch<IterationBatch>> {
        if let Some(batch @ IterationBatch { done, is_tested, .. }) = self.batch {
            self.outcome.iterations = done;
            if is_tested && self.test(sets, &batch) {
                self.batch = None;
                return None;
            }
            self.tests += u32::from(is_tested);
            let is_closing = done >= self.closing();
            if self.cycle.needs_exclusive_access(done, is_tested && !is_closing) {
                return None;
            }
            self.action = if is_closing {
                NncgAction::Idle
            } else {
                self.cycle.nncg_action(sets, done, is_tested)
            };
            if self.tests >= TESTS_BETWEEN_POLLS {
                self.tests = 0;
                self.must_poll = true;
                self.batch = None;
                return None;
            }
        }
        self.batch = (self.outcome.iterations < self.solver.max_iterations).then(|| self.plan());
        self.batch.map(|batch| PassBatch { passes: batch.passes(), plan: batch })
    }

    /// Evaluates a convergence test; returns true if the iterations end with it.
    fn test(&mut self, sets: &Decomposition, batch: &IterationBatch) -> bool {
        let residuals = &mut self.outcome.residuals;
        let norms = sets.visit_norms();
        let relative_dv = norms.relative_dv(sets.gravity_dv);
        *residuals = norms.residuals();
        if batch.maps {
            residuals.natural_map = sets.last_natural_map();
        }
        let is_solved = is_solved(self.solver, residuals, relative_dv);
        if is_solved && batch.tests_all {
            self.outcome.converged = true;
            return true;
        }
        self.partial_tests = if batch.tests_all { 0 } else { self.partial_tests + 1 };
        self.must_test_all = is_solved;
        // Iterations do not recover from NaN.
        if residuals.quad.is_nan() {
            return true;
        }
        let residual = selected_residual(self.solver, residuals);
        self.cycle.observe(self.outcome.iterations, residual, relative_dv);
        if self.solver.skip_converged_subdomains {
            let tolerance = self.solver.tolerance.filter(|_| self.cycle.skips_converged());
            sets.mark_converged_sets(tolerance, &norms);
        }
        self.stopped = (self.cancelled)();
        self.stopped.is_some()
    }

    fn plan(&self) -> IterationBatch {
        let before = self.outcome.iterations;
        let closing = self.closing();
        let test = next_multiple(before, 0, self.solver.convergence_check_interval)
            .min(self.solver.max_iterations);
        let ends = [self.cycle.next_acceleration(before), (before < closing).then_some(closing)];
        let done = ends.into_iter().flatten().fold(test, u32::min);
        let is_tested = done == test;
        let skips_converged = self.cycle.skips_converged() && before < closing;
        let is_due = self.must_test_all || self.partial_tests >= PARTIAL_TESTS;
        IterationBatch {
            action: self.action,
            iterations: done - before,
            done,
            sweep_factor: self.cycle.sweep_factor(),
            relaxation: self.cycle.relaxation(),
            is_tested,
            extrapolates: self.cycle.extrapolates_after(done),
            maps: is_tested && self.solver.norm == Norm::NaturalMap,
            skips_converged,
            tests_all: is_tested && (is_due || !skips_converged),
        }
    }

    /// Does the work between two batches that needs exclusive access to all sets.
    fn advance(&mut self, decomposition: &mut Decomposition, batch: &IterationBatch) {
        if batch.done >= self.closing() {
            self.cycle.restore_best(decomposition);
        } else {
            self.cycle.advance(decomposition, batch.done, batch.is_tested);
        }
        self.action = NncgAction::Idle;
    }
}
