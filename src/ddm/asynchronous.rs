//! Asynchronous schedule: one parallel loop over subdomains and interface groups with the newest velocities, in no
//! order (HSDA, version 3, without its lost updates).
//!
//! Reads and writes: the sets, through the parts of [`super::boundary`]. Cost: visits, and one barrier per run.
//! Contract: however visits overlap, linear momentum is exact to rounding, and the result is a Gauss-Seidel state
//! whose residuals were measured at rest.
//!
//! Work is handed out as tickets: ticket `k` is the `k / sets`-th visit of a set. The order is that of the synchronous
//! schedule, so threads at equal speed hardly ever meet at a body, and one thread is deterministic. One thread at a
//! time sweeps a set. No set can be more than about one iteration behind, because the thread that draws its next ticket
//! waits for it.
//!
//! The residuals of a run are not reliable. Norms of overlapping visits are taken at different times, against
//! velocities that other visits change meanwhile, and sets that answer the same approach at once answer it twice. So
//! each run ends with one pass of the synchronous schedule, which decides whether the step is solved. If it is not,
//! another run follows.

use super::decomposition::{Decomposition, SetReport};
use super::iteration::{
    AdaptiveRelaxation, CancelCheck, SolveOutcome, is_solved, selected_residual,
};
use super::sweep_scheduler::on_threads;
use super::sweep_set::{SweepSet, lock};
use super::synchronous;
use crate::cancel::StopReason;
use crate::error::{Error, Result};
use crate::model::{Acceleration, Norm, Solver};
use crate::nlgs::VisitNorms;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Growth of a velocity change over the first test's largest velocity or change that counts as divergence.
///
/// Converging iterations pass a shock on, but do not raise it.
const DIVERGENCE_GROWTH: f64 = 1e2;

/// Maximum number of closing synchronous iterations of an unsolved step.
const MAX_CLOSING_ITERATIONS: u32 = 10;
/// Ratio of the maximum number of iterations to the number of closing ones.
const CLOSING_DIVISOR: u32 = 10;

/// Asynchronous iterations without a common stop, and the data that their threads share.
struct AsynchronousRun<'a> {
    decomposition: &'a Decomposition,
    solver: &'a Solver,
    tickets: AtomicU64,
    stop: AtomicBool,
    /// Relaxation factor of the next visits, as bits.
    relaxation: AtomicU64,
    tests: Mutex<ConvergenceTests<'a>>,
}

/// Convergence tests of a run. A test is evaluated when every set has reported its norms.
struct ConvergenceTests<'a> {
    reports: Vec<SetReport>,
    /// Visits of a set after which the next test is due.
    due: u32,
    /// Number of sets that have not reported the next test.
    missing: usize,
    /// Square of the largest velocity or velocity change at the first test, (m/s)².
    scale: Option<f64>,
    relaxation: AdaptiveRelaxation,
    diverged: bool,
    cancelled: CancelCheck<'a>,
    stopped: Option<StopReason>,
}

/// End of asynchronous iterations.
#[derive(Debug)]
pub(super) enum AsynchronousOutcome {
    /// The tolerance or the maximum number of iterations was reached.
    Solved(SolveOutcome),
    /// The iterations diverged; counts of the iterations and visits made.
    Diverged(SolveOutcome),
}

/// Iterates until the tolerance or the maximum number of iterations is reached, or the iterations diverge.
///
/// # Errors
/// [`Error::Stopped`] when `cancelled` returns a reason.
pub(super) fn iterate(
    decomposition: &mut Decomposition,
    solver: &Solver,
    cancelled: CancelCheck,
) -> Result<AsynchronousOutcome> {
    iterate_with(decomposition, solver, cancelled, |run| {
        let threads = rayon::current_num_threads().min(run.decomposition.subdomains.len());
        on_threads(threads, &|| while run.visit_next() {});
    })
}

/// Implements [`iterate`] with `work` to make the visits of a run.
fn iterate_with(
    decomposition: &mut Decomposition,
    solver: &Solver,
    cancelled: CancelCheck,
    work: impl Fn(&AsynchronousRun),
) -> Result<AsynchronousOutcome> {
    let mut solver = *solver;
    let mut outcome = SolveOutcome::default();
    let mut relaxation = AdaptiveRelaxation::new(&solver);
    loop {
        let before = outcome;
        let closing = MAX_CLOSING_ITERATIONS.min(solver.max_iterations.div_ceil(CLOSING_DIVISOR));
        let free =
            Solver { max_iterations: solver.max_iterations.saturating_sub(closing), ..solver };
        decomposition.split_velocities();
        let reports = std::mem::take(&mut decomposition.reports);
        let run =
            AsynchronousRun::new(decomposition, &free, relaxation.restarted(), reports, cancelled);
        work(&run);
        let tests = run.tests.into_inner().unwrap_or_else(PoisonError::into_inner);
        let ConvergenceTests { reports, relaxation: reached, diverged, stopped, .. } = tests;
        decomposition.reports = reports;
        if let Some(reason) = stopped {
            return Err(Error::Stopped(reason));
        }
        if diverged {
            return Ok(AsynchronousOutcome::Diverged(SolveOutcome {
                iterations: before.iterations + decomposition.begun_iterations(),
                visits: decomposition.visits(),
                ..before
            }));
        }
        relaxation = reached;
        let iterations = decomposition.begun_iterations();
        decomposition.join_velocities();
        solver.relaxation = relaxation.relaxation;
        let passes = if iterations < free.max_iterations { 1 } else { closing };
        let closing = Solver { max_iterations: passes, acceleration: Acceleration::None, ..solver };
        outcome = synchronous::iterate(decomposition, &closing, cancelled)?;
        solver.max_iterations -= (iterations + outcome.iterations).min(solver.max_iterations);
        outcome.iterations += before.iterations + iterations;
        if outcome.converged || solver.max_iterations == 0 {
            return Ok(AsynchronousOutcome::Solved(outcome));
        }
    }
}

