//! Conversions between replies and results of windows.
//!
//! Contract: numbers are bitwise unchanged.

use super::time::checked_core_ns;
use super::*;
use crate::MessageError;
use ballast::component::{self, WindowResult};
use ballast::geometry::AxisBox;
use ballast::math::Vec3;
use ballast::model::Model;
use ballast::observe::{SqueezeOutcome, SqueezeRecord};
use ballast::state;

impl From<state::EnergyLedger> for EnergyLedger {
    fn from(e: state::EnergyLedger) -> Self {
        Self {
            initial_kinetic: e.initial_kinetic,
            initial_potential: e.initial_potential,
            initial_elastic: e.initial_elastic,
            kinetic: e.kinetic,
            potential: e.potential,
            elastic: e.elastic,
            external_work: e.work_in,
            dissipated: e.dissipated,
            balance_error: e.balance_error(),
        }
    }
}

impl From<EnergyLedger> for state::EnergyLedger {
    fn from(e: EnergyLedger) -> Self {
        Self {
            initial_kinetic: e.initial_kinetic,
            initial_potential: e.initial_potential,
            initial_elastic: e.initial_elastic,
            kinetic: e.kinetic,
            potential: e.potential,
            elastic: e.elastic,
            work_in: e.external_work,
            dissipated: e.dissipated,
        }
    }
}

/// Converts between a message and a type of the core with the same fields.
macro_rules! same_fields {
    ($message:ty, $core:ty: $($field:ident),*) => {
        impl From<$core> for $message {
            fn from(core: $core) -> Self {
                Self { $($field: core.$field as _),* }
            }
        }

        impl From<$message> for $core {
            fn from(message: $message) -> Self {
                Self { $($field: message.$field as _),* }
            }
        }
    };
}

same_fields!(
    SolverStats, component::SolverResult:
    iterations, visits, steps_not_converged, residual_qm16, residual_natural_map, contacts, active_contacts,
    mean_penetration, max_penetration, force_difference, force_compared, complementarity_gap, infeasible_work, dissipated
);

impl From<component::Parameters> for SolverParameters {
    fn from(p: component::Parameters) -> Self {
        let penetration = if p.penetration.is_finite() { p.penetration } else { 0.0 };
        Self {
            max_iterations: p.iterations,
            tolerance: p.tolerance.unwrap_or(0.0),
            max_penetration: penetration,
        }
    }
}

impl From<SolverParameters> for component::Parameters {
    fn from(p: SolverParameters) -> Self {
        Self {
            iterations: p.max_iterations,
            tolerance: (p.tolerance != 0.0).then_some(p.tolerance),
            penetration: if p.max_penetration == 0.0 { f64::INFINITY } else { p.max_penetration },
        }
    }
}

impl From<component::WindowStatus> for ReplyStatus {
    fn from(status: component::WindowStatus) -> Self {
        match status {
            component::WindowStatus::Ok => ReplyStatus::Ok,
            component::WindowStatus::Warn => ReplyStatus::Warn,
            component::WindowStatus::Early => ReplyStatus::Early,
            component::WindowStatus::Discard => ReplyStatus::Discard,
        }
    }
}

impl WrenchImpulse {
    /// Converts the result of body `name` in a window that ended at `time_ns`.
    pub fn of(name: &str, time_ns: u64, outcome: &component::BodyResult) -> Self {
        let wrench =
            |force: Vec3, torque: Vec3| Wrench { force: force.into(), torque: torque.into() };
        Self {
            header: Header::world(time_ns),
            body: name.into(),
            impulse: outcome.impulse.into(),
            angular_impulse: outcome.angular_impulse.into(),
            mean: wrench(outcome.mean_force, outcome.mean_torque),
            moving_average: wrench(outcome.moving_average_force, outcome.moving_average_torque),
            peak_force: outcome.peak_force.into(),
            peak_torque: outcome.peak_torque.into(),
            peak_time_ns: ns(outcome.peak_time_ns),
            work: outcome.work,
            contacts: outcome.contacts,
            pose: outcome.pose.into(),
            twist: Twist {
                linear: outcome.velocity.into(),
                angular: outcome.angular_velocity.into(),
            },
        }
    }
}

impl TryFrom<&WrenchImpulse> for component::BodyResult {
    type Error = MessageError;

    fn try_from(message: &WrenchImpulse) -> Result<Self, MessageError> {
        Ok(Self {
            impulse: message.impulse.into(),
            angular_impulse: message.angular_impulse.into(),
            mean_force: message.mean.force.into(),
            mean_torque: message.mean.torque.into(),
            moving_average_force: message.moving_average.force.into(),
            moving_average_torque: message.moving_average.torque.into(),
            peak_force: message.peak_force.into(),
            peak_torque: message.peak_torque.into(),
            peak_time_ns: checked_core_ns("peak_time_ns", message.peak_time_ns)?,
            work: message.work,
            contacts: message.contacts,
            pose: message.pose.try_into()?,
            velocity: message.twist.linear.into(),
            angular_velocity: message.twist.angular.into(),
        })
    }
}

impl ZoneMeasurement {
    /// Converts the result of a zone at a time, ns; absent values become NaN.
    pub fn of(time_ns: u64, zone: &component::ZoneResult) -> Self {
        Self {
            header: Header::world(time_ns),
            zone: zone.name.clone(),
            compactness: zone.compactness.unwrap_or(f64::NAN),
            coordination: zone.coordination.unwrap_or(f64::NAN),
            inertial_number: zone.inertial_number.unwrap_or(f64::NAN),
            mean_pressure: zone.pressure,
            low: zone.region.low.into(),
            high: zone.region.high.into(),
        }
    }
}

