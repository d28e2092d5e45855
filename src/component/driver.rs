//! Drivers: what moves the driven bodies of a component.

use super::parameters::Parameters;
use super::refusal::Refusal;
use super::result::{WindowResult, WindowStatus};
use super::stepper::Component;
use super::window::WindowInputs;
use crate::cancel::StopReason;
use crate::model::Model;
use crate::state::{DriverState, State};
use crate::step::{Phase, StepObserver, StepReport};
use std::ops::ControlFlow;
use std::sync::Arc;

/// Source of the motions and loads of the driven bodies, window by window.
///
/// Contract: everything that later inputs depend on is in the saved state, which is part of [`State`]. So redo, fork,
/// restore and resumed runs continue with the same inputs.
pub trait Driver: Send {
    /// Error of the driver; a refused window is one.
    type Error: From<Refusal>;

    /// Returns the inputs of the window from the state of `component` to `end_ns`; `None` ends the run.
    ///
    /// # Errors
    /// Inputs that cannot be read or computed.
    fn inputs(
        &mut self,
        component: &Component,
        end_ns: u64,
    ) -> Result<Option<WindowInputs>, Self::Error>;

    /// Returns parameters that are to be set before the window of the last [`Driver::inputs`].
    fn parameters(&mut self) -> Option<Parameters> {
        None
    }

    /// Called after each step of the window, which has led to `state`.
    fn observe(&mut self, _model: &Model, _state: &State, _report: &StepReport) {}

    /// Returns the state of the driver; by default none.
    fn save(&self) -> DriverState {
        DriverState::default()
    }

    /// Takes over a state of the driver; called before each window.
    ///
    /// # Errors
    /// A state of another driver.
    fn restore(&mut self, _saved: &DriverState) -> Result<(), Self::Error> {
        Ok(())
    }
}

/// Window that a driver has moved.
#[derive(Debug, Clone, PartialEq)]
pub struct DrivenWindow {
    /// Inputs of the driver.
    pub inputs: WindowInputs,
    /// Result of the window.
    pub result: WindowResult,
}

/// Driver without a state that calls a function for the inputs of each window.
pub struct FunctionDriver<F>(pub F);

impl<F> Driver for FunctionDriver<F>
where
    F: FnMut(&Component, u64) -> Result<Option<WindowInputs>, Refusal> + Send,
{
    type Error = Refusal;

    fn inputs(
        &mut self,
        component: &Component,
        end_ns: u64,
    ) -> Result<Option<WindowInputs>, Refusal> {
        self.0(component, end_ns)
    }
}

/// Observer that passes the steps on to a driver and to another observer.
struct DrivenObserver<'a, D, O> {
    model: &'a Model,
    driver: &'a mut D,
    observer: &'a mut O,
}

impl<D: Driver, O: StepObserver> StepObserver for DrivenObserver<'_, D, O> {
    fn phase_finished(&mut self, phase: Phase) {
        self.observer.phase_finished(phase);
    }

    fn step_finished(&mut self, state: &State, report: &StepReport) -> ControlFlow<StopReason> {
        self.driver.observe(self.model, state, report);
        self.observer.step_finished(state, report)
    }

    fn cancelled(&mut self) -> Option<StopReason> {
        self.observer.cancelled()
    }
}

impl Component {
    /// Advances to `t1_ns` with the inputs of `driver`, whose state becomes part of the component's state.
    ///
    /// Returns `None`, without a change, where the driver has no inputs for the window.
    ///
    /// # Errors
    /// Errors of the driver, and those of [`Component::advance_observed`].
    pub fn advance_driven<D: Driver>(
        &mut self,
        t1_ns: u64,
        driver: &mut D,
        observer: &mut impl StepObserver,
    ) -> Result<Option<DrivenWindow>, D::Error> {
        driver.restore(&self.state.driver)?;
        let Some(inputs) = driver.inputs(self, t1_ns)? else { return Ok(None) };
        if let Some(parameters) = driver.parameters() {
            self.set_parameters(&parameters)?;
        }
        let model = Arc::clone(&self.model);
        let mut driven = DrivenObserver { model: &model, driver: &mut *driver, observer };
        let result = self.advance_observed(t1_ns, &inputs, &mut driven)?;
        if result.status != WindowStatus::Discard {
            Arc::make_mut(&mut self.state).driver = Arc::new(driver.save());
        }
        Ok(Some(DrivenWindow { inputs, result }))
    }
}
