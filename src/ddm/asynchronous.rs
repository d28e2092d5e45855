//! In no order: subdomains and interface groups are swept in one parallel loop with the newest
//! values at hand (HSDA, version 3, without its lost updates).
//!
//! Reads and writes: the sets, through the parts of [`super::boundary`]. Cost: visits, and one
//! barrier per run. Contract: however visits overlap, momentum is exact to rounding and the result
//! is a Gauss-Seidel state whose residuals were measured at rest.
//!
//! Work is handed out as tickets: ticket `k` is the `k / sets`-th visit of a set. The order is that
//! of the synchronous schedule, so threads in step with each other hardly ever meet at a grain, and
//! one thread is deterministic. A set is swept by one thread at a time; no set can be more than
//! about one iteration behind, for whoever draws its next ticket waits for it.
//!
//! What a free run says of itself is not to be trusted: norms of overlapping visits are taken at
//! different times, against velocities that others change meanwhile, and sets that answer the same
//! approach at once leave it answered twice. So each run ends with one pass of the synchronous
//! schedule, which decides whether the step is solved; if not, the next run goes on from there.

use super::decomposition::{Set, enter};
use super::{Ask, Decomposition, Outcome, Softening, deciding, is_solved, on_threads, synchronous};
use crate::cancel::StopReason;
use crate::error::{Error, Result};
use crate::model::{Acceleration, Norm, Solver};
use crate::nlgs::VisitNorms;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Iterations diverge when a visit changes velocities this many times more than the first test saw
/// anything change or move. Sound ones pass a shock on, but do not raise it.
const GROWTH: f64 = 1e2;

/// Synchronous iterations at the end of a step that is not solved: at most this many, and this share of
/// the cap.
const CLOSING: (u32, u32) = (10, 10);

/// Iterations without a common stop, and what their threads share.
struct Run<'a> {
    decomposition: &'a Decomposition,
    solver: &'a Solver,
    tickets: AtomicU64,
    stop: AtomicBool,
    /// Of the visits to come, as bits.
    relaxation: AtomicU64,
    tests: Mutex<Tests<'a>>,
}

/// A set's newest norms, and after which of its visits they were taken.
pub(super) type Report = (u32, VisitNorms);

/// Convergence tests of a run. A test is judged when every set has reported it.
struct Tests<'a> {
    reports: Vec<Report>,
    /// Visits after which the next test is due, and sets that have not reported it.
    due: u32,
    missing: usize,
    /// Square of the largest velocity or change of velocity at the first test, (m/s)².
    scale: Option<f64>,
    softening: Softening,
    diverged: bool,
    ask: Ask<'a>,
    stopped: Option<StopReason>,
}

/// How iterations ended.
#[derive(Debug)]
pub(super) enum Iterated {
    /// The tolerance or the cap was reached.
    Sound(Outcome),
    /// What they have cost.
    Diverged(Outcome),
}

/// Iterates until the tolerance or the cap is reached, or the iterations diverge.
///
/// # Errors
/// [`Error::Stopped`] when `ask` says so.
pub(super) fn iterate(
    decomposition: &mut Decomposition,
    solver: &Solver,
    ask: Ask,
) -> Result<Iterated> {
    iterate_with(decomposition, solver, ask, |run| {
        let threads = rayon::current_num_threads().min(run.decomposition.subdomains.len());
        on_threads(threads, &|| while run.visit_next() {});
    })
}

/// [`iterate`] with `work` to make the visits of a run.
fn iterate_with(
    decomposition: &mut Decomposition,
    solver: &Solver,
    ask: Ask,
    work: impl Fn(&Run),
) -> Result<Iterated> {
    let mut solver = *solver;
    let mut outcome = Outcome::default();
    let mut softening = Softening::new(&solver);
    loop {
        let before = outcome;
        let closing = CLOSING.0.min(solver.max_iterations.div_ceil(CLOSING.1));
        let free =
            Solver { max_iterations: solver.max_iterations.saturating_sub(closing), ..solver };
        decomposition.split();
        let reports = std::mem::take(&mut decomposition.reports);
        let run = Run::new(decomposition, &free, softening.anew(), reports, ask);
        work(&run);
        let tests = run.tests.into_inner().unwrap_or_else(PoisonError::into_inner);
        let Tests { reports, softening: softened, diverged, stopped, .. } = tests;
        decomposition.reports = reports;
        if let Some(stop) = stopped {
            return Err(Error::Stopped(stop));
        }
        if diverged {
            let iterations = before.iterations + decomposition.begun();
            let visits = decomposition.visits();
            return Ok(Iterated::Diverged(Outcome { iterations, visits, ..before }));
        }
        softening = softened;
        let iterations = decomposition.begun();
        decomposition.settle();
        solver.relaxation = softening.relaxation;
        let pass = if iterations < free.max_iterations { 1 } else { closing };
        let closing = Solver { max_iterations: pass, acceleration: Acceleration::None, ..solver };
        outcome = synchronous::iterate(decomposition, &closing, ask)?;
        solver.max_iterations -= (iterations + outcome.iterations).min(solver.max_iterations);
        outcome.iterations += before.iterations + iterations;
        if outcome.converged || solver.max_iterations == 0 {
            return Ok(Iterated::Sound(outcome));
        }
    }
}

