//! Settings and status of the real-time mode.

use crate::messages::InterpolationMode;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of the real-time mode, in which simulated time follows the wall clock.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RealTimeMode {
    /// Simulated time per wall time, above 0.
    pub real_time_factor: f64,
    /// Length of a window, ns: whole time steps.
    pub window_ns: u64,
    /// Delay between the arrival of a sample and its time in the run, simulated ns; at least one window.
    pub latency_ns: u64,
    /// Maximum time without a sample of a body before time pauses, wall ms.
    pub max_sample_age_ms: u64,
    /// Names of the bodies that follow their samples; all others stay at rest.
    pub bodies: Vec<String>,
    /// Interpolation between samples.
    #[serde(default)]
    pub interpolation: InterpolationMode,
}

/// Status of the real-time mode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RealTimeStatus {
    /// Requested simulated time per wall time.
    pub real_time_factor: f64,
    /// Delay of the run behind the wall clock, simulated ns.
    pub lag_ns: u64,
    /// Number of rejected samples: undecodable, out of order, too many, too far ahead or too far away.
    pub dropped_samples: u64,
    /// Number of times the run fell too far behind and restarted from the current samples.
    pub overruns: u64,
}
