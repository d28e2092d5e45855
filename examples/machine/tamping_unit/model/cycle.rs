//! Cycle logic: phases, stops of the pairs, commands of the controller.

use super::Parameters;
use super::dynamics::{Commands, angular_velocity};
use std::fmt;

/// Phase of the tamping cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// The sleeper is lifted.
    Lift,
    /// The unit moves down.
    Insertion,
    /// Pairs close.
    Squeeze,
    /// Closed pairs stand still.
    Hold,
    /// The unit moves up and the pairs open.
    Withdrawal,
    /// All cycles have ended.
    Done,
}

/// Cause that stopped a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopCause {
    /// The load pressure has reached the preset one.
    Pressure,
    /// The closing has reached its limit.
    Stroke,
    /// The squeeze has lasted its longest time.
    Time,
}

/// Squeeze of a pair, at its stop.
#[derive(Debug, Clone)]
pub struct Squeeze {
    /// Number of the cycle, from 1.
    pub cycle: usize,
    /// Number of the pair.
    pub pair: usize,
    /// Time of the stop, s.
    pub time: f64,
    /// Cause of the stop.
    pub cause: StopCause,
    /// Mean closing of the blades without the vibration, m.
    pub closing: f64,
    /// Filtered load pressure, Pa.
    pub pressure: f64,
}

/// Action of a pair in a squeeze.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum PairAction {
    Close,
    Stop,
    StayOpen,
}

/// Values that the controller measures.
pub struct Measurement {
    /// Height of the unit above its start, m.
    pub height: f64,
    /// Mean closing of each pair without the vibration, m.
    pub closings: Vec<f64>,
    /// Filtered load pressure of each pair, Pa.
    pub pressures: Vec<f64>,
}

/// Controller of the cycle.
#[derive(Debug, Clone)]
pub struct Cycle {
    phase: Phase,
    since: f64,
    number: usize,
    actions: Vec<PairAction>,
    /// Squeezes that have ended.
    pub squeezes: Vec<Squeeze>,
}

/// Plan of the cycles.
#[derive(Debug, Clone)]
pub struct CyclePlan {
    /// Depth of the unit below its start, m.
    pub travel: f64,
    /// Numbers of the pairs that squeeze in each cycle.
    pub pairs_by_cycle: Vec<Vec<usize>>,
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.pad(&format!("{self:?}").to_lowercase())
    }
}

impl fmt::Display for StopCause {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.pad(&format!("{self:?}").to_lowercase())
    }
}

impl Cycle {
    /// Creates the controller of a number of pairs, at the start of the lift.
    pub fn new(pairs: usize) -> Self {
        let actions = vec![PairAction::Close; pairs];
        Self { phase: Phase::Lift, since: 0.0, number: 0, actions, squeezes: vec![] }
    }

    /// Returns the phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Returns the number of the cycle, from 1.
    pub fn number(&self) -> usize {
        self.number + 1
    }

    /// Advances the cycle at a time, s, and returns the commands until the next call.
    pub fn control(
        &mut self,
        t: f64,
        found: &Measurement,
        plan: &CyclePlan,
        p: &Parameters,
    ) -> Commands {
        self.change_phase(t, found, plan, p);
        let [target, speed] = self.commanded_depth(t - self.since, plan.travel, p);
        let flow = p.insertion_area * (speed + p.insertion_gain * (target + found.height));
        let largest = p.insertion_flow * (p.insertion_pressure / 35e5).sqrt();
        let is_done = self.phase == Phase::Done;
        Commands {
            insertion: (flow / largest).clamp(-1.0, 1.0),
            spools: self.actions.iter().map(|&action| self.spool(action)).collect(),
            angular_velocity: if is_done { 0.0 } else { angular_velocity(p.frequency) },
        }
    }

    fn change_phase(&mut self, t: f64, found: &Measurement, plan: &CyclePlan, p: &Parameters) {
        let age = t - self.since;
        match self.phase {
            Phase::Lift if age >= p.lift_time - 1e-9 => self.enter(Phase::Insertion, t),
            Phase::Insertion => {
                let is_deep = -found.height > plan.travel - p.depth_tolerance;
                if is_deep || age >= p.insertion_limit {
                    self.enter(Phase::Squeeze, t);
                    let squeezing = &plan.pairs_by_cycle[self.number];
                    for (pair, action) in self.actions.iter_mut().enumerate() {
                        let closes = squeezing.contains(&pair);
                        *action = if closes { PairAction::Close } else { PairAction::StayOpen };
                    }
                }
            }
            Phase::Squeeze => {
                self.stop_pairs(t, age, found, p);
                if !self.actions.contains(&PairAction::Close) {
                    self.enter(Phase::Hold, t);
                }
            }
            Phase::Hold if age >= p.hold_time => self.enter(Phase::Withdrawal, t),
            Phase::Withdrawal if -found.height < 0.01 && age >= p.withdrawal_time => {
                if self.number + 1 < plan.pairs_by_cycle.len() {
                    self.number += 1;
                    self.enter(Phase::Insertion, t);
                } else {
                    self.enter(Phase::Done, t);
                }
            }
            _ => {}
        }
    }

    fn enter(&mut self, phase: Phase, t: f64) {
        (self.phase, self.since) = (phase, t);
    }

    fn stop_pairs(&mut self, t: f64, age: f64, found: &Measurement, p: &Parameters) {
        for pair in 0..self.actions.len() {
            if self.actions[pair] != PairAction::Close {
                continue;
            }
            let (closing, pressure) = (found.closings[pair], found.pressures[pair]);
            let causes = [
                (pressure >= p.preset_pressure, StopCause::Pressure),
                (closing >= p.closing_limit, StopCause::Stroke),
                (age >= p.squeeze_time, StopCause::Time),
            ];
            if let Some((_, cause)) = causes.into_iter().find(|(is_reached, _)| *is_reached) {
                self.actions[pair] = PairAction::Stop;
                let cycle = self.number();
                self.squeezes.push(Squeeze { cycle, pair, time: t, cause, closing, pressure });
            }
        }
    }

    /// Returns the command of the squeeze valve of a pair: positive closes, negative opens.
    fn spool(&self, action: PairAction) -> f64 {
        match (self.phase, action) {
            (Phase::Squeeze, PairAction::Close) => 1.0,
            (Phase::Squeeze | Phase::Hold, PairAction::Stop) => 0.0,
            _ => -1.0,
        }
    }

    /// Returns the commanded depth of the unit, m, and its rate, m/s.
    fn commanded_depth(&self, age: f64, travel: f64, p: &Parameters) -> [f64; 2] {
        let ramp = |duration: f64| {
            let x = (age / duration).min(1.0);
            [travel * x * x * (3.0 - 2.0 * x), travel * 6.0 * x * (1.0 - x) / duration]
        };
        match self.phase {
            Phase::Lift | Phase::Done => [0.0, 0.0],
            Phase::Squeeze | Phase::Hold => [travel, 0.0],
            Phase::Insertion => ramp(p.insertion_time),
            Phase::Withdrawal => {
                let [depth, speed] = ramp(p.withdrawal_time);
                [travel - depth, -speed]
            }
        }
    }
}
