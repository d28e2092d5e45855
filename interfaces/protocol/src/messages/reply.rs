//! Replies to windows, and records of windows.

use super::enums::ReplyStatus;
use super::hash::{Digest, StateHash};
use super::input::AdvanceRequest;
use super::ros::{Header, Point, Pose, Twist, Vector3, Wrench, message};
use super::series::StepSeries;
use crate::{MessageError, to_cdr};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

message!(
    /// Impulse, wrench and motion of a body in a window, by the ballast on the body, about its reference point, world axes.
    WrenchImpulse {
        /// Time of the end of the window.
        header: Header,
        /// Name of the body.
        body: String,
        /// Impulse of the window, N s.
        impulse: Vector3,
        /// Angular impulse of the window, N m s.
        angular_impulse: Vector3,
        /// Mean wrench of the window, N and N m.
        mean: Wrench,
        /// Mean wrench of the last 4 ms in whole steps, which may begin before the window, N and N m.
        moving_average: Wrench,
        /// Largest mean force of a step, N.
        peak_force: Vector3,
        /// Mean torque of the step of the peak force, N m.
        peak_torque: Vector3,
        /// Time at the end of the step of the peak force, ns.
        peak_time_ns: i64,
        /// Work of the body on the ballast, J.
        work: f64,
        /// Number of active contact points in the last step.
        contacts: u32,
        /// Pose at the end of the window.
        pose: Pose,
        /// Twist at the end of the window.
        twist: Twist,
    }
);

/// Measurements in a zone of the bed: packing, contacts and stress.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ZoneMeasurement {
    /// Time of the measurement.
    pub header: Header,
    /// Name of the zone.
    pub zone: String,
    /// Solid volume divided by accessible volume; NaN (in JSON `null`) without accessible volume.
    #[serde(deserialize_with = "number_or_null")]
    #[schemars(with = "Option<f64>")]
    pub compactness: f64,
    /// Mean number of touching neighbours of the grains whose centre is in the zone; NaN without grains.
    #[serde(deserialize_with = "number_or_null")]
    #[schemars(with = "Option<f64>")]
    pub coordination: f64,
    /// Inertial number; NaN without forces between grains.
    #[serde(deserialize_with = "number_or_null")]
    #[schemars(with = "Option<f64>")]
    pub inertial_number: f64,
    /// Mean pressure, Pa.
    pub mean_pressure: f64,
    /// Lower corner of the zone, m.
    pub low: Point,
    /// Upper corner of the zone, m.
    pub high: Point,
}

/// Deserializes a number; JSON writes NaN as `null`.
fn number_or_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    if deserializer.is_human_readable() {
        Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN))
    } else {
        f64::deserialize(deserializer)
    }
}

message!(
    /// Squeeze of a pair of tines, measured up to the last complete vibration period before the end of a window.
    SqueezeReport {
        /// Time of the end of the window.
        header: Header,
        /// Name of the pair.
        pair: String,
        /// Number of the squeeze of this pair, from 1.
        number: u32,
        /// True if the pair has opened again.
        is_finished: bool,
        /// Time of the widest opening, ns; closings are counted from there.
        start_ns: i64,
        /// Time at which ballast resistance starts, ns: end of the first period with sustained force; -1 before.
        onset_ns: i64,
        /// Closing at the onset, m.
        onset_closing: f64,
        /// Closing of one side, averaged over the last period, m.
        closing: f64,
        /// Largest mean force of a side over a period, N.
        peak_force: f64,
        /// Closing at the peak force, m.
        peak_closing: f64,
        /// Largest force of a single step, N.
        peak_step_force: f64,
        /// Work of the tines on the ballast from a closing of 2 mm, including vibration, J.
        work: f64,
        /// Work of the mean force along the closing, both sides, J.
        compaction_energy: f64,
        /// Closings of the force-displacement loop of a side, m.
        loop_closing: Vec<f64>,
        /// Mean forces of the force-displacement loop of a side, N.
        loop_force: Vec<f64>,
    }
);

