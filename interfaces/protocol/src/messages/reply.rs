//! What a window is answered with, and the record of both.

use super::hash::{Digest, StateHash};
use super::input::AdvanceRequest;
use super::series::StepSeries;
use super::stock::{Header, Point, Pose, Twist, Vector3, Wrench, message};
use super::words::ReplyStatus;
use crate::{MessageError, to_cdr};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

message!(
    /// What the ballast did to a body during a window, about its reference point, world axes.
    WrenchImpulse {
        /// The end of the window.
        header: Header,
        body: String,
        /// N s, N m s.
        impulse: Vector3,
        angular_impulse: Vector3,
        /// Impulses over the length of the window: N, N m.
        mean: Wrench,
        /// Over the last 4 ms, which may have begun before the window: N, N m.
        moving_average: Wrench,
        /// Largest mean force of a step, N, the mean torque of that step, N m, and its end, ns.
        peak_force: Vector3,
        peak_torque: Vector3,
        peak_time_ns: i64,
        /// Of the body on the ballast, J.
        work: f64,
        /// Contact points that carried an impulse in the last step.
        contacts: u32,
        /// Of the body at the end of the window.
        pose: Pose,
        twist: Twist,
    }
);

/// How densely a zone is filled, and how its grains press and flow.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ZoneMeasurement {
    pub header: Header,
    pub zone: String,
    /// Solid over accessible volume; NaN (in JSON `null`) where nothing is accessible.
    #[serde(deserialize_with = "number_or_null")]
    #[schemars(with = "Option<f64>")]
    pub compactness: f64,
    /// Mean number of touching neighbours of the grains whose centre is in the zone; NaN without grains.
    #[serde(deserialize_with = "number_or_null")]
    #[schemars(with = "Option<f64>")]
    pub coordination: f64,
    /// NaN where grains do not press on each other.
    #[serde(deserialize_with = "number_or_null")]
    #[schemars(with = "Option<f64>")]
    pub inertial_number: f64,
    /// Pa.
    pub mean_pressure: f64,
    /// Corners of the zone, m.
    pub low: Point,
    pub high: Point,
}

/// JSON has no NaN: it is written as `null`.
fn number_or_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    if deserializer.is_human_readable() {
        Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
    } else {
        f64::deserialize(deserializer)
    }
}

message!(
    /// A squeeze of a pair of tines, up to the last whole vibration period before the end of a window.
    SqueezeReport {
        /// The end of the window.
        header: Header,
        pair: String,
        /// Of this pair, from 1 on.
        number: u32,
        /// The pair has opened again.
        is_finished: bool,
        /// When the pair was at its widest, ns; closings are counted from there.
        start_ns: i64,
        /// End of the period since which the ballast resists, or did so last, ns; -1: not yet. The closing then, m.
        onset_ns: i64,
        onset_closing: f64,
        /// Of a side, mean over the last period, m.
        closing: f64,
        /// Largest mean force of a side over a period, N, and the closing at which it occurred, m.
        peak_force: f64,
        peak_closing: f64,
        /// Largest force of a single step, N.
        peak_step_force: f64,
        /// Of the tines on the ballast since it had closed by 2 mm, vibration included, J.
        work: f64,
        /// Of the mean force along the closing as far as it came, both sides, J.
        compaction_energy: f64,
        /// The force-displacement loop: closing, m, and mean force, N, of a side.
        loop_closing: Vec<f64>,
        loop_force: Vec<f64>,
    }
);

message!(
    /// How a window was solved.
    #[derive(Copy)]
    SolverStats {
        /// Over all steps.
        iterations: u64,
        visits: u64,
        steps_not_converged: u64,
        /// Largest of all steps.
        residual_qm16: f64,
        residual_natural_map: f64,
        /// In the last step.
        contacts: u64,
        active_contacts: u64,
        /// Mean of the last step, largest of all steps, m.
        mean_penetration: f64,
        max_penetration: f64,
    }
);

message!(
    /// How hard steps are solved from here on.
    #[derive(Copy)]
    SolverParameters {
        /// Largest number of iterations per step.
        max_iterations: u32,
        /// A step is solved below this; 0: all iterations.
        tolerance: f64,
        /// Deepest penetration of a sound step, m; 0: any.
        max_penetration: f64,
    }
);

message!(
    /// Energies of the grains since the start of the run, J.
    #[derive(Copy)]
    EnergyBalance {
        initial_kinetic: f64,
        initial_potential: f64,
        kinetic: f64,
        potential: f64,
        external_work: f64,
        dissipated: f64,
        /// What these do not account for.
        balance_error: f64,
    }
);

message!(
    /// What became of a window.
    AdvanceReply {
        run_id: String,
        seq: u64,
        status: ReplyStatus,
        /// Why it is not ok, for programs and for people; empty where it is.
        code: String,
        message: String,
        /// The window as far as it was computed, ns.
        t0_ns: i64,
        t1_ns: i64,
        steps: u64,
        bodies: Vec<WrenchImpulse>,
        zones: Vec<ZoneMeasurement>,
        squeezes: Vec<SqueezeReport>,
        solver: SolverStats,
        energy: EnergyBalance,
        /// Of the state at `t1_ns`.
        hash: StateHash,
        /// Longest sensible time step of a partner, ns; 0: no advice.
        max_knot_spacing_ns: u64,
        /// Empty unless it was asked for.
        step_series: StepSeries,
    }
);

message!(
    /// A window as it was asked for, and what its answer was.
    WindowRecord {
        seq: u64,
        t0_ns: i64,
        t1_ns: i64,
        request: AdvanceRequest,
        hash: StateHash,
        /// See [`AdvanceReply::digest`].
        reply_digest: Digest,
    }
);

impl AdvanceReply {
    /// Fingerprint of the reply: the first 128 bits of BLAKE3 over its CDR with an empty `run_id`, which is
    /// fresh for every run, and without the hint, which is advice: neither says what was computed.
    ///
    /// # Errors
    /// A reply that cannot be written as CDR.
    pub fn digest(&self) -> Result<Digest, MessageError> {
        let told = Self { run_id: String::new(), max_knot_spacing_ns: 0, ..self.clone() };
        Ok(Digest::of(&to_cdr(&told)?))
    }
}

impl WindowRecord {
    /// The record of a window.
    ///
    /// # Errors
    /// A reply that cannot be written as CDR.
    pub fn of(request: AdvanceRequest, reply: &AdvanceReply) -> Result<Self, MessageError> {
        Ok(Self {
            seq: request.seq,
            t0_ns: reply.t0_ns,
            t1_ns: reply.t1_ns,
            request,
            hash: reply.hash,
            reply_digest: reply.digest()?,
        })
    }
}
