//! The control plane's messages, JSON all of them. What changes a state goes with the owner's ticket, which
//! the transport carries beside the message.

use super::cost::WindowTiming;
use super::{ErrorCode, RequestError};
use crate::messages;
use crate::pacer::{RealTimeMode, RealTimeStatus};
use ballast::component::{self, Component};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

/// Asks to drive.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AttachRequest {
    /// The client's name, under which it is alive.
    pub client: String,
    /// Refuse any other run than this one.
    #[serde(default)]
    pub run_id: Option<String>,
    /// An owner that has lost its connection shows its ticket.
    #[serde(default)]
    pub ticket: Option<String>,
}

/// The caller drives now.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct AttachReply {
    /// To be shown with everything that changes the state; nobody else knows it.
    pub ticket: String,
    /// How many owners there have been since the run began, one after another; the caller, who may come back, is the
    /// last. More than when it left: somebody else has driven meanwhile.
    #[serde(default)]
    pub owner_count: u64,
    #[serde(flatten)]
    pub position: RunPosition,
}

/// Where a run stands.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RunPosition {
    pub run_id: String,
    /// Of the last window.
    pub seq: u64,
    /// Simulated time, ns.
    pub now_ns: u64,
    /// State hash.
    pub hash: String,
}

/// Keeps the state, takes it up again, or forgets it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StateName {
    pub name: String,
}

/// Prepares a bed, with other choices than the case's where they are given, and begins a run in it.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitRequest {
    /// Of the bed's random numbers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// `sequential`, `synchronous` or `asynchronous`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub schedule: Option<String>,
}

/// Sets what is given, and leaves the rest.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParameterUpdate {
    /// Largest number of iterations per step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = u32::MAX))]
    pub max_iterations: Option<u32>,
    /// A step is solved below this; 0: all iterations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<f64>,
    /// Deepest penetration of a sound step, m; 0: any. A window with a deeper one is taken back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_penetration: Option<f64>,
    /// Time is to run by itself from now on; `null`: no more.
    #[serde(default, deserialize_with = "given", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<RealTimeMode>")]
    pub real_time: Option<Option<RealTimeMode>>,
}

impl ParameterUpdate {
    /// Sets what is given; whether anything has changed. Time that runs by itself is no matter of the component.
    ///
    /// # Errors
    /// [`ErrorCode::ParameterInvalid`]; nothing is changed.
    pub fn apply(&self, component: &mut Component) -> Result<bool, RequestError> {
        let now = component.parameters();
        let parameters = self.instead_of(now)?;
        let set = component.set_parameters(&parameters);
        set.map_err(|e| RequestError {
            code: ErrorCode::ParameterInvalid,
            ..RequestError::from(e)
        })?;
        Ok(parameters != now)
    }

    /// Refuses what makes no sense whatever held before. Who asks over a wire has to look before: JSON has no number for
    /// what is not finite, and its `null` would be taken for nothing given.
    ///
    /// # Errors
    /// [`ErrorCode::ParameterInvalid`].
    pub fn check(&self) -> Result<(), RequestError> {
        let wrong = |place: &str, expected: &str, found: String| {
            Err(RequestError::expected(ErrorCode::ParameterInvalid, place, expected, found))
        };
        if self.max_iterations == Some(0) {
            return wrong("max_iterations", "at least 1", "0".into());
        }
        let limits = [
            ("tolerance", self.tolerance, "0 (all iterations) or a finite number above"),
            ("max_penetration", self.max_penetration, "0 (any) or a finite number above, m"),
        ];
        for (place, given, expected) in limits {
            if let Some(value) = given.filter(|value| !(value.is_finite() && *value >= 0.0)) {
                return wrong(place, expected, value.to_string());
            }
        }
        Ok(())
    }

    /// The parameters `now`, but for those that are given.
    fn instead_of(
        &self,
        now: component::Parameters,
    ) -> Result<component::Parameters, RequestError> {
        self.check()?;
        let now = messages::SolverParameters::from(now);
        let parameters = messages::SolverParameters {
            max_iterations: self.max_iterations.unwrap_or(now.max_iterations),
            tolerance: self.tolerance.unwrap_or(now.tolerance),
            max_penetration: self.max_penetration.unwrap_or(now.max_penetration),
        };
        Ok(parameters.into())
    }
}

/// What is given, `null` too.
fn given<'de, D: Deserializer<'de>, T: Deserialize<'de>>(d: D) -> Result<Option<T>, D::Error> {
    T::deserialize(d).map(Some)
}

/// What a component is doing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum ComponentState {
    /// Waits for `init`.
    Unconfigured,
    /// The bed is being prepared.
    Preparing,
    /// Waits for a window.
    #[default]
    Idle,
    /// Computes a window, or runs by itself.
    Running,
    /// Runs by itself, and stands for want of input.
    WaitingForInput,
    /// Something failed; waits for restore, reset or detach.
    Error,
    ShuttingDown,
}

/// The word on the wire.
impl std::fmt::Display for ComponentState {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        self.serialize(f)
    }
}

/// What a component is doing, for its status and its heartbeat.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StatusReport {
    pub state: ComponentState,
    #[serde(flatten)]
    pub position: RunPosition,
    /// Who drives, and for how long, wall ms.
    pub owner: Option<String>,
    pub owner_since_ms: Option<u64>,
    /// What it waits for and for how long, wall ms.
    pub waiting_for: Option<String>,
    pub waiting_since_ms: Option<u64>,
    /// The window in work.
    pub progress: Option<WindowProgress>,
    /// While it runs by itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub real_time: Option<RealTimeStatus>,
    /// What failed, in error.
    pub error: Option<String>,
    /// What the last window that was computed has cost.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_window: Option<WindowTiming>,
    /// Windows up to this one survive a crash: a checkpoint leads through them. A redo, a restore and other parameters
    /// take the last window out of it until the next checkpoint is written.
    pub durable_seq: u64,
    /// Since the component started, wall ms.
    #[serde(default)]
    pub uptime_ms: u64,
}

/// How far a window is; what only a step tells is not known before the first one is done.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WindowProgress {
    pub seq: u64,
    /// Steps done, of all.
    pub step: u64,
    pub steps: u64,
    /// Of the last step.
    pub iterations: Option<u32>,
    pub residual_qm16: Option<f64>,
    /// Wall ms since the window's start, and left as it looks.
    pub elapsed_ms: u64,
    pub remaining_ms: Option<u64>,
}
