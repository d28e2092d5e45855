//! What a window is asked with.

use super::convert::ns;
use super::hash::Digest;
use super::stock::{Pose, Twist, Wrench};
use super::words::{DeadlinePolicy, Interpolation};
use crate::{Malformed, to_cdr};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where a body is at a time, and how it moves then.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Knot {
    /// Since the start of the run, ns.
    pub time_ns: i64,
    pub pose: Pose,
    /// Velocity of the reference point and spin, world axes; read by `hermite` only.
    pub twist: Twist,
}

/// The motion of one driven body through a window.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BodyInput {
    pub body: String,
    #[serde(default)]
    pub interpolation: Interpolation,
    /// The window need not join the one before.
    #[serde(default)]
    pub rebase: bool,
    pub knots: Vec<Knot>,
}

/// What pushes a loaded body at a time, about its reference point, world axes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LoadKnot {
    /// Since the start of the run, ns.
    pub time_ns: i64,
    pub wrench: Wrench,
}

/// The load on one body through a window.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LoadInput {
    pub body: String,
    /// `hold` or `linear`.
    #[serde(default = "linear")]
    pub interpolation: Interpolation,
    pub knots: Vec<LoadKnot>,
}

fn linear() -> Interpolation {
    Interpolation::Linear
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
    pub motions: Vec<BodyInput>,
    #[serde(default)]
    pub loads: Vec<LoadInput>,
    /// Wall time, ms; 0: none.
    #[serde(default)]
    #[schemars(range(max = u32::MAX))]
    pub deadline_ms: u32,
    #[serde(default)]
    pub deadline_policy: DeadlinePolicy,
    /// Tell the window step by step, too: [`AdvanceReply::series`](super::AdvanceReply::series).
    #[serde(default)]
    pub series: bool,
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
    pub fn digest(&self) -> Result<Digest, Malformed> {
        Ok(Digest::of(&to_cdr(self)?))
    }
}
