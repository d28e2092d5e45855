//! Rates of the state, and the energies.

use super::Parameters;
use ivp::prelude::{IVP, Method, Options, Status, solve_ivp};
use std::f64::consts::PI;
use std::fmt;

/// Acceleration of gravity, m/s².
const GRAVITY: f64 = 9.81;
/// Pressure at which the flow of valves is given, Pa.
const NOMINAL_PRESSURE: f64 = 35e5;
/// Relative tolerance of the integration.
const TOLERANCE: f64 = 1e-5;

/// Height of the unit above its start, m.
pub const Z: usize = 0;
/// Vertical speed of the unit, m/s.
pub const VZ: usize = 1;
/// Pressure in the insertion cylinder, Pa.
pub const P_INS: usize = 2;
/// Spool of the insertion valve.
pub const S_INS: usize = 3;
/// Angle of the eccentric shaft, rad.
pub const THETA: usize = 4;
/// Angular velocity of the eccentric shaft, rad/s.
pub const OMEGA: usize = 5;
/// Supply pressure, Pa.
pub const P_S: usize = 6;
/// Work of the pump, J; the other works follow it.
pub const PUMP: usize = 7;
/// Work of the motor of the eccentric shaft, J.
pub const MOTOR: usize = 8;
/// Energy dissipated in the valves, J.
pub const THROTTLE: usize = 9;
/// Energy dissipated by friction, J.
pub const FRICTION: usize = 10;
/// Energy dissipated by leakage and relief, J.
pub const LEAK: usize = 11;
/// Work of the tines on the ballast, J.
pub const TINES: usize = 12;
/// Number of values that belong to no arm and no pair.
const SHARED: usize = 13;

/// Part of the state that belongs to an arm.
#[derive(Clone, Copy)]
pub enum Arm {
    /// Angle of the arm, rad.
    Phi,
    /// Angular velocity of the arm, rad/s.
    Dphi,
    /// Pressure in the chamber that closes the arm, Pa.
    Pa,
    /// Pressure in the chamber that opens the arm, Pa.
    Pb,
}

/// Part of the state that belongs to a pair of tines.
#[derive(Clone, Copy)]
pub enum Pair {
    /// Spool of the squeeze valve.
    Spool,
    /// Load pressure after the first filter, Pa.
    Sensor1,
    /// Load pressure after both filters, Pa.
    Sensor2,
}

/// Commands of the controller in a time step.
#[derive(Clone)]
pub struct Commands {
    /// Command of the insertion valve.
    pub insertion: f64,
    /// Commands of the squeeze valves, by pair.
    pub spools: Vec<f64>,
    /// Angular velocity of the eccentric shaft, rad/s.
    pub angular_velocity: f64,
}

/// Mechanics and hydraulics of the unit, with arms numbered like the tines.
#[derive(Clone)]
pub struct Dynamics {
    /// Parameters.
    pub p: Parameters,
    /// Direction in which each tine closes: 1 towards +x, -1 towards -x.
    pub signs: Vec<f64>,
    /// Number of the pair of each arm.
    pub pair_of: Vec<usize>,
    pairs: usize,
    area: [f64; 2],
    chambers: [f64; 2],
    seat: f64,
}

/// Dynamics in a time step, with constant loads and commands.
struct StepDynamics<'a> {
    dynamics: &'a Dynamics,
    /// Forces along x and z (N) and torque about y (N m) by the ballast at each blade.
    loads: &'a [[f64; 3]],
    commands: &'a Commands,
}

/// Sums over the arms.
#[derive(Default)]
struct ArmSums {
    /// Torque of the cylinders on the eccentric shaft, N m.
    shaft_load: f64,
    /// Oil taken from the supply, m³/s.
    used: f64,
    /// Power lost in valves, W.
    throttled: f64,
    /// Power lost by friction, W.
    rubbed: f64,
    /// Power lost by leakage and relief, W.
    leaked: f64,
    /// Power given to the ballast by the closing, W.
    given: f64,
    /// Mean load pressure of each pair, Pa.
    pressures: Vec<f64>,
}

/// Failure of the integration: its final status or its error.
#[derive(Debug)]
pub struct IntegrationError(String);

impl fmt::Display for IntegrationError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "integration of the tamping unit: {}", self.0)
    }
}

impl std::error::Error for IntegrationError {}

