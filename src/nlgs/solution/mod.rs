//! Solving an assembled friction-contact problem to a tolerance (T-31).
//!
//! Reads: [`AssembledProblem`]. Writes: impulses and how they were found. Cost: sweeps, tests that cost an
//! eighth of them at most, and, where sweeps do not get on, dense systems of linear equations whose
//! work is kept about equal to that of the sweeps. Contract: the best impulses that any test saw come
//! back, with the errors of the whole problem; the same problem gives the same bytes.

mod newton;
mod search;

use super::assembled_problem::{AssembledProblem, NaturalMapErrors};
use crate::math::Vec3;
use search::Search;

/// How a problem is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Sweeps; when they do not get on, accelerated sweeps and Newton's method in turns.
    Auto,
    /// Non-linear Gauss-Seidel alone (T-17).
    Nlgs,
    /// Non-linear Gauss-Seidel with Anderson's acceleration (T-32).
    Anderson,
    /// A few sweeps and Newton's method (T-33) in turns.
    Newton,
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolutionSettings {
    pub method: Method,
    /// Upper bound of the error of Acary, Brémond and Huber, [`NaturalMapErrors::abh`].
    pub tolerance: f64,
    /// Most sweeps over all contacts; Newton's method stops with them.
    pub max_sweeps: u64,
}

/// Impulses, and how they were found.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// (n, t, s) `[nc]`, N s.
    pub impulse: Vec<Vec3>,
    pub errors: NaturalMapErrors,
    pub converged: bool,
    /// Sweeps over all contacts.
    pub sweeps: u64,
    /// Systems of linear equations that were solved.
    pub newton_steps: u64,
}

/// Sweeps without acceleration at the start: easy problems are solved by then, and hard ones know
/// most of their open contacts.
const PLAIN_SWEEPS: u64 = 50;
/// Fewest accelerated sweeps between two calls of Newton's method.
const FEWEST_BETWEEN: u64 = 100;

/// Solves a problem, starting from the impulses `start` `[nc]`, or from none.
pub fn solve(
    problem: &AssembledProblem,
    start: Option<&[Vec3]>,
    settings: &SolutionSettings,
) -> Solution {
    let nothing = vec![Vec3::zeros(); problem.contact_count()];
    let impulse = start.map_or(nothing, <[Vec3]>::to_vec);
    let mut search = Search::new(problem, impulse, settings);
    match settings.method {
        Method::Nlgs => search.sweep(settings.max_sweeps),
        Method::Anderson => {
            search.sweep(PLAIN_SWEEPS);
            search.sweep_accelerated(settings.max_sweeps);
        }
        Method::Newton => in_turns(&mut search, |search, round| {
            search.sweep((10 + 10 * u64::from(round)).min(1000));
        }),
        Method::Auto => {
            search.sweep(PLAIN_SWEEPS);
            in_turns(&mut search, |search, _| {
                let count = search.sweeps_owed().max(FEWEST_BETWEEN);
                search.sweep_accelerated(count);
            });
        }
    }
    search.end()
}

/// Sweeps and Newton's method in turns, until the problem is solved or the sweeps are spent.
fn in_turns(search: &mut Search, mut sweep: impl FnMut(&mut Search, u32)) {
    for round in 0.. {
        sweep(search, round);
        if search.is_over() {
            return;
        }
        search.newton();
    }
}

#[cfg(test)]
mod tests;
