//! Settings and result of the solution of an assembled problem.

use crate::math::Vec3;
use crate::nlgs::assembled_problem::NaturalMapErrors;

/// Method that solves a problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Method {
    /// Sweeps; if they stagnate, accelerated sweeps alternate with Newton's method.
    Auto,
    /// Non-linear Gauss-Seidel alone (T-17).
    Nlgs,
    /// Non-linear Gauss-Seidel with Anderson acceleration (T-32).
    Anderson,
    /// A few sweeps alternating with Newton's method (T-33).
    Newton,
}

/// Method and stopping rule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolutionSettings {
    /// Method that solves the problem.
    pub method: Method,
    /// Upper bound of the error of Acary, Brémond and Huber, [`NaturalMapErrors::abh`].
    pub tolerance: f64,
    /// Maximum number of sweeps over all contacts, which ends Newton's method as well.
    pub max_sweeps: u64,
}

/// Impulses with their errors and the work done.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// Impulses (n, t, s) `[nc]`, N s.
    pub impulse: Vec<Vec3>,
    /// Errors of the impulses.
    pub errors: NaturalMapErrors,
    /// True if the tolerance was reached.
    pub converged: bool,
    /// Number of sweeps over all contacts.
    pub sweeps: u64,
    /// Number of linear systems solved.
    pub newton_steps: u64,
}
