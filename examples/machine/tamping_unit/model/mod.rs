//! Model of a tamping unit: eccentric drive, squeeze cylinders with their supply, arms, insertion drive and cycle logic.
//!
//! An arm on a pivot carries each tine, so that the blade moves on an arc and tilts. A double-acting cylinder between the
//! upper end of the arm and the eccentric shaft closes it. A pair of facing tines shares a valve and stops by its own
//! pressure, stroke or time. The unit with all pivots moves vertically in a cylinder. Pump and accumulator feed all valves.
//! Energies are integrated with the motion. SI units; pressures are above that of the tank.

mod cycle;
mod dynamics;
mod parameters;

pub use cycle::{Phase, Squeeze};
pub use parameters::Parameters;

use ballast_coupling::{ForceRows, MotionRow, MotionRows, Partner, PartnerError};
use cycle::{Cycle, CyclePlan, Measurement};
use dynamics::{Arm, Dynamics, FRICTION, LEAK, MOTOR, P_S, PUMP, Pair, THROTTLE, TINES, VZ, Z};

/// Tine of the unit.
#[derive(Debug, Clone)]
pub struct Tine {
    /// Name of the body.
    pub name: String,
    /// Direction in which it closes: 1 towards +x, -1 towards -x.
    pub direction: f64,
    /// Number of its pair, from 0.
    pub pair: usize,
    /// Position of its reference point at the start, m.
    pub start: [f64; 3],
}

/// Sleeper that the unit lifts.
#[derive(Debug, Clone)]
pub struct Sleeper {
    /// Name of the body.
    pub name: String,
    /// Position of its reference point at the start, m.
    pub start: [f64; 3],
}

/// Values of the unit at the end of a time step.
#[derive(Debug, Clone)]
pub struct TraceRow {
    /// Depth of the unit below its start, m.
    pub depth: f64,
    /// Supply pressure, Pa.
    pub supply: f64,
    /// Closing of each blade, m.
    pub closing: Vec<f64>,
    /// Load pressure of each cylinder, Pa.
    pub pressure: Vec<f64>,
    /// Force of the ballast against the closing of each blade, N.
    pub force: Vec<f64>,
    /// Filtered load pressure of each pair, Pa.
    pub load_pressure: Vec<f64>,
}

/// Energies since the start, J.
#[derive(Debug, Clone, Copy, Default)]
pub struct Energies {
    /// Work of the pump.
    pub pump: f64,
    /// Work of the motor of the eccentric shaft.
    pub eccentric_motor: f64,
    /// Work of the lifting drive, which the sleeper gives to the ballast.
    pub lifting: f64,
    /// Stored energy.
    pub stored: f64,
    /// Energy dissipated in the valves.
    pub valves: f64,
    /// Energy dissipated by friction.
    pub friction: f64,
    /// Energy dissipated by leakage and relief.
    pub leakage_and_relief: f64,
    /// Work of the tines on the ballast.
    pub tines: f64,
}

/// State of a unit.
#[derive(Clone)]
pub struct UnitState {
    y: Vec<f64>,
    time: f64,
    cycle: Cycle,
    lifting: f64,
}

/// Tamping unit above a sleeper.
pub struct TampingUnit {
    tines: Vec<Tine>,
    sleeper: Sleeper,
    plan: CyclePlan,
    dynamics: Dynamics,
    state: UnitState,
    stored_at_start: f64,
    trace: Vec<TraceRow>,
}

impl TampingUnit {
    /// Creates a unit at rest.
    ///
    /// `travel` is its way to full depth, m; `pairs_by_cycle` has the numbers of the pairs that squeeze in each cycle.
    pub fn new(
        tines: Vec<Tine>,
        sleeper: Sleeper,
        travel: f64,
        parameters: Parameters,
        pairs_by_cycle: Vec<Vec<usize>>,
    ) -> Self {
        let signs = tines.iter().map(|tine| tine.direction).collect();
        let pair_of = tines.iter().map(|tine| tine.pair).collect();
        let dynamics = Dynamics::new(parameters, signs, pair_of);
        let y = dynamics.rest();
        Self {
            tines,
            sleeper,
            plan: CyclePlan { travel, pairs_by_cycle },
            stored_at_start: dynamics.stored(&y),
            state: UnitState { y, time: 0.0, cycle: Cycle::new(dynamics.pairs()), lifting: 0.0 },
            dynamics,
            trace: vec![],
        }
    }

    /// Returns the phase of the cycle.
    pub fn phase(&self) -> Phase {
        self.state.cycle.phase()
    }

    /// Returns the number of the cycle, from 1.
    pub fn cycle(&self) -> usize {
        self.state.cycle.number()
    }

    /// Returns the squeezes that have ended.
    pub fn squeezes(&self) -> &[Squeeze] {
        &self.state.cycle.squeezes
    }

    /// Returns the tines.
    pub fn tines(&self) -> &[Tine] {
        &self.tines
    }

    /// Returns the way of the unit to full depth, m.
    pub fn travel(&self) -> f64 {
        self.plan.travel
    }

    /// Returns the values of each time step of the last window.
    pub fn trace(&self) -> &[TraceRow] {
        &self.trace
    }

    /// Returns the closing of each blade, m.
    pub fn closings(&self) -> Vec<f64> {
        let angles = (0..self.tines.len()).map(|i| self.arm(Arm::Phi, i));
        angles.map(|phi| self.dynamics.p.lower_length * phi.sin()).collect()
    }

