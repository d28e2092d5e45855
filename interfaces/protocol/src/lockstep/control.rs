//! Messages of the control plane, in JSON.
//!
//! Requests that change the state carry the owner's ticket, which the transport sends next to the message.

use super::error::{ErrorCode, RequestError};
use super::timing::WindowTiming;
use crate::messages::SolverParameters;
use crate::real_time::{RealTimeMode, RealTimeStatus};
use ballast::component::{Component, Parameters};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

/// Request to become the owner.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AttachRequest {
    /// Name of the client, which is also the name of its liveliness token.
    pub client: String,
    /// Run that the component must have; any run if absent.
    #[serde(default)]
    pub run_id: Option<String>,
    /// Ticket of an owner that reconnects.
    #[serde(default)]
    pub ticket: Option<String>,
}

/// Reply to a client that has become the owner.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct AttachReply {
    /// Secret that authorises requests that change the state.
    pub ticket: String,
    /// Number of owners since the start of the run; it has grown if another client was the owner in between.
    #[serde(default)]
    pub owner_count: u64,
    /// Position of the run.
    #[serde(flatten)]
    pub position: RunPosition,
}

/// Position of a run: its last window, its time and its state hash.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RunPosition {
    /// Identifier of the run.
    pub run_id: String,
    /// Number of the last window.
    pub seq: u64,
    /// Simulated time, ns.
    pub now_ns: u64,
    /// Hash of the current state, hexadecimal.
    pub hash: String,
}

/// Request to save, restore or drop a state.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StateName {
    /// Name of the saved state.
    pub name: String,
}

/// Request to prepare a bed and to start a run in it; absent choices are those of the case.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitRequest {
    /// Seed of the bed's random numbers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Schedule of the solver: `sequential`, `synchronous` or `asynchronous`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub schedule: Option<String>,
}

/// Request to change parameters; absent ones stay unchanged.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParameterUpdate {
    /// Maximum number of iterations per step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(range(max = u32::MAX))]
    pub max_iterations: Option<u32>,
    /// Residual below which a step is converged; 0: always `max_iterations`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tolerance: Option<f64>,
    /// Penetration above which a window is rolled back, m; 0: no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_penetration: Option<f64>,
    /// Settings that start the real-time mode; `null` stops it.
    #[serde(
        default,
        deserialize_with = "present_or_null",
        skip_serializing_if = "Option::is_none"
    )]
    #[schemars(with = "Option<RealTimeMode>")]
    pub real_time: Option<Option<RealTimeMode>>,
}

impl ParameterUpdate {
    /// Sets the parameters of a component and returns true if any has changed; ignores `real_time`.
    ///
    /// # Errors
    /// [`ErrorCode::ParameterInvalid`]; nothing is changed then.
    pub fn apply(&self, component: &mut Component) -> Result<bool, RequestError> {
        let now = component.parameters();
        let parameters = self.merged_with(now)?;
        let set = component.set_parameters(&parameters);
        set.map_err(|e| RequestError {
            code: ErrorCode::ParameterInvalid,
            ..RequestError::from(e)
        })?;
        Ok(parameters != now)
    }

    /// Returns an error if a value is invalid.
    ///
    /// Clients check before they send: JSON cannot express non-finite numbers, and `null` would mean absent.
    ///
    /// # Errors
    /// [`ErrorCode::ParameterInvalid`].
    pub fn check(&self) -> Result<(), RequestError> {
        let invalid = |place: &str, expected: &str, found: String| {
            Err(RequestError::expected(ErrorCode::ParameterInvalid, place, expected, found))
        };
        if self.max_iterations == Some(0) {
            return invalid("max_iterations", "at least 1", "0".into());
        }
        let limits = [
            ("tolerance", self.tolerance, "0 (all iterations) or a finite number above"),
            ("max_penetration", self.max_penetration, "0 (no limit) or a finite number above, m"),
        ];
        for (place, value, expected) in limits {
            if let Some(value) = value.filter(|value| !(value.is_finite() && *value >= 0.0)) {
                return invalid(place, expected, value.to_string());
            }
        }
        Ok(())
    }

    fn merged_with(&self, now: Parameters) -> Result<Parameters, RequestError> {
        self.check()?;
        let now = SolverParameters::from(now);
        let parameters = SolverParameters {
            max_iterations: self.max_iterations.unwrap_or(now.max_iterations),
            tolerance: self.tolerance.unwrap_or(now.tolerance),
            max_penetration: self.max_penetration.unwrap_or(now.max_penetration),
        };
        Ok(parameters.into())
    }
}

/// Deserializes a present value, also `null`, as `Some`.
fn present_or_null<'de, D, T>(deserializer: D) -> Result<Option<T>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    T::deserialize(deserializer).map(Some)
}

/// State of a served component.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum ComponentState {
    /// Waits for `init`.
    Unconfigured,
    /// Prepares the bed.
    Preparing,
    /// Waits for a window.
    #[default]
    Idle,
    /// Computes a window, or is in real-time mode.
    Running,
    /// Is in real-time mode and has paused for lack of samples.
    WaitingForInput,
    /// Has had an internal error; waits for `restore`, `reset` or `detach`.
    Error,
    /// Shuts down.
    ShuttingDown,
}

impl std::fmt::Display for ComponentState {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        self.serialize(f)
    }
}

/// Status of a component, published at every heartbeat.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StatusReport {
    /// State of the component.
    pub state: ComponentState,
    /// Position of the run.
    #[serde(flatten)]
    pub position: RunPosition,
    /// Name of the owner.
    pub owner: Option<String>,
    /// Duration of the ownership, wall ms.
    pub owner_since_ms: Option<u64>,
    /// Event that the component waits for.
    pub waiting_for: Option<String>,
    /// Duration of the wait, wall ms.
    pub waiting_since_ms: Option<u64>,
    /// Progress of the running window.
    pub progress: Option<WindowProgress>,
    /// Status of the real-time mode, while it is active.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub real_time: Option<RealTimeStatus>,
    /// Message of the internal error, in the error state.
    pub error: Option<String>,
    /// Wall time of the last computed window.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub last_window: Option<WindowTiming>,
    /// Number of the last window that a checkpoint contains, so that it survives a crash.
    ///
    /// A redo, a restore and changed parameters exclude the last window until the next checkpoint.
    pub durable_seq: u64,
    /// Time since the component started, wall ms.
    #[serde(default)]
    pub uptime_ms: u64,
}

/// Progress of a running window; residual, iterations and remaining time are unknown before the first step ends.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WindowProgress {
    /// Number of the window.
    pub seq: u64,
    /// Number of finished steps.
    pub step: u64,
    /// Number of steps in the window.
    pub steps: u64,
    /// Number of iterations of the last step.
    pub iterations: Option<u32>,
    /// Residual QM/16 of the last step.
    pub residual_qm16: Option<f64>,
    /// Time since the window started, wall ms.
    pub elapsed_ms: u64,
    /// Estimated time until the window ends, wall ms.
    pub remaining_ms: Option<u64>,
}
