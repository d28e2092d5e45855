//! Requests of windows: motions and loads.

use super::enums::{DeadlinePolicy, InterpolationMode};
use super::hash::Digest;
use super::ros::{Pose, Twist, Wrench};
use super::time::ns;
use crate::{MessageError, to_cdr};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Pose and twist of a body at a time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotionKnot {
    /// Time since the start of the run, ns.
    pub time_ns: i64,
    /// Pose of the reference point.
    pub pose: Pose,
    /// Velocity of the reference point and angular velocity, world axes; used by `hermite` only.
    pub twist: Twist,
}

/// Motion of a driven body in a window.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyMotion {
    /// Name of the body.
    pub body: String,
    /// Interpolation between the knots.
    #[serde(default)]
    pub interpolation: InterpolationMode,
    /// True if the motion may start elsewhere than the previous one ended.
    #[serde(default)]
    pub allow_jump: bool,
    /// Knots in order of time.
    pub knots: Vec<MotionKnot>,
}

/// External wrench on a body at a time, about its reference point, world axes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WrenchKnot {
    /// Time since the start of the run, ns.
    pub time_ns: i64,
    /// Force, N, and torque, N m.
    pub wrench: Wrench,
}

/// Load on a body in a window.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyLoad {
    /// Name of the body.
    pub body: String,
    /// Interpolation between the knots: `hold` or `linear`.
    #[serde(default = "linear")]
    pub interpolation: InterpolationMode,
    /// Knots in order of time.
    pub knots: Vec<WrenchKnot>,
}

fn linear() -> InterpolationMode {
    InterpolationMode::Linear
}

/// Request to compute the window from `t0_ns` to `t1_ns`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AdvanceRequest {
    /// Identifier of the run.
    pub run_id: String,
    /// Number of the window: one more than that of the last one.
    pub seq: u64,
    /// Start of the window, ns.
    pub t0_ns: i64,
    /// End of the window, ns.
    pub t1_ns: i64,
    /// Motions of driven bodies; all others stay at rest.
    #[serde(default)]
    pub motions: Vec<BodyMotion>,
    /// Loads on bodies.
    #[serde(default)]
    pub loads: Vec<BodyLoad>,
    /// Maximum wall time of the window, ms; 0: no deadline.
    #[serde(default)]
    #[schemars(range(max = u32::MAX))]
    pub deadline_ms: u32,
    /// Action when the deadline has passed.
    #[serde(default)]
    pub deadline_policy: DeadlinePolicy,
    /// True to return the values of each step in [`AdvanceReply::step_series`](super::AdvanceReply::step_series).
    #[serde(default)]
    pub record_steps: bool,
}

impl AdvanceRequest {
    /// Creates the request of window `seq` of a run, without inputs and deadline.
    pub fn of(run_id: impl Into<String>, seq: u64, [t0_ns, t1_ns]: [u64; 2]) -> Self {
        let run_id = run_id.into();
        Self { run_id, seq, t0_ns: ns(t0_ns), t1_ns: ns(t1_ns), ..Self::default() }
    }

    /// Computes the digest of the request, which identifies a retry in any encoding.
    ///
    /// # Errors
    /// A request that cannot be encoded as CDR.
    pub fn digest(&self) -> Result<Digest, MessageError> {
        Ok(Digest::of(&to_cdr(self)?))
    }
}
