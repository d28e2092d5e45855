//! Bed of an instance, as phases, variables and steps see it: inside the unit or on a server.

use crate::status::Complaint;
use ballast::component::{Parameters, Twist, WindowInputs, WindowResult};
use ballast::math::Pose;
use ballast::model::Model;
use ballast::state::State;
#[cfg(feature = "zenoh")]
use ballast_zenoh::StoredStates;
use std::sync::Arc;

/// Treatment of a step that ends before its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PartialStep {
    /// The state stays at the end of the last complete time step.
    Keep,
    /// The state returns to the beginning of the step.
    RollBack,
}

/// Pose and twist with which the next motion of a body begins; any twist after a linear motion.
pub(crate) type MotionStart = (Pose, Option<Twist>);

/// Result of a window, and the reason if it ended before its time.
pub(crate) struct BedWindow {
    pub result: WindowResult,
    pub reason: String,
}

/// Saved state of a bed.
#[derive(Debug, Clone)]
pub enum BedState {
    /// State of a bed inside the unit, shared and never written to.
    Local(Arc<State>),
    /// State that a server keeps.
    #[cfg(feature = "zenoh")]
    Served(Arc<ServedState>),
}

/// State that a server keeps under a name until it is dropped here.
#[cfg(feature = "zenoh")]
#[derive(Debug)]
pub struct ServedState {
    /// Name at the server.
    pub(crate) name: String,
    /// Start of the next motion of each driven body `[nd]`.
    pub(crate) starts: Vec<MotionStart>,
    /// Parameters in force, if this instance has set any.
    pub(crate) parameters: Option<Parameters>,
    /// States of the instance that saved this one.
    pub(crate) stored: StoredStates,
}

#[cfg(feature = "zenoh")]
impl Drop for ServedState {
    fn drop(&mut self) {
        self.stored.release(std::mem::take(&mut self.name));
    }
}

/// Bed of an instance.
pub(crate) trait BedBackend {
    /// Returns the simulated time, ns.
    fn now_ns(&self) -> u64;

    /// Returns the start of the next motion of driven body `d`, or of its mount.
    fn motion_start(&self, d: usize) -> MotionStart;

    /// Returns the hash of model and state, 32 hexadecimal digits.
    fn state_hash(&self) -> String;

    /// Sets the number of worker threads, 0: one per processor.
    fn set_threads(&mut self, threads: usize) -> Result<(), Complaint>;

    /// Sets the parameters of the next windows.
    fn set_parameters(&mut self, parameters: &Parameters) -> Result<(), Complaint>;

    /// Advances to `end_ns`. A discarded window, and one that ends early under [`PartialStep::RollBack`], changes nothing.
    fn advance(
        &mut self,
        end_ns: u64,
        inputs: &WindowInputs,
        partial: PartialStep,
    ) -> Result<BedWindow, Complaint>;

    /// Saves the state.
    fn save(&mut self) -> Result<BedState, Complaint>;

    /// Restores a state; `has_failed` after a panic.
    fn restore(&mut self, state: &BedState, has_failed: bool) -> Result<(), Complaint>;

    /// Returns to the start of the run.
    fn reset(&mut self) -> Result<(), Complaint>;

    /// Returns the model, with which serialised states are read; `None` if it is on a server.
    fn model(&self) -> Option<&Model>;
}

/// Returns the complaint about a state that has no bytes here.
pub(crate) fn no_bytes() -> Complaint {
    Complaint::error(
        "serialised state: expected a unit with its bed inside, found one whose bed is on a server; save and restore the \
         state in this instance",
    )
}
