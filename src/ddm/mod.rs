//! Domain decomposition, primal: subdomains and interface are swept in turn (T-12).
//!
//! Orders sweeps; computes no contact. Reads: partition, local problem. Writes: the decomposition's
//! velocity lines and impulses. Cost: visits. Contract: sequential and synchronous schedules give
//! the same bytes for any number of threads; with one subdomain all three schedules do.

mod asynchronous;
mod decomposition;
mod synchronous;

use crate::model::{Norm, Schedule, Solver};
use crate::nlgs::Residuals;

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
    /// Whether the iterations diverged and were repeated with under-relaxation.
    pub guarded: bool,
}

/// Relaxation with which iterations that diverged are repeated: half steps turn a block-Jacobi
/// splitting of two blocks, the worst that reading old values can amount to, into a convergent one.
const GUARD_RELAXATION: f64 = 0.5;

/// Iterates the decomposed problem in the order that `solver` asks for.
pub fn solve(decomposition: &mut Decomposition, solver: &Solver) -> Outcome {
    if solver.schedule != Schedule::Asynchronous {
        return synchronous::iterate(decomposition, solver);
    }
    let start = decomposition.save();
    let outcome = asynchronous::iterate(decomposition, solver);
    if let Some(outcome) = outcome {
        return outcome;
    }
    decomposition.load(&start);
    let relaxed = Solver { relaxation: GUARD_RELAXATION * solver.relaxation.min(1.0), ..*solver };
    let mut outcome = asynchronous::iterate(decomposition, &relaxed).unwrap_or_else(|| {
        decomposition.load(&start);
        synchronous::iterate(decomposition, &relaxed)
    });
    outcome.guarded = true;
    outcome
}

/// Whether iteration `done` (counted from 1) ends with a convergence test.
fn is_test(solver: &Solver, done: u32) -> bool {
    done.is_multiple_of(solver.check_every.max(1)) || done == solver.iterations
}

/// Whether `residuals` are below the tolerance asked for.
fn is_solved(solver: &Solver, residuals: &Residuals) -> bool {
    let value = match solver.norm {
        Norm::Qm16 => residuals.qm16(),
        Norm::Quad => residuals.quad,
        Norm::NaturalMap => residuals.natural_map,
    };
    solver.tolerance.is_some_and(|tolerance| value < tolerance)
}

#[cfg(test)]
mod tests;
