//! Parameters that may change between windows: effort of the solver and limit of the penetration.

use super::refusal::Refusal;
use super::stepper::Component;
use crate::error::Error;
use crate::model::Model;
use std::sync::Arc;

/// Parameters of a component that its caller may set. Those of the solver are part of the model and of its hash.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters {
    /// Largest number of iterations per step.
    pub iterations: u32,
    /// `None`: all iterations.
    pub tolerance: Option<f64>,
    /// Maximum penetration that a step may add, m; infinite: no limit.
    pub penetration: f64,
}

impl Parameters {
    /// Returns true if two models differ in these parameters at most.
    pub fn are_only_difference(a: &Model, b: &Model) -> bool {
        let mut like_b = a.clone();
        like_b.solver.max_iterations = b.solver.max_iterations;
        like_b.solver.tolerance = b.solver.tolerance;
        like_b == *b
    }
}

impl Component {
    /// Returns the parameters of the next window.
    pub fn parameters(&self) -> Parameters {
        let solver = &self.model.solver;
        Parameters {
            iterations: solver.max_iterations,
            tolerance: solver.tolerance,
            penetration: self.limits.penetration,
        }
    }

    /// Sets the parameters of all later windows, and of a redo of the last one.
    ///
    /// # Errors
    /// Numbers that cannot be used; nothing is changed.
    pub fn set_parameters(&mut self, parameters: &Parameters) -> Result<(), Refusal> {
        if !(parameters.penetration > 0.0) {
            return Err(Refusal::Core(Error::Model {
                place: "limit of the penetration".into(),
                expected: "above 0 m (none: any)".into(),
                found: parameters.penetration.to_string(),
            }));
        }
        let solver = &self.model.solver;
        if (solver.max_iterations, solver.tolerance)
            != (parameters.iterations, parameters.tolerance)
        {
            let mut model = Model::clone(&self.model);
            model.solver.max_iterations = parameters.iterations;
            model.solver.tolerance = parameters.tolerance;
            model.check()?;
            self.model = Arc::new(model);
        }
        self.limits.penetration = parameters.penetration;
        Ok(())
    }
}