impl<'a> Run<'a> {
    fn new(
        decomposition: &'a Decomposition,
        solver: &'a Solver,
        softening: Softening,
        mut reports: Vec<Report>,
        ask: Ask<'a>,
    ) -> Self {
        let sets = decomposition.sets();
        reports.clear();
        reports.resize(sets, Report::default());
        Self {
            decomposition,
            solver,
            tickets: AtomicU64::new(0),
            stop: AtomicBool::new(false),
            relaxation: AtomicU64::new(softening.relaxation.to_bits()),
            tests: Mutex::new(Tests {
                reports,
                due: solver.convergence_check_interval,
                missing: sets,
                scale: None,
                softening,
                diverged: false,
                ask,
                stopped: None,
            }),
        }
    }

    /// Makes the next visit; `false` at the cap or after a stop.
    fn visit_next(&self) -> bool {
        let Some(s) = self.draw() else { return false };
        self.decomposition.with_set(s, |set| {
            self.begin(set);
            self.end(s, set);
        });
        true
    }

    /// The set to visit next. Whoever draws must visit.
    fn draw(&self) -> Option<usize> {
        if self.stop.load(Ordering::Relaxed) {
            return None;
        }
        let ticket = self.tickets.fetch_add(1, Ordering::Relaxed);
        let sets = self.decomposition.sets() as u64;
        (ticket / sets < u64::from(self.solver.max_iterations))
            .then(|| self.decomposition.in_order((ticket % sets) as usize))
    }

    fn begin(&self, set: &mut Set) {
        self.decomposition.boundary.gather(set);
    }

    /// Sweeps `set`, number `s`, at the velocities that [`Self::begin`] found.
    fn end(&self, s: usize, set: &mut Set) {
        set.visits += 1;
        let measured = set.visits.is_multiple_of(self.solver.convergence_check_interval);
        let relaxation = f64::from_bits(self.relaxation.load(Ordering::Relaxed));
        set.sweeps(self.decomposition.sweeps(s, self.solver), relaxation, measured);
        self.decomposition.boundary.publish(set);
        if measured {
            self.report(s, set);
        }
    }

    /// Takes the norms of a measured visit, and judges the test that is due if it was the last.
    fn report(&self, s: usize, set: &Set) {
        let mut tests = enter(&self.tests);
        let last = std::mem::replace(&mut tests.reports[s], (set.visits, set.norms)).0;
        tests.missing -= usize::from(last < tests.due);
        if tests.missing > 0 {
            return;
        }
        let judged = tests.due;
        tests.due += self.solver.convergence_check_interval;
        tests.missing = tests.reports.iter().filter(|report| report.0 < tests.due).count();
        let mut sum = VisitNorms::default();
        tests.reports.iter().for_each(|report| sum += report.1);
        let change = sum.max_dv_squared;
        let scale = *tests.scale.get_or_insert(change.max(sum.speed_squared));
        let finite = (sum.dv_squared + sum.wr_squared).is_finite();
        tests.diverged |= !finite || change > GROWTH * GROWTH * scale;
        let residuals = sum.residuals();
        let fling = sum.fling(self.decomposition.fall);
        // The natural map needs a state at rest: until then the norms of the visits decide.
        let norm = if self.solver.norm == Norm::NaturalMap { Norm::Qm16 } else { self.solver.norm };
        let solver = Solver { norm, ..*self.solver };
        tests.softening.observe(judged, deciding(&solver, &residuals), fling);
        self.relaxation.store(tests.softening.relaxation.to_bits(), Ordering::Relaxed);
        tests.stopped = tests.stopped.or_else(|| (tests.ask)());
        if tests.stopped.is_some() || tests.diverged || is_solved(&solver, &residuals, fling) {
            self.stop.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests;