impl Dynamics {
    /// Creates the dynamics of arms that close in the directions `signs` and belong to the pairs `pair_of`.
    pub fn new(p: Parameters, signs: Vec<f64>, pair_of: Vec<usize>) -> Self {
        Self {
            pairs: pair_of.iter().max().map_or(0, |last| last + 1),
            area: [p.piston_area(), p.rod_area()],
            chambers: p.chambers(),
            seat: p.seat(),
            p,
            signs,
            pair_of,
        }
    }

    /// Returns the number of pairs.
    pub fn pairs(&self) -> usize {
        self.pairs
    }

    /// Returns the place of a value of an arm in the state.
    pub fn arm(&self, part: Arm, i: usize) -> usize {
        SHARED + part as usize * self.signs.len() + i
    }

    /// Returns the place of a value of a pair in the state.
    pub fn pair(&self, part: Pair, k: usize) -> usize {
        SHARED + 4 * self.signs.len() + part as usize * self.pairs + k
    }

    /// Returns the state at rest: unit up, tines open, supply under pressure.
    pub fn rest(&self) -> Vec<f64> {
        let mut y = vec![0.0; self.pair(Pair::Sensor2, self.pairs)];
        y[P_S] = self.p.supply_pressure;
        y[P_INS] = -self.p.unit_mass * GRAVITY / self.p.insertion_area;
        (0..self.signs.len()).for_each(|i| y[self.arm(Arm::Pb, i)] = self.p.supply_pressure);
        y
    }

    /// Returns the state at `t1` from that at `t0`, s, under constant loads and commands.
    ///
    /// # Errors
    /// The integration does not reach `t1`.
    pub fn integrate(
        &self,
        [t0, t1]: [f64; 2],
        y: &[f64],
        loads: &[[f64; 3]],
        commands: &Commands,
    ) -> Result<Vec<f64>, IntegrationError> {
        let step = StepDynamics { dynamics: self, loads, commands };
        let options = Options::builder()
            .method(Method::DOPRI5)
            .rtol(TOLERANCE)
            .atol(self.absolute_tolerances())
            .build();
        let mut solution = solve_ivp(&step, t0, t1, y, options)
            .map_err(|error| IntegrationError(format!("{error:?}")))?;
        match (solution.status, solution.y.pop()) {
            (Status::Success, Some(end)) => Ok(end),
            (status, _) => Err(IntegrationError(format!("{status:?}"))),
        }
    }

    /// Returns absolute tolerances: pressures are in Pa, energies in J.
    fn absolute_tolerances(&self) -> Vec<f64> {
        let mut tolerance = vec![1e-8; self.pair(Pair::Sensor2, self.pairs)];
        let arms = (0..self.signs.len()).flat_map(|i| [self.arm(Arm::Pa, i), self.arm(Arm::Pb, i)]);
        let sensors = (0..self.pairs)
            .flat_map(|k| [self.pair(Pair::Sensor1, k), self.pair(Pair::Sensor2, k)]);
        [P_INS, P_S].into_iter().chain(arms).chain(sensors).for_each(|at| tolerance[at] = 10.0);
        tolerance[PUMP..=TINES].fill(1e-3);
        tolerance
    }

    /// Returns the place of a blade relative to its pivot: x and z, m.
    pub fn tip(&self, i: usize, phi: f64) -> [f64; 2] {
        let (sine, cosine) = phi.sin_cos();
        [self.signs[i] * self.p.lower_length * sine, -self.p.lower_length * cosine]
    }

    /// Returns the way of a piston from the stop of the open tines, m.
    pub fn piston(&self, y: &[f64], i: usize) -> f64 {
        let shaft = self.p.eccentricity() * y[THETA].sin();
        self.p.upper_length * y[self.arm(Arm::Phi, i)] - shaft - self.seat
    }

    /// Returns the closing of blade `i` without the vibration, m, as a sensor on its cylinder measures it.
    pub fn closing_by_cylinder(&self, y: &[f64], i: usize) -> f64 {
        let extension = self.piston(y, i) + self.seat;
        self.p.lower_length * (extension / self.p.upper_length).sin()
    }

    /// Returns the force of the end stops on a piston (N), and the overlap (m), negative at the stop of the open tines.
    fn end_stop(&self, piston: f64, speed: f64) -> [f64; 2] {
        let p = &self.p;
        let over = piston - self.p.cylinder_stroke;
        if piston < 0.0 {
            [(-p.stop_stiffness * piston - p.stop_damping * speed).max(0.0), piston]
        } else if over > 0.0 {
            [-(p.stop_stiffness * over + p.stop_damping * speed).max(0.0), over]
        } else {
            [0.0, 0.0]
        }
    }

