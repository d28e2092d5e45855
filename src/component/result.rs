//! Result of a window, summed over its steps.

use crate::drive::SpeedLimit;
use crate::error::Error;
use crate::geometry::AxisBox;
use crate::math::{Pose, Vec3};
use crate::model::Model;
use crate::observe::{self, SqueezeOutcome, Zone};
use crate::state::{EnergyLedger, State};
use crate::step::StepReport;

/// Status of a computed window, as in FMI.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum WindowStatus {
    /// Computed to its end, and every step converged if there is a tolerance.
    Ok,
    /// Computed to its end, but some step reached the maximum number of iterations.
    Warn,
    /// Ended before the requested time, in a valid state.
    Early,
    /// Rolled back: the state is exactly that of the beginning of the window.
    Discard,
}

impl WindowStatus {
    /// Returns the name of the status in messages.
    pub fn name(self) -> &'static str {
        match self {
            WindowStatus::Ok => "ok",
            WindowStatus::Warn => "warn",
            WindowStatus::Early => "early",
            WindowStatus::Discard => "discard",
        }
    }
}

/// Result of a window.
#[derive(Debug, Clone, PartialEq)]
pub struct WindowResult {
    /// Status of the window.
    pub status: WindowStatus,
    /// Error that ended the window, if one did.
    pub error: Option<Error>,
    /// Beginning of the window, ns.
    pub t0_ns: u64,
    /// End of the computed part, ns.
    pub t1_ns: u64,
    /// Number of steps that are kept.
    pub steps: u64,
    /// Reaction of the ballast on each driven body `[nd]`.
    pub bodies: Vec<BodyResult>,
    /// Measurements of the component's zones at the end of the window.
    pub zones: Vec<ZoneResult>,
    /// Squeezes that were in progress during the window, ended ones first.
    pub squeezes: Vec<SqueezeOutcome>,
    /// Figures of the solver.
    pub solver: SolverResult,
    /// Energies since the start of the run.
    pub energy: EnergyLedger,
    /// Maximum spacing of knots, ns, at which no body moves too far between them at its current speed; 0 if nothing
    /// moves.
    pub max_knot_spacing_ns: u64,
}

/// Measurements of a zone at the end of a window; `None` where they are not defined.
#[derive(Debug, Clone, PartialEq)]
pub struct ZoneResult {
    /// Name of the zone.
    pub name: String,
    /// Region of the zone in world axes, m.
    pub region: AxisBox,
    /// Solid over accessible volume (T-21).
    pub compactness: Option<f64>,
    /// Mean number of touching neighbours of the grains whose centre is in the zone (T-25).
    pub coordination: Option<f64>,
    /// Inertial number (T-22).
    pub inertial_number: Option<f64>,
    /// Pressure, mean over the last step, Pa (T-23).
    pub pressure: f64,
}

/// Reaction of the ballast on a driven body during a window, about its reference point, world axes (T-27).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyResult {
    /// Impulse on the body, N s.
    pub impulse: Vec3,
    /// Angular impulse on the body, N m s.
    pub angular_impulse: Vec3,
    /// Impulse over the length of the window, N; zero for a window without steps.
    pub mean_force: Vec3,
    /// Angular impulse over the length of the window, N m; zero for a window without steps.
    pub mean_torque: Vec3,
    /// Mean force over as many whole steps as 4 ms hold, at least one, N. They may have begun before the window.
    pub moving_average_force: Vec3,
    /// Mean torque over the steps of the mean force, N m.
    pub moving_average_torque: Vec3,
    /// Largest mean force of a step, N.
    pub peak_force: Vec3,
    /// Mean torque of the step with the largest force, N m.
    pub peak_torque: Vec3,
    /// End of the step with the largest force, ns; the beginning of the window without a force.
    pub peak_time_ns: u64,
    /// Work of the body on the ballast, J.
    pub work: f64,
    /// Contact points that carried an impulse in the last step.
    pub contacts: u32,
    /// Pose at the end of the window, that of the body itself where it has a mount.
    pub pose: Pose,
    /// Velocity of the reference point at the end of the window, m/s.
    pub velocity: Vec3,
    /// Angular velocity at the end of the window, rad/s.
    pub angular_velocity: Vec3,
}

/// Figures of the solver over a window.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SolverResult {
    /// Number of iterations of all steps.
    pub iterations: u64,
    /// Number of contact visits of all steps.
    pub visits: u64,
    /// Number of steps that have not reached the tolerance.
    pub steps_not_converged: u64,
    /// Largest residual QM/16 of a step (T-11).
    pub residual_qm16: f64,
    /// Largest natural map residual of a step, unit-free (T-10).
    pub residual_natural_map: f64,
    /// Number of contact points in the last step.
    pub contacts: usize,
    /// Number of contact points that carried an impulse in the last step.
    pub active_contacts: usize,
    /// Mean penetration in the last step, m (T-26).
    pub mean_penetration: f64,
    /// Largest penetration of all steps, m (T-26).
    pub max_penetration: f64,
    /// Differences of the impulses on tines and sleepers between two solutions of the checked steps, N s (T-43).
    pub force_difference: f64,
    /// Magnitudes of these impulses, N s; 0 where no step of the window was checked.
    pub force_compared: f64,
    /// Complementarity gap, summed over the steps, J (T-44).
    pub complementarity_gap: f64,
    /// Infeasible part beside the complementarity gap, summed over the steps, J (T-44).
    pub infeasible_work: f64,
    /// Energy that contacts have dissipated in the window, J (T-14).
    pub dissipated: f64,
}

