//! Choice of the iteration schedule, and the synchronous fallback of diverged asynchronous iterations.

use super::asynchronous::{self, AsynchronousOutcome};
use super::decomposition::Decomposition;
use super::iteration::{CancelCheck, SolveOutcome};
use super::synchronous;
#[cfg(doc)]
use crate::error::Error;
use crate::error::Result;
use crate::local_problem::LocalProblem;
use crate::model::{Schedule, Solver};

/// Solves `problem`, which was packed into `decomposition`, by the schedule of `solver`.
///
/// # Errors
/// [`Error::Stopped`] when `cancelled` returns a reason.
pub fn solve(
    decomposition: &mut Decomposition,
    problem: &LocalProblem,
    solver: &Solver,
    cancelled: CancelCheck,
) -> Result<SolveOutcome> {
    decomposition.apply_impulses();
    // One set has no other set to wait for.
    if solver.schedule != Schedule::Asynchronous || decomposition.set_count() == 1 {
        return synchronous::iterate(decomposition, solver, cancelled);
    }
    let diverged = match asynchronous::iterate(decomposition, solver, cancelled)? {
        AsynchronousOutcome::Solved(outcome) => return Ok(outcome),
        AsynchronousOutcome::Diverged(outcome) => outcome,
    };
    decomposition.pack(problem);
    decomposition.apply_impulses();
    let relaxed = Solver { relaxation: solver.relaxation.min(1.0), ..*solver };
    let outcome = synchronous::iterate(decomposition, &relaxed, cancelled)?;
    Ok(SolveOutcome {
        sync_fallback: true,
        iterations: outcome.iterations + diverged.iterations,
        visits: outcome.visits + diverged.visits,
        ..outcome
    })
}