impl From<&ZoneMeasurement> for component::ZoneResult {
    fn from(zone: &ZoneMeasurement) -> Self {
        let measured = |x: f64| (!x.is_nan()).then_some(x);
        Self {
            name: zone.zone.clone(),
            region: AxisBox { low: zone.low.into(), high: zone.high.into() },
            compactness: measured(zone.compactness),
            coordination: measured(zone.coordination),
            inertial_number: measured(zone.inertial_number),
            pressure: zone.mean_pressure,
        }
    }
}

impl AdvanceReply {
    /// Converts the reply to the result of a local component, without the error.
    ///
    /// # Errors
    /// A status without a result, times before the start, or invalid poses.
    pub fn outcome(&self) -> Result<WindowResult, MessageError> {
        let status = match self.status {
            ReplyStatus::Ok => component::WindowStatus::Ok,
            ReplyStatus::Warn => component::WindowStatus::Warn,
            ReplyStatus::Early => component::WindowStatus::Early,
            ReplyStatus::Discard => component::WindowStatus::Discard,
            ReplyStatus::Error | ReplyStatus::Fatal => {
                let expected = "that of a window that was computed";
                return Err(MessageError::new("status", expected, self.status.word()));
            }
        };
        let body = |body: &WrenchImpulse| {
            let told = component::BodyResult::try_from(body);
            told.map_err(|e| e.inside(&format!("body {:?}", body.body)))
        };
        Ok(WindowResult {
            status,
            error: None,
            t0_ns: checked_core_ns("t0_ns", self.t0_ns)?,
            t1_ns: checked_core_ns("t1_ns", self.t1_ns)?,
            steps: self.steps,
            bodies: self.bodies.iter().map(body).collect::<Result<_, _>>()?,
            zones: self.zones.iter().map(Into::into).collect(),
            squeezes: self
                .squeezes
                .iter()
                .map(SqueezeOutcome::try_from)
                .collect::<Result<_, _>>()?,
            solver: self.solver.into(),
            energy: self.energy.into(),
            max_knot_spacing_ns: self.max_knot_spacing_ns,
        })
    }

    /// Builds the reply to a window of `model`, without its step series.
    pub fn of(
        request: &AdvanceRequest,
        model: &Model,
        outcome: &WindowResult,
        hash: StateHash,
    ) -> Self {
        let trouble = outcome.error.as_ref();
        let bodies = model.driven.iter().zip(&outcome.bodies);
        let (zones, squeezes) = (outcome.zones.iter(), outcome.squeezes.iter());
        Self {
            run_id: request.run_id.clone(),
            seq: request.seq,
            status: outcome.status.into(),
            code: trouble.map_or("", ballast::error::Error::code).into(),
            message: trouble.map_or(String::new(), ToString::to_string),
            t0_ns: ns(outcome.t0_ns),
            t1_ns: ns(outcome.t1_ns),
            steps: outcome.steps,
            bodies: bodies.map(|(d, b)| WrenchImpulse::of(&d.name, outcome.t1_ns, b)).collect(),
            zones: zones.map(|zone| ZoneMeasurement::of(outcome.t1_ns, zone)).collect(),
            squeezes: squeezes.map(|s| SqueezeReport::of(outcome.t1_ns, s)).collect(),
            solver: outcome.solver.into(),
            energy: outcome.energy.into(),
            hash,
            max_knot_spacing_ns: outcome.max_knot_spacing_ns,
            step_series: StepSeries::default(),
        }
    }
}

impl SqueezeReport {
    /// Converts the record of a squeeze at the end of a window, ns.
    pub fn of(time_ns: u64, squeeze: &SqueezeOutcome) -> Self {
        let record = &squeeze.record;
        Self {
            header: Header::world(time_ns),
            pair: squeeze.name.clone(),
            number: record.number,
            is_finished: squeeze.is_finished,
            start_ns: ns(record.start_ns),
            onset_ns: record.onset_ns.map_or(-1, ns),
            onset_closing: record.onset_closing,
            closing: record.closing,
            peak_force: record.peak_force,
            peak_closing: record.peak_closing,
            peak_step_force: record.peak_step_force,
            work: record.work,
            compaction_energy: record.compaction_energy,
            loop_closing: record.loop_points.iter().map(|p| p[0]).collect(),
            loop_force: record.loop_points.iter().map(|p| p[1]).collect(),
        }
    }
}

impl TryFrom<&SqueezeReport> for SqueezeOutcome {
    type Error = MessageError;

    fn try_from(squeeze: &SqueezeReport) -> Result<Self, MessageError> {
        let time = |field: &str, ns: i64| {
            checked_core_ns(field, ns)
                .map_err(|e| e.inside(&format!("squeeze of {:?}", squeeze.pair)))
        };
        let points = squeeze.loop_closing.iter().zip(&squeeze.loop_force);
        let record = SqueezeRecord {
            number: squeeze.number,
            start_ns: time("start_ns", squeeze.start_ns)?,
            onset_ns: match squeeze.onset_ns {
                -1 => None,
                ns => Some(time("onset_ns", ns)?),
            },
            onset_closing: squeeze.onset_closing,
            peak_force: squeeze.peak_force,
            peak_closing: squeeze.peak_closing,
            peak_step_force: squeeze.peak_step_force,
            closing: squeeze.closing,
            work: squeeze.work,
            compaction_energy: squeeze.compaction_energy,
            loop_points: points.map(|(c, f)| [*c, *f]).collect(),
        };
        Ok(Self { name: squeeze.pair.clone(), is_finished: squeeze.is_finished, record })
    }
}