message!(
    /// Solver statistics of a window.
    #[derive(Copy)]
    SolverStats {
        /// Number of iterations of all steps.
        iterations: u64,
        /// Number of local solves of all steps.
        visits: u64,
        /// Number of steps that reached the maximum number of iterations.
        steps_not_converged: u64,
        /// Largest residual QM/16 of all steps.
        residual_qm16: f64,
        /// Largest natural-map residual of all steps.
        residual_natural_map: f64,
        /// Number of contact points in the last step.
        contacts: u64,
        /// Number of active contact points in the last step.
        active_contacts: u64,
        /// Mean penetration in the last step, m.
        mean_penetration: f64,
        /// Largest penetration of all steps, m.
        max_penetration: f64,
        /// Differences of the impulses on tines and sleepers between two solutions of the checked steps, N s.
        force_difference: f64,
        /// Magnitudes of these impulses, N s; 0: no step of the window was checked.
        force_compared: f64,
        /// Complementarity gap of all steps, J.
        complementarity_gap: f64,
        /// Infeasible part beside the complementarity gap, of all steps, J.
        infeasible_work: f64,
        /// Energy that contacts have dissipated in the window, J.
        dissipated: f64,
    }
);

message!(
    /// Solver parameters of the following steps.
    #[derive(Copy)]
    SolverParameters {
        /// Maximum number of iterations per step.
        max_iterations: u32,
        /// Residual below which a step is converged; 0: always `max_iterations`.
        tolerance: f64,
        /// Penetration above which a window is rolled back, m; 0: no limit.
        max_penetration: f64,
    }
);

message!(
    /// Energies of the grains since the start of the run, J.
    #[derive(Copy)]
    EnergyLedger {
        /// Kinetic energy at the start.
        initial_kinetic: f64,
        /// Potential energy at the start.
        initial_potential: f64,
        /// Energy of the contacts' springs at the start.
        initial_elastic: f64,
        /// Kinetic energy.
        kinetic: f64,
        /// Potential energy.
        potential: f64,
        /// Energy of the contacts' springs.
        elastic: f64,
        /// Work of the driven bodies on the grains.
        external_work: f64,
        /// Energy dissipated in contacts.
        dissipated: f64,
        /// Energy that the other terms do not account for.
        balance_error: f64,
    }
);

message!(
    /// Reply to a window.
    AdvanceReply {
        /// Identifier of the run.
        run_id: String,
        /// Number of the window.
        seq: u64,
        /// Status of the window.
        status: ReplyStatus,
        /// Error code for programs; empty if the status is `ok`.
        code: String,
        /// Error message for people; empty if the status is `ok`.
        message: String,
        /// Start of the window, ns.
        t0_ns: i64,
        /// Time reached by the window, ns.
        t1_ns: i64,
        /// Number of steps that are kept.
        steps: u64,
        /// Results of the driven bodies.
        bodies: Vec<WrenchImpulse>,
        /// Measurements in the zones.
        zones: Vec<ZoneMeasurement>,
        /// Squeezes of the pairs of tines.
        squeezes: Vec<SqueezeReport>,
        /// Solver statistics.
        solver: SolverStats,
        /// Energies of the grains.
        energy: EnergyLedger,
        /// Hash of the state at `t1_ns`.
        hash: StateHash,
        /// Largest sensible spacing of motion knots, ns; 0: no advice.
        max_knot_spacing_ns: u64,
        /// Values of each step; empty unless requested.
        step_series: StepSeries,
    }
);

message!(
    /// Record of a window: its request, and hash and digest of its reply.
    WindowRecord {
        /// Number of the window.
        seq: u64,
        /// Start of the window, ns.
        t0_ns: i64,
        /// End of the window, ns.
        t1_ns: i64,
        /// Request of the window.
        request: AdvanceRequest,
        /// Hash of the state at `t1_ns`.
        hash: StateHash,
        /// Digest of the reply, see [`AdvanceReply::digest`].
        reply_digest: Digest,
    }
);

impl AdvanceReply {
    /// Computes the digest of the reply without `run_id` and `max_knot_spacing_ns`, which are no results.
    ///
    /// # Errors
    /// A reply that cannot be encoded as CDR.
    pub fn digest(&self) -> Result<Digest, MessageError> {
        let results = Self { run_id: String::new(), max_knot_spacing_ns: 0, ..self.clone() };
        Ok(Digest::of(&to_cdr(&results)?))
    }
}

impl WindowRecord {
    /// Creates the record of a window.
    ///
    /// # Errors
    /// A reply that cannot be encoded as CDR.
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
