//! Stop rules of the solver in a measurement.

use super::args::StopCriteria;
use ballast::model::{Norm, Solver};
use ballast_session::{Failure, Result};
use std::num::NonZeroU32;

/// Default ratio of the maximum number of iterations at the common tolerance to the fixed number.
const DEFAULT_MAX_ITERATIONS_RATIO: u32 = 4;

/// Condition that ends the iterations of a step.
#[derive(Debug, Clone, Copy)]
pub struct StopRule {
    pub iterations: u32,
    pub tolerance: Option<f64>,
}

impl StopRule {
    /// Returns `solver` with a fixed number of iterations, or unchanged for `None`.
    pub fn fixed(iterations: Option<NonZeroU32>, solver: Solver) -> Solver {
        iterations.map_or(solver, |k| Self { iterations: k.get(), tolerance: None }.apply(solver))
    }

    /// Returns `solver` with this rule.
    pub fn apply(&self, solver: Solver) -> Solver {
        let Self { iterations, tolerance } = *self;
        let norm = if tolerance.is_some() { Norm::Qm16 } else { solver.norm };
        Solver { max_iterations: iterations, tolerance, norm, ..solver }
    }

    /// Returns the rule of a solver.
    pub fn of_solver(solver: &Solver) -> Self {
        Self { iterations: solver.max_iterations, tolerance: solver.tolerance }
    }

    pub fn name(&self) -> String {
        match self.tolerance {
            None => format!("{} iterations", self.iterations),
            Some(t) => format!("QM/16 below {t:e}; at most {} iterations", self.iterations),
        }
    }
}

/// Checks that `number` is a tolerance.
///
/// # Errors
/// A number that is not above 0 and below 1.
pub fn check_tolerance(number: f64) -> Result {
    if number > 0.0 && number < 1.0 {
        return Ok(());
    }
    let text = format!("--tolerance {number}: expected a number above 0 and below 1");
    Err(Failure::Usage(text))
}

impl StopCriteria {
    /// Checks the tolerance.
    pub fn check(&self) -> Result {
        check_tolerance(self.tolerance)
    }

    /// Returns the rules with fixed iterations and with a common residual, for the solver of a case.
    pub fn rules(&self, solver: &Solver) -> [StopRule; 2] {
        let iterations = self.iterations.map_or(solver.max_iterations, u32::from);
        let cap = self
            .max_iterations
            .map_or(iterations.saturating_mul(DEFAULT_MAX_ITERATIONS_RATIO), u32::from);
        let common = StopRule { iterations: cap, tolerance: Some(self.tolerance) };
        [StopRule { iterations, tolerance: None }, common]
    }
}