impl<'a> AsynchronousRun<'a> {
    fn new(
        decomposition: &'a Decomposition,
        solver: &'a Solver,
        relaxation: AdaptiveRelaxation,
        mut reports: Vec<SetReport>,
        cancelled: CancelCheck<'a>,
    ) -> Self {
        let sets = decomposition.set_count();
        reports.clear();
        reports.resize(sets, SetReport::default());
        Self {
            decomposition,
            solver,
            tickets: AtomicU64::new(0),
            stop: AtomicBool::new(false),
            relaxation: AtomicU64::new(relaxation.relaxation.to_bits()),
            tests: Mutex::new(ConvergenceTests {
                reports,
                due: solver.convergence_check_interval,
                missing: sets,
                scale: None,
                relaxation,
                diverged: false,
                cancelled,
                stopped: None,
            }),
        }
    }

    /// Makes the next visit; returns false at the maximum number of iterations or after a stop.
    fn visit_next(&self) -> bool {
        let Some(s) = self.draw() else { return false };
        self.decomposition.with_set(s, |set| {
            self.begin_visit(set);
            self.end_visit(s, set);
        });
        true
    }

    /// Draws the set to visit next. A thread that draws a set must visit it.
    fn draw(&self) -> Option<usize> {
        if self.stop.load(Ordering::Relaxed) {
            return None;
        }
        let ticket = self.tickets.fetch_add(1, Ordering::Relaxed);
        let sets = self.decomposition.set_count() as u64;
        (ticket / sets < u64::from(self.solver.max_iterations))
            .then(|| self.decomposition.set_in_order((ticket % sets) as usize))
    }

    /// Gathers the newest velocities of `set`.
    fn begin_visit(&self, set: &mut SweepSet) {
        self.decomposition.boundary.gather(set);
    }

    /// Sweeps `set`, number `s`, at the velocities of [`Self::begin_visit`] and publishes the result.
    fn end_visit(&self, s: usize, set: &mut SweepSet) {
        set.visits += 1;
        let measured = set.visits.is_multiple_of(self.solver.convergence_check_interval);
        let relaxation = f64::from_bits(self.relaxation.load(Ordering::Relaxed));
        let sweeps = self.decomposition.sweeps_per_iteration(s, self.solver);
        set.sweeps(sweeps, relaxation, measured);
        self.decomposition.boundary.publish(set);
        if measured {
            self.report(s, set);
        }
    }

    /// Stores the norms of a measured visit, and evaluates the test that is due if they were the last ones missing.
    fn report(&self, s: usize, set: &SweepSet) {
        let mut tests = lock(&self.tests);
        let last = std::mem::replace(&mut tests.reports[s], (set.visits, set.norms)).0;
        tests.missing -= usize::from(last < tests.due);
        if tests.missing > 0 {
            return;
        }
        let tested = tests.due;
        tests.due += self.solver.convergence_check_interval;
        tests.missing = tests.reports.iter().filter(|report| report.0 < tests.due).count();
        let mut sum = VisitNorms::default();
        tests.reports.iter().for_each(|report| sum += report.1);
        let change = sum.max_dv_squared;
        let scale = *tests.scale.get_or_insert(change.max(sum.speed_squared));
        let finite = (sum.dv_squared + sum.wr_squared).is_finite();
        tests.diverged |= !finite || change > DIVERGENCE_GROWTH * DIVERGENCE_GROWTH * scale;
        let residuals = sum.residuals();
        let relative_dv = sum.relative_dv(self.decomposition.gravity_dv);
        // The natural map needs a state at rest: until then the norms of the visits decide.
        let norm = if self.solver.norm == Norm::NaturalMap { Norm::Qm16 } else { self.solver.norm };
        let solver = Solver { norm, ..*self.solver };
        tests.relaxation.observe(tested, selected_residual(&solver, &residuals), relative_dv);
        self.relaxation.store(tests.relaxation.relaxation.to_bits(), Ordering::Relaxed);
        tests.stopped = tests.stopped.or_else(|| (tests.cancelled)());
        if tests.stopped.is_some() || tests.diverged || is_solved(&solver, &residuals, relative_dv)
        {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests;