    /// Returns the load pressure of a cylinder, Pa.
    pub fn load_pressure(&self, y: &[f64], i: usize) -> f64 {
        y[self.arm(Arm::Pa, i)] - y[self.arm(Arm::Pb, i)] * self.area[1] / self.area[0]
    }

    /// Returns the stored energy, J: kinetic, potential, of the oil, of the accumulator and of the end stops.
    pub fn stored(&self, y: &[f64]) -> f64 {
        let p = &self.p;
        let [volume_a, volume_b] = self.chambers;
        let mut twice = p.unit_mass * y[VZ] * y[VZ]
            + p.eccentric_inertia * y[OMEGA] * y[OMEGA]
            + 0.25 * p.insertion_volume / p.bulk_modulus * y[P_INS] * y[P_INS]
            + p.accumulator * y[P_S] * y[P_S];
        for i in 0..self.signs.len() {
            let [dphi, pa, pb] = [Arm::Dphi, Arm::Pa, Arm::Pb].map(|part| y[self.arm(part, i)]);
            let piston = self.piston(y, i);
            let overlap = piston.min(0.0) + (piston - self.p.cylinder_stroke).max(0.0);
            twice += p.arm_inertia * dphi * dphi
                + (volume_a * pa * pa + volume_b * pb * pb) / p.bulk_modulus
                + p.stop_stiffness * overlap * overlap;
        }
        0.5 * twice + p.unit_mass * GRAVITY * y[Z]
    }
}

impl IVP for StepDynamics<'_> {
    fn ode(&self, _t: f64, y: &[f64], rates: &mut [f64]) {
        let mut sums = ArmSums { pressures: vec![0.0; self.dynamics.pairs], ..ArmSums::default() };
        for i in 0..self.loads.len() {
            self.arm_rates(i, y, rates, &mut sums);
        }
        self.pair_rates(y, rates, &sums.pressures);
        self.shaft_rates(y, rates, &sums);
        let flow = self.insertion_rates(y, rates, &sums);
        let p = &self.dynamics.p;
        let pumped = (p.pump_gain * (p.supply_pressure - y[P_S])).clamp(0.0, p.pump_flow);
        rates[P_S] = (pumped - sums.used - flow) / p.accumulator;
        rates[PUMP] = pumped * y[P_S];
    }
}

