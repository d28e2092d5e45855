//! Solution of an assembled friction-contact problem to a tolerance (T-31).
//!
//! Reads: [`AssembledProblem`]. Writes: impulses and the work done. Cost: sweeps, tests that cost at most an eighth of
//! them and, where sweeps stagnate, dense linear systems whose work is kept about equal to that of the sweeps.
//! Contract: returns the best impulses that any test saw, with the errors of the whole problem; the same problem gives
//! the same bytes.

mod hybrid_solver;
mod newton;
mod settings;

use super::assembled_problem::AssembledProblem;
use crate::math::Vec3;
use hybrid_solver::HybridSolver;

pub use settings::{Method, Solution, SolutionSettings};

/// Plain sweeps at the start: they solve easy problems and find most open contacts of hard ones.
const PLAIN_SWEEPS: u64 = 50;
/// Minimum number of accelerated sweeps between two calls of Newton's method.
const MIN_SWEEPS_BETWEEN_NEWTON: u64 = 100;

/// Solves a problem from the impulses `start` `[nc]`, or from zero.
pub fn solve(
    problem: &AssembledProblem,
    start: Option<&[Vec3]>,
    settings: &SolutionSettings,
) -> Solution {
    let zero = vec![Vec3::zeros(); problem.contact_count()];
    let impulse = start.map_or(zero, <[Vec3]>::to_vec);
    let mut solver = HybridSolver::new(problem, impulse, settings);
    match settings.method {
        Method::Nlgs => solver.sweep(settings.max_sweeps),
        Method::Anderson => {
            solver.sweep(PLAIN_SWEEPS);
            solver.sweep_accelerated(settings.max_sweeps);
        }
        Method::Newton => alternate(&mut solver, |solver, round| {
            solver.sweep((10 + 10 * u64::from(round)).min(1000));
        }),
        Method::Auto => {
            solver.sweep(PLAIN_SWEEPS);
            alternate(&mut solver, |solver, _| {
                let count = solver.balancing_sweeps().max(MIN_SWEEPS_BETWEEN_NEWTON);
                solver.sweep_accelerated(count);
            });
        }
    }
    solver.finish()
}

/// Alternates sweeps and Newton's method until the problem is solved or no sweeps are left.
fn alternate(solver: &mut HybridSolver, mut sweep: impl FnMut(&mut HybridSolver, u32)) {
    for round in 0.. {
        sweep(solver, round);
        if solver.is_finished() {
            return;
        }
        solver.newton();
    }
}

#[cfg(test)]
mod tests;
