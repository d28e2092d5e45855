//! What looks at a window while it is computed.

use super::Stop;
use crate::state::State;
use crate::step::{StepReport, Stopwatch};
use std::ops::ControlFlow;

/// Sees each step of a window and, as its stopwatch, the phases within; may end the window after a step, or within one,
/// which is then not done.
pub trait Watch: Stopwatch {
    /// A step is done, and has led to `state`.
    fn step(&mut self, _state: &State, _report: &StepReport) -> ControlFlow<Stop> {
        ControlFlow::Continue(())
    }
}

impl Watch for () {}

/// Sees steps alone.
pub struct Each<F>(pub F);

impl<F: Send> Stopwatch for Each<F> {}

impl<F: FnMut(&State, &StepReport) -> ControlFlow<Stop> + Send> Watch for Each<F> {
    fn step(&mut self, state: &State, report: &StepReport) -> ControlFlow<Stop> {
        self.0(state, report)
    }
}