impl StepDynamics<'_> {
    /// Computes the rates of an arm with its cylinder.
    fn arm_rates(&self, i: usize, y: &[f64], rates: &mut [f64], sums: &mut ArmSums) {
        let unit = self.dynamics;
        let p = &unit.p;
        let at = |part| unit.arm(part, i);
        let [phi, dphi, pa, pb] = [Arm::Phi, Arm::Dphi, Arm::Pa, Arm::Pb].map(|part| y[at(part)]);
        let [area_a, area_b] = unit.area;
        let swing = p.eccentricity() * y[THETA].cos();
        // Cylinder between arm and eccentric shaft.
        let speed = p.upper_length * dphi - swing * y[OMEGA];
        let friction =
            p.seal_friction * (speed / p.friction_speed).tanh() + p.viscous_friction * speed;
        let [stop, overlap] = unit.end_stop(unit.piston(y, i), speed);
        let force = pa * area_a - pb * area_b + stop - friction;
        sums.shaft_load -= force * swing;
        // Arm on its pivot.
        let [x, z] = unit.tip(i, phi);
        let [fx, fz, my] = self.loads[i];
        let by_ballast = -unit.signs[i] * (fx * z - fz * x + my);
        rates[at(Arm::Phi)] = dphi;
        rates[at(Arm::Dphi)] =
            (p.upper_length * force + by_ballast - p.pivot_damping * dphi) / p.arm_inertia;
        // Oil of both chambers; check valves let oil in from the tank where a chamber grows faster than its flow.
        let (valve, check) = (flow_coefficient(p.valve_flow), flow_coefficient(p.check_flow));
        let (supply, spool) = (y[P_S], y[unit.pair(Pair::Spool, unit.pair_of[i])]);
        let (opened, closed) = (valve * spool.max(0.0), valve * (-spool).max(0.0));
        let (to_a, from_a) = (opened * root(supply - pa), closed * root(pa));
        let (to_b, from_b) = (closed * root(supply - pb), opened * root(pb));
        let leak = p.leakage * (pa - pb);
        let relief = |pressure: f64| {
            p.relief_gain * (pressure - p.relief_pressure).max(0.0)
                - check * root((-pressure).max(0.0))
        };
        let (out_a, out_b) = (relief(pa), relief(pb));
        let [volume_a, volume_b] = unit.chambers;
        rates[at(Arm::Pa)] =
            p.bulk_modulus / volume_a * (to_a - from_a - area_a * speed - leak - out_a);
        rates[at(Arm::Pb)] =
            p.bulk_modulus / volume_b * (to_b - from_b + area_b * speed + leak - out_b);
        let arms = unit.pair_of.iter().filter(|&&pair| pair == unit.pair_of[i]).count();
        sums.pressures[unit.pair_of[i]] += unit.load_pressure(y, i) / arms as f64;
        // Power.
        sums.used += to_a + to_b;
        sums.throttled += (supply - pa) * to_a + pa * from_a + (supply - pb) * to_b + pb * from_b;
        sums.rubbed += friction * speed - (stop + p.stop_stiffness * overlap) * speed
            + p.pivot_damping * dphi * dphi;
        sums.leaked += leak * (pa - pb) + pa * out_a + pb * out_b;
        sums.given -= by_ballast * dphi;
    }

    /// Computes the rates of sensors and spools.
    fn pair_rates(&self, y: &[f64], rates: &mut [f64], pressures: &[f64]) {
        let p = &self.dynamics.p;
        for (k, pressure) in pressures.iter().enumerate() {
            let [spool, first, second] =
                [Pair::Spool, Pair::Sensor1, Pair::Sensor2].map(|part| self.dynamics.pair(part, k));
            rates[first] = (pressure - y[first]) / p.sensor_time;
            rates[second] = (y[first] - y[second]) / p.sensor_time;
            rates[spool] = (self.commands.spools[k] - y[spool]) / p.valve_time;
        }
    }

    /// Computes the rates of the eccentric shaft.
    fn shaft_rates(&self, y: &[f64], rates: &mut [f64], sums: &ArmSums) {
        let p = &self.dynamics.p;
        let omega = y[OMEGA];
        let torque = (p.motor_gain * (self.commands.angular_velocity - omega))
            .clamp(-p.motor_torque, p.motor_torque);
        rates[THETA] = omega;
        rates[OMEGA] = (torque + sums.shaft_load - p.bearing_damping * omega) / p.eccentric_inertia;
        rates[MOTOR] = torque * omega;
    }

    /// Computes the rates of the insertion drive and of the losses, and returns the oil that it takes, m³/s.
    ///
    /// Positive spool and pressure lower the unit.
    fn insertion_rates(&self, y: &[f64], rates: &mut [f64], sums: &ArmSums) -> f64 {
        let p = &self.dynamics.p;
        let (spool, pressure, speed, supply) = (y[S_INS], y[P_INS], y[VZ], y[P_S]);
        let sign = if spool >= 0.0 { 1.0 } else { -1.0 };
        let available = if sign > 0.0 { supply.min(p.insertion_pressure) } else { supply };
        let flow =
            flow_coefficient(p.insertion_flow) * spool.abs() * root(available - sign * pressure);
        let lift: f64 = self.loads.iter().map(|load| load[1]).sum();
        let guide_friction = p.insertion_friction * (speed / p.friction_speed).tanh();
        let oil = sign * flow + p.insertion_area * speed - p.leakage * pressure;
        rates[P_INS] = oil * 4.0 * p.bulk_modulus / p.insertion_volume;
        rates[S_INS] = (self.commands.insertion - spool) / p.insertion_valve_time;
        rates[Z] = speed;
        rates[VZ] = (lift - p.insertion_area * pressure - guide_friction) / p.unit_mass - GRAVITY;
        rates[THROTTLE] = sums.throttled + (supply - sign * pressure) * flow;
        rates[FRICTION] =
            sums.rubbed + p.bearing_damping * y[OMEGA] * y[OMEGA] + guide_friction * speed;
        rates[LEAK] = sums.leaked + p.leakage * pressure * pressure;
        rates[TINES] = sums.given - lift * speed;
        flow
    }
}

/// Returns the flow coefficient of a valve from its nominal flow.
fn flow_coefficient(flow: f64) -> f64 {
    flow / NOMINAL_PRESSURE.sqrt()
}

/// Returns the angular velocity of a frequency in Hz, rad/s.
pub fn angular_velocity(frequency: f64) -> f64 {
    2.0 * PI * frequency
}

/// Returns the signed square root of a pressure difference, linear below 1 bar.
fn root(pressure: f64) -> f64 {
    pressure / (pressure * pressure + 1e10).sqrt().sqrt()
}
