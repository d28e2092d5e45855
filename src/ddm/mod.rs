//! Domain decomposition, primal: subdomains and interface are swept in turn (T-12).
//!
//! Orders sweeps; computes no contact. Reads: partition, local problem. Writes: the decomposition's
//! velocity lines and impulses. Cost: visits. Contract: sequential and synchronous schedules give
//! the same bytes for any number of threads; with one subdomain all three schedules do.

mod acceleration;
mod asynchronous;
mod boundary;
mod decomposition;
mod momentum;
mod round;
mod synchronous;
mod turns;

use crate::cancel::StopReason;
#[cfg(doc)]
use crate::error::Error;
use crate::error::Result;
use crate::local_problem::LocalProblem;
use crate::model::{Norm, Schedule, Solver};
use crate::nlgs::Residuals;
use asynchronous::Iterated;

pub use decomposition::Decomposition;

/// How the iterations went.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Outcome {
    /// DDM iterations done.
    pub iterations: u32,
    /// Contact visits over all sweeps.
    pub visits: u64,
    pub residuals: Residuals,
    /// Whether the tolerance was reached, or none was asked for.
    pub converged: bool,
    /// Whether the iterations diverged and were repeated by the synchronous schedule.
    pub sync_fallback: bool,
}

/// Asked after each test whether the step is to be broken off.
pub type Ask<'a> = &'a mut (dyn FnMut() -> Option<StopReason> + Send);

/// Iterates `problem`, which was packed into `decomposition`, in the order that `solver` asks for.
///
/// # Errors
/// [`Error::Stopped`] when `ask` says so.
pub fn solve(
    decomposition: &mut Decomposition,
    problem: &LocalProblem,
    solver: &Solver,
    ask: Ask,
) -> Result<Outcome> {
    decomposition.apply_impulses();
    // One set has nobody to wait for.
    if solver.schedule != Schedule::Asynchronous || decomposition.sets() == 1 {
        return synchronous::iterate(decomposition, solver, ask);
    }
    let lost = match asynchronous::iterate(decomposition, solver, ask)? {
        Iterated::Sound(outcome) => return Ok(outcome),
        Iterated::Diverged(lost) => lost,
    };
    decomposition.pack(problem);
    decomposition.apply_impulses();
    let relaxed = Solver { relaxation: solver.relaxation.min(1.0), ..*solver };
    let outcome = synchronous::iterate(decomposition, &relaxed, ask)?;
    let (iterations, visits) = (outcome.iterations + lost.iterations, outcome.visits + lost.visits);
    Ok(Outcome { sync_fallback: true, iterations, visits, ..outcome })
}

/// The first iteration after `done` that is a multiple of `period` after iteration `began`.
fn next_after(done: u32, began: u32, period: u32) -> u32 {
    done.saturating_add(period - (done - began) % period)
}

/// The residual that decides.
fn deciding(solver: &Solver, residuals: &Residuals) -> f64 {
    match solver.norm {
        Norm::Qm16 => residuals.qm16(),
        Norm::Quad => residuals.quad,
        Norm::NaturalMap => residuals.natural_map,
    }
}

/// Whether `residuals` are below the tolerance asked for, and nothing is being flung: `fling` is not above one (T-11).
fn is_solved(solver: &Solver, residuals: &Residuals, fling: f64) -> bool {
    let value = deciding(solver, residuals);
    solver.tolerance.is_some_and(|tolerance| value < tolerance) && fling <= 1.0
}

/// Does `work` on so many threads at once, as far as they are free; it finds out itself what is left to do.
fn on_threads(threads: usize, work: &(impl Fn() + Sync)) {
    match threads {
        0 => {}
        1 => work(),
        _ => {
            let half = threads / 2;
            rayon::join(|| on_threads(half, work), || on_threads(threads - half, work));
        }
    }
}

/// Softens visits when sweeps go round in circles. Who asks for no tolerance but for a number of iterations gets plain ones.
///
/// With friction as high as that of ballast, full Gauss-Seidel steps can cycle for ever between
/// states of some contacts that slip and stick by turns. Smaller steps break some of the circles; they are
/// taken only when the residual has stopped falling, because they are slower otherwise.
#[derive(Debug, Clone, Copy)]
struct Softening {
    relaxation: f64,
    tolerance: Option<f64>,
    best: f64,
    /// Iteration of the last softening or good progress.
    since: u32,
    /// Times that the residual did not get on.
    stalls: u32,
}

impl Softening {
    /// Iterations without progress that count as a stall.
    const PATIENCE: u32 = 200;
    /// A residual that has fallen by this factor is progress.
    const PROGRESS: f64 = 0.7;
    const FACTOR: f64 = 0.8;
    /// Stalls that are answered by smaller steps.
    const MOST: u32 = 3;

    fn new(solver: &Solver) -> Self {
        let Solver { relaxation, tolerance, .. } = *solver;
        Self { relaxation, tolerance, best: f64::INFINITY, since: 0, stalls: 0 }
    }

    /// Takes note of the residual after iteration `done`, and of what is still flung, which is as large as the tolerance at
    /// its limit: the larger is what iterations have to bring down.
    fn observe(&mut self, done: u32, residual: f64, fling: f64) {
        let Some(tolerance) = self.tolerance else { return };
        let left = residual.max(tolerance * fling);
        if left < Self::PROGRESS * self.best {
            self.best = left;
            self.since = done;
        } else if done - self.since >= Self::PATIENCE {
            if self.stalls < Self::MOST {
                self.stalls += 1;
                self.relaxation *= Self::FACTOR;
            }
            self.since = done;
        }
    }

    /// The same steps, and so many stalls behind it, for iterations that begin again.
    fn anew(self) -> Self {
        Self { best: f64::INFINITY, since: 0, ..self }
    }

    /// Whether smaller steps have not helped.
    fn is_spent(&self) -> bool {
        self.stalls >= Self::MOST
    }
}

#[cfg(test)]
mod tests;