    /// Returns the energies since the start.
    pub fn energies(&self) -> Energies {
        let y = &self.state.y;
        Energies {
            pump: y[PUMP],
            eccentric_motor: y[MOTOR],
            lifting: self.state.lifting,
            stored: self.dynamics.stored(y) - self.stored_at_start,
            valves: y[THROTTLE],
            friction: y[FRICTION],
            leakage_and_relief: y[LEAK],
            tines: y[TINES],
        }
    }

    /// Returns the motion of the blades and of the lifted sleeper.
    fn motion(&self) -> MotionRows {
        let blades = self.tines.iter().enumerate();
        let mut rows: MotionRows =
            blades.map(|(i, tine)| (tine.name.clone(), self.blade(i))).collect();
        let ([x, y, z], [height, speed]) = (self.sleeper.start, self.lift(self.state.time));
        let row = [x, y, z + height, 0.0, 0.0, 0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0];
        rows.insert(self.sleeper.name.clone(), row);
        rows
    }

    /// Returns the motion of a blade.
    fn blade(&self, i: usize) -> MotionRow {
        let (phi, sign) = (self.arm(Arm::Phi, i), self.tines[i].direction);
        // A positive turn about y moves what is below the pivot towards -x.
        let (turn, rate) = (-sign * phi, -sign * self.arm(Arm::Dphi, i));
        let [x, z] = self.dynamics.tip(i, phi);
        let [x0, y0, z0] = self.tines[i].start;
        let (height, speed) = (self.state.y[Z], self.state.y[VZ]);
        let below = z0 + z + self.dynamics.p.lower_length + height;
        [x0 + x, y0, below, 0.0, turn, 0.0, rate * z, 0.0, speed - rate * x, 0.0, rate, 0.0]
    }

    /// Returns height (m) and speed (m/s) of the sleeper at a time, s.
    fn lift(&self, t: f64) -> [f64; 2] {
        let p = &self.dynamics.p;
        let x = (t / p.lift_time).clamp(0.0, 1.0);
        let rate = 6.0 * x * (1.0 - x) / p.lift_time;
        [p.lift_height * x * x * (3.0 - 2.0 * x), p.lift_height * rate]
    }

    fn measure(&self) -> Measurement {
        let mean = |pair: usize| {
            let arms = self.tines.iter().enumerate().filter(|(_, tine)| tine.pair == pair);
            let closings = arms.map(|(i, _)| self.dynamics.closing_by_cylinder(&self.state.y, i));
            let (sum, count) = closings.fold((0.0, 0.0), |(sum, n), c| (sum + c, n + 1.0));
            sum / count
        };
        let pairs = 0..self.dynamics.pairs();
        Measurement {
            height: self.state.y[Z],
            closings: pairs.clone().map(mean).collect(),
            pressures: pairs.map(|k| self.state.y[self.dynamics.pair(Pair::Sensor2, k)]).collect(),
        }
    }

    /// Advances the unit through a time step with constant forces; `lift` is the force on the sleeper, N.
    fn step(&mut self, ends: [f64; 2], loads: &[[f64; 3]], lift: f64) -> Result<(), PartnerError> {
        let found = self.measure();
        let p = &self.dynamics.p;
        let commands = self.state.cycle.control(ends[0], &found, &self.plan, p);
        self.state.y = self.dynamics.integrate(ends, &self.state.y, loads, &commands)?;
        self.state.time = ends[1];
        self.state.lifting -= lift * (self.lift(ends[1])[0] - self.lift(ends[0])[0]);
        self.trace.push(self.trace_row(loads));
        Ok(())
    }

    fn trace_row(&self, loads: &[[f64; 3]]) -> TraceRow {
        let (y, arms) = (&self.state.y, 0..self.tines.len());
        TraceRow {
            depth: -y[Z],
            supply: y[P_S],
            closing: self.closings(),
            pressure: arms.clone().map(|i| self.dynamics.load_pressure(y, i)).collect(),
            force: arms.map(|i| -self.tines[i].direction * loads[i][0]).collect(),
            load_pressure: self.measure().pressures,
        }
    }

    fn arm(&self, part: Arm, i: usize) -> f64 {
        self.state.y[self.dynamics.arm(part, i)]
    }
}

impl Partner for TampingUnit {
    type State = UnitState;

    /// Forces of the ballast and commands of the controller are constant in each time step.
    fn advance(
        &mut self,
        t0: f64,
        t1: f64,
        forces: &ForceRows,
    ) -> Result<MotionRows, PartnerError> {
        let steps = forces[&self.sleeper.name].len();
        let time = |k: usize| t0 + (t1 - t0) * k as f64 / steps as f64;
        self.trace.clear();
        for k in 0..steps {
            let load = |tine: &Tine| [0, 2, 4].map(|part| forces[&tine.name][k][part]);
            let loads: Vec<_> = self.tines.iter().map(load).collect();
            let lift = forces[&self.sleeper.name][k][2];
            self.step([time(k), time(k + 1)], &loads, lift)?;
        }
        Ok(self.motion())
    }

    fn save(&self) -> UnitState {
        self.state.clone()
    }

    fn restore(&mut self, state: &UnitState) {
        self.state = state.clone();
    }
}
