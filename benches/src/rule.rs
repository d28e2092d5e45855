//! When the steps of a measurement are done.

use super::args::Ends;
use ballast::model::{Norm, Solver};
use ballast_session::{Failure, Outcome};
use std::num::NonZeroU32;

/// Iterations at the common tolerance, over the fixed ones, where nothing is said.
const CAP: u32 = 4;

/// When a step is done.
#[derive(Debug, Clone, Copy)]
pub struct Rule {
    pub iterations: u32,
    pub tolerance: Option<f64>,
}

impl Rule {
    /// `solver` with exactly as many iterations as asked for, where that is said.
    pub fn fixed(iterations: Option<NonZeroU32>, solver: Solver) -> Solver {
        iterations.map_or(solver, |k| Self { iterations: k.get(), tolerance: None }.of(solver))
    }

    /// A solver that follows the rule.
    pub fn of(&self, solver: Solver) -> Solver {
        let Self { iterations, tolerance } = *self;
        let norm = if tolerance.is_some() { Norm::Qm16 } else { solver.norm };
        Solver { max_iterations: iterations, tolerance, norm, ..solver }
    }

    /// The rule that a solver follows.
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

/// Refuses what is no tolerance.
pub fn is_tolerance(number: f64) -> Outcome {
    if number > 0.0 && number < 1.0 {
        return Ok(());
    }
    let text = format!("--tolerance {number}: expected a number above 0 and below 1");
    Err(Failure::Usage(text))
}

impl Ends {
    /// Refuses what is no tolerance.
    pub fn check(&self) -> Outcome {
        is_tolerance(self.tolerance)
    }

    /// Fixed iterations, and a common residual; `solver` is the case's.
    pub fn rules(&self, solver: &Solver) -> [Rule; 2] {
        let iterations = self.iterations.map_or(solver.max_iterations, u32::from);
        let cap = self.max_iterations.map_or(iterations.saturating_mul(CAP), u32::from);
        let common = Rule { iterations: cap, tolerance: Some(self.tolerance) };
        [Rule { iterations, tolerance: None }, common]
    }
}
