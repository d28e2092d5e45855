//! Stepper of a run or a replay: the component of a case, and the driver that moves its bodies.

use crate::Result;
use crate::case::{self, Case};
use crate::driver::{DriverFailure, RunDriver, RunObserver};
use crate::recording_driver::RecordingDriver;
use ballast::component::{Component, DrivenWindow, Session, StopReason};
use ballast::model::Model;
use ballast::state::State;
use ballast::step::StepReport;
use ballast::track::TampingPhase;
use std::sync::Arc;

/// Component of a case with the driver that moves its bodies, advanced step by step.
pub struct CaseStepper(Session<RunDriver>);

impl CaseStepper {
    /// Joins the component of a case at `state` with its driver.
    ///
    /// # Errors
    /// A state that does not fit the case.
    pub fn new(case: &Case, model: Model, state: State, driver: RunDriver) -> Result<Self> {
        Ok(Self(Session::new(case::component(case, Arc::new(model), state)?, driver)))
    }

    /// Returns the component.
    pub fn component(&self) -> &Component {
        self.0.component()
    }

    /// Returns the model of the component.
    pub fn model(&self) -> &Model {
        self.component().model()
    }

    /// Returns the state of the component.
    pub fn state(&self) -> &State {
        self.component().state()
    }

    /// Returns the hash of model and state.
    pub fn hash(&self) -> u128 {
        ballast_hdf5::state_hash(self.model(), self.state())
    }

    /// Returns the phase of the case's cycle; `Done` where something else moves the bodies.
    pub fn phase(&self) -> TampingPhase {
        self.0.driver().phase(self.state().time())
    }

    /// Returns the recording that is replayed, if one is.
    pub fn recording(&self) -> Option<&RecordingDriver> {
        self.0.driver().recording()
    }

    /// Refuses a recording that cannot move the bodies through the next step; nothing is computed.
    ///
    /// # Errors
    /// The inputs of the step are missing or refused.
    pub fn check_first_step(&mut self) -> Result {
        let (driver, component) = self.0.parts_mut();
        match driver {
            RunDriver::Cycle(_) => Ok(()),
            RunDriver::Recording { recording, .. } => recording.check_first_step(component),
        }
    }

    /// Advances one step; `None` where the recording ends.
    ///
    /// # Errors
    /// `Failure::Interrupted` where a stop was requested within the step, which is then not done; failed steps.
    pub fn step(
        &mut self,
        observer: &mut RunObserver,
    ) -> Result<Option<(DrivenWindow, StepReport)>> {
        observer.report = None;
        let window = self.0.step(observer).map_err(|e| match e {
            DriverFailure::Failure(failure) => failure,
            DriverFailure::Refusal(refusal) => self.0.driver().failure(refusal.to_string()),
        })?;
        let Some(window) = window else { return Ok(None) };
        match (observer.report.take(), &window.result.error) {
            (Some(report), None) => Ok(Some((window, report))),
            (_, Some(error)) => Err(self.0.driver().failure(error.to_string())),
            (None, None) => Err(ballast::Error::Stopped(StopReason::Early).into()),
        }
    }
}
