//! What a window is asked with.

use super::convert::ns;
use super::hash::Digest;
use super::stock::{Pose, Twist, Wrench};
use super::words::{DeadlinePolicy, InterpolationMode};
use crate::{MessageError, to_cdr};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where a body is at a time, and how it moves then.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MotionKnot {
    /// Since the start of the run, ns.
    pub time_ns: i64,
    pub pose: Pose,
    /// Velocity of the reference point and spin, world axes; read by `hermite` only.
    pub twist: Twist,
}

/// The motion of one driven body through a window.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyMotion {
    pub body: String,
    #[serde(default)]
    pub interpolation: InterpolationMode,
    /// The window need not join the one before.
    #[serde(default)]
    pub allow_jump: bool,
    pub knots: Vec<MotionKnot>,
}

/// What pushes a loaded body at a time, about its reference point, world axes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WrenchKnot {
    /// Since the start of the run, ns.
    pub time_ns: i64,
    pub wrench: Wrench,
}

/// The load on one body through a window.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyLoad {
    pub body: String,
    /// `hold` or `linear`.
    #[serde(default = "linear")]
    pub interpolation: InterpolationMode,
    pub knots: Vec<WrenchKnot>,
}

fn linear() -> InterpolationMode {
    InterpolationMode::Linear
}

/// Compute the window from `t0_ns` to `t1_ns`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AdvanceRequest {
    pub run_id: String,
    /// One more than that of the last window.
    pub seq: u64,
    pub t0_ns: i64,
    pub t1_ns: i64,
    #[serde(default)]
    pub motions: Vec<BodyMotion>,
    #[serde(default)]
    pub loads: Vec<BodyLoad>,
    /// Wall time, ms; 0: none.
    #[serde(default)]
    #[schemars(range(max = u32::MAX))]
    pub deadline_ms: u32,
    #[serde(default)]
    pub deadline_policy: DeadlinePolicy,
    /// Tell the window step by step, too: [`AdvanceReply::series`](super::AdvanceReply::series).
    #[serde(default)]
    pub record_steps: bool,
}

impl AdvanceRequest {
    /// Window `seq` of a run, from `t0_ns` to `t1_ns`: without inputs, without a deadline.
    pub fn of(run_id: impl Into<String>, seq: u64, [t0_ns, t1_ns]: [u64; 2]) -> Self {
        let run_id = run_id.into();
        Self { run_id, seq, t0_ns: ns(t0_ns), t1_ns: ns(t1_ns), ..Self::default() }
    }

    /// Fingerprint of the request, whatever it was written in: a retry is known by it.
    ///
    /// # Errors
    /// A request that cannot be written as CDR.
    pub fn digest(&self) -> Result<Digest, MessageError> {
        Ok(Digest::of(&to_cdr(self)?))
    }
}
