//! Solving an assembled friction-contact problem to a tolerance.
//!
//! Reads: [`Assembled`]. Writes: impulses and how they were found. Cost: sweeps, and tests that cost
//! about a sweep each. Contract: the best impulses that a test has seen come back, and their errors are those of the
//! whole problem, computed once more; the same problem gives the same bytes.

mod sweeps;

use super::reference::{Assembled, NaturalMapErrors};
use crate::math::Vec3;

/// How a problem is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Sweeps; another method when they do not get on.
    Auto,
    /// Non-linear Gauss-Seidel alone.
    Nlgs,
}

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    pub method: Method,
    /// Upper bound of the error of Acary, Brémond and Huber, [`NaturalMapErrors::abh`].
    pub tolerance: f64,
    /// Most sweeps over all contacts.
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

/// Solves a problem, starting from the impulses `start` `[nc]`, or from none.
pub fn solve(problem: &Assembled, start: Option<&[Vec3]>, settings: &Settings) -> Solution {
    let nothing = vec![Vec3::zeros(); problem.contact_count()];
    let impulse = start.map_or(nothing, <[Vec3]>::to_vec);
    let mut search = sweeps::Search::new(problem, impulse, settings);
    search.sweeps();
    search.end()
}