/// End of a window, from which its result is read.
pub(super) struct WindowEnd<'a> {
    pub model: &'a Model,
    pub state: &'a State,
    /// Zones to measure on the state.
    pub zones: &'a [Zone],
    pub squeezes: Vec<SqueezeOutcome>,
    pub speed_limit: &'a SpeedLimit,
}

/// Sums over the steps of a running window.
pub(super) struct ResultAccumulator {
    t0_ns: u64,
    /// Energy dissipated before the window, J.
    dissipated_before: f64,
    steps: u64,
    bodies: Vec<BodyResult>,
    solver: SolverResult,
}

impl ResultAccumulator {
    /// Starts a window from `state`.
    pub fn new(model: &Model, state: &State) -> Self {
        let zero = Vec3::zeros();
        let t0_ns = state.time_ns;
        // The first step of a run opens the ledger.
        let dissipated_before = if state.step == 0 { 0.0 } else { state.energy.dissipated };
        let body = BodyResult {
            impulse: zero,
            angular_impulse: zero,
            mean_force: zero,
            mean_torque: zero,
            moving_average_force: zero,
            moving_average_torque: zero,
            peak_force: zero,
            peak_torque: zero,
            peak_time_ns: t0_ns,
            work: 0.0,
            contacts: 0,
            pose: Pose::identity(),
            velocity: zero,
            angular_velocity: zero,
        };
        let bodies = vec![body; model.driven.len()];
        Self { t0_ns, dissipated_before, steps: 0, bodies, solver: SolverResult::default() }
    }

    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Returns true if every step converged.
    pub fn is_sound(&self) -> bool {
        self.solver.steps_not_converged == 0
    }

    /// Adds a step of length `h` (s) that has led to `state`.
    pub fn take(&mut self, report: &StepReport, state: &State, h: f64) {
        self.steps += 1;
        for (body, reaction) in self.bodies.iter_mut().zip(&report.reactions) {
            body.impulse += reaction.impulse;
            body.angular_impulse += reaction.angular_impulse;
            body.work += reaction.work;
            body.contacts = reaction.contacts;
            let force = reaction.impulse / h;
            if force.norm() > body.peak_force.norm() {
                body.peak_force = force;
                body.peak_torque = reaction.angular_impulse / h;
                body.peak_time_ns = state.time_ns;
            }
        }
        let solver = &mut self.solver;
        solver.force_difference += report.force_check.difference;
        solver.force_compared += report.force_check.total;
        solver.complementarity_gap += report.complementarity.gap;
        solver.infeasible_work += report.complementarity.infeasible;
        solver.dissipated = state.energy.dissipated - self.dissipated_before;
        solver.iterations += u64::from(report.iterations);
        solver.visits += report.visits;
        solver.steps_not_converged += u64::from(!report.converged);
        solver.residual_qm16 = solver.residual_qm16.max(report.residuals.qm16());
        solver.residual_natural_map = solver.residual_natural_map.max(report.residuals.natural_map);
        solver.contacts = report.contacts;
        solver.active_contacts = report.active_contacts;
        solver.mean_penetration = report.mean_penetration;
        solver.max_penetration = solver.max_penetration.max(report.max_penetration);
    }

    pub fn close(
        mut self,
        status: WindowStatus,
        error: Option<Error>,
        end: WindowEnd,
    ) -> WindowResult {
        let state = end.state;
        let seconds = (state.time_ns - self.t0_ns) as f64 * 1e-9;
        let ng = end.model.grains.len();
        for (d, body) in self.bodies.iter_mut().enumerate() {
            if seconds > 0.0 {
                body.mean_force = body.impulse / seconds;
                body.mean_torque = body.angular_impulse / seconds;
            }
            let [force, torque] = state.window.reactions.mean_wrench(d, end.model.stepping.h());
            (body.moving_average_force, body.moving_average_torque) = (force, torque);
            body.pose = state.pose(ng + d);
            body.velocity = state.velocity[ng + d];
            body.angular_velocity = state.angular_velocity[ng + d];
        }
        WindowResult {
            status,
            error,
            t0_ns: self.t0_ns,
            t1_ns: state.time_ns,
            steps: self.steps,
            max_knot_spacing_ns: end.hint(&self.bodies),
            bodies: self.bodies,
            zones: measure_zones(end.model, state, end.zones),
            squeezes: end.squeezes,
            solver: self.solver,
            energy: state.energy,
        }
    }
}

/// Measures zones on a state.
pub fn measure_zones(model: &Model, state: &State, zones: &[Zone]) -> Vec<ZoneResult> {
    if zones.is_empty() {
        return Vec::new();
    }
    let touching = observe::coordination(model, state);
    let measure = |zone: &Zone| {
        let flow = observe::inertial_number(model, state, zone);
        let compactness = observe::compactness(model, state, zone);
        ZoneResult {
            name: zone.name.clone(),
            region: zone.region,
            compactness: compactness.ok().map(|c| c.compactness),
            coordination: touching.mean_within(state, zone),
            inertial_number: flow.value,
            pressure: flow.pressure,
        }
    };
    zones.iter().map(measure).collect()
}

impl WindowEnd<'_> {
    /// Returns the maximum spacing of knots, ns, at least a step; 0 where no body moves.
    fn hint(&self, bodies: &[BodyResult]) -> u64 {
        let times = bodies.iter().enumerate();
        let time = |d, b: &BodyResult| {
            self.speed_limit.time(self.model, self.state, d, &b.velocity, &b.angular_velocity)
        };
        let times = times.map(|(d, b)| time(d, b));
        let time = times.fold(f64::INFINITY, f64::min) * 1e9;
        // Partners count time in signed numbers.
        if time < i64::MAX as f64 { (time as u64).max(self.model.stepping.step_ns) } else { 0 }
    }
}
