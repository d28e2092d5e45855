//! Drivers of a run: the tamping cycle of the case, or a recording.

use crate::case::{self, Case};
use crate::profile::Profile;
use crate::recording_driver::RecordingDriver;
use crate::{Failure, Result as Outcome};
use ballast::component::{
    Component, Driver, Parameters, Refusal, StopReason, TampingDriver, WindowInputs,
};
use ballast::model::Model;
use ballast::state::{DriverState, State};
use ballast::step::{Phase, StepObserver, StepReport};
use ballast::track::{TampingCycle, TampingPhase};
use std::ops::ControlFlow;

/// Returns the driver of the case's tamping cycle.
///
/// # Errors
/// A cycle that the model cannot follow, or a state that another driver has left.
pub fn tamping_driver(case: &Case, model: &Model, state: &State) -> Outcome<TampingDriver> {
    let cycle = TampingCycle::new(&case.plan, model).map_err(|e| case::invalid(case, e))?;
    cycle.decode(&state.driver).map_err(|e| case::invalid(case, e))?;
    Ok(TampingDriver::new(cycle))
}

/// Driver of a run or a replay.
pub enum RunDriver {
    /// Tamping cycle of the case.
    Cycle(TampingDriver),
    /// Recording, with the cycle of the case it is replayed in.
    Recording {
        /// Source of the inputs.
        recording: Box<RecordingDriver>,
        /// Cycle of the case, which names the phases of a recording of it.
        cycle: TampingDriver,
    },
}

impl RunDriver {
    /// Returns the phase of the tamping cycle at a time of the run, s; `Done` where something else moves the bodies.
    pub fn phase(&self, time_s: f64) -> TampingPhase {
        match self {
            RunDriver::Cycle(cycle) => cycle.cycle().phase(time_s),
            RunDriver::Recording { recording, cycle } if recording.is_of_the_cycle() => {
                cycle.cycle().phase(time_s)
            }
            RunDriver::Recording { .. } => TampingPhase::Done,
        }
    }

    /// Returns the failure of a step of this driver.
    pub fn failure(&self, text: String) -> Failure {
        match self {
            RunDriver::Cycle(_) => Failure::Failed(text),
            RunDriver::Recording { recording, .. } => recording.failure(text),
        }
    }

    /// Returns the recording, where one moves the bodies.
    pub fn recording(&self) -> Option<&RecordingDriver> {
        match self {
            RunDriver::Cycle(_) => None,
            RunDriver::Recording { recording, .. } => Some(recording),
        }
    }
}

/// Error of a driven step: of the driver, or a refused window.
pub enum DriverFailure {
    /// The driver has no inputs because of an error.
    Failure(Failure),
    /// The component refused the window.
    Refusal(Refusal),
}

impl From<Refusal> for DriverFailure {
    fn from(refusal: Refusal) -> Self {
        Self::Refusal(refusal)
    }
}

impl From<Failure> for DriverFailure {
    fn from(failure: Failure) -> Self {
        Self::Failure(failure)
    }
}

impl Driver for RunDriver {
    type Error = DriverFailure;

    fn inputs(
        &mut self,
        component: &Component,
        end_ns: u64,
    ) -> Result<Option<WindowInputs>, DriverFailure> {
        match self {
            RunDriver::Cycle(cycle) => Ok(cycle.inputs(component, end_ns)?),
            RunDriver::Recording { recording, .. } => Ok(recording.inputs(component, end_ns)?),
        }
    }

    fn parameters(&mut self) -> Option<Parameters> {
        match self {
            RunDriver::Cycle(_) => None,
            RunDriver::Recording { recording, .. } => recording.parameters(),
        }
    }

    fn observe(&mut self, model: &Model, state: &State, report: &StepReport) {
        if let RunDriver::Cycle(cycle) = self {
            cycle.observe(model, state, report);
        }
    }

    fn save(&self) -> DriverState {
        match self {
            RunDriver::Cycle(cycle) => cycle.save(),
            RunDriver::Recording { .. } => DriverState::default(),
        }
    }

    fn restore(&mut self, saved: &DriverState) -> Result<(), DriverFailure> {
        match self {
            RunDriver::Cycle(cycle) => Ok(cycle.restore(saved)?),
            RunDriver::Recording { .. } => Ok(()),
        }
    }
}

/// Observer of the steps of a run: phase times, requests to stop, and the report of the last step.
pub struct RunObserver {
    /// Wall times of the phases.
    pub profile: Profile,
    pub(crate) report: Option<StepReport>,
}

impl RunObserver {
    /// Starts the clocks.
    pub fn start() -> Self {
        Self { profile: Profile::start(), report: None }
    }
}

impl StepObserver for RunObserver {
    fn phase_finished(&mut self, phase: Phase) {
        self.profile.phase_finished(phase);
    }

    fn step_finished(&mut self, _state: &State, report: &StepReport) -> ControlFlow<StopReason> {
        self.report = Some(report.clone());
        ControlFlow::Continue(())
    }

    fn cancelled(&mut self) -> Option<StopReason> {
        self.profile.cancelled()
    }
}
