//! The machine's motion: lift, insertion, squeeze, hold, withdrawal, release of the sleepers; then traffic. Beside it the
//! plates, which have motions and loads of the case too.
//!
//! Reads: plan, model, state; reactions of the tines. Writes: targets of the driven bodies, and the
//! [`TampingState`].
//! Contract: positions are continuous, and velocities of tines and sleepers too. Targets are rigid translations; a tine on
//! a springy shaft follows its target as its mount lets it (T-28).

use super::clearance::{self, MAX_PROTRUSION};
use super::machine_control::{MachineControl, TampingState, TinePair, driven_index};
use super::motion_law::{ramp, sine_between, travel};
use super::plate::check_program;
use crate::error::{Error, Result};
use crate::math::{Pose, Vec3};
use crate::model::check::expect;
use crate::model::{DofMode, Model};
use crate::state::{DriverState, State};
use crate::step::StepReport;
use crate::track::plan::{LoadCycles, Plan, PlatePlan, SleeperPlan, TampingPlan};

/// Least clearance of tines without a cycle, m: that of the cases that have one and do not say it.
const IDLE_CLEARANCE: f64 = 0.02;
/// Fewer steps per period of the vibration would alias the sine into another motion.
pub const MIN_STEPS_PER_PERIOD: f64 = 8.0;

/// Phase of a tamping cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum TampingPhase {
    /// Before the cycle starts.
    Waiting,
    /// Lift of the tamped sleepers.
    Lift,
    /// Lowering of the tines into the ballast.
    Insertion,
    /// Closing of the pairs of tines.
    Squeeze,
    /// Rest of the closed tines, which still vibrate.
    Hold,
    /// Opening and raising of the tines.
    Withdrawal,
    /// Lowering of the tamped sleepers onto the ballast.
    Release,
    /// Load cycles on the tamped sleepers.
    Traffic,
    /// After the cycle, or no tamping at all.
    Done,
}

impl TampingPhase {
    /// All phases in the order of the cycle; in files a phase's number is its place among them.
    pub const ALL: [TampingPhase; 9] = [
        TampingPhase::Waiting,
        TampingPhase::Lift,
        TampingPhase::Insertion,
        TampingPhase::Squeeze,
        TampingPhase::Hold,
        TampingPhase::Withdrawal,
        TampingPhase::Release,
        TampingPhase::Traffic,
        TampingPhase::Done,
    ];

    /// The phase's name in files and recordings.
    pub fn name(self) -> &'static str {
        match self {
            TampingPhase::Waiting => "waiting",
            TampingPhase::Lift => "lift",
            TampingPhase::Insertion => "insertion",
            TampingPhase::Squeeze => "squeeze",
            TampingPhase::Hold => "hold",
            TampingPhase::Withdrawal => "withdrawal",
            TampingPhase::Release => "release",
            TampingPhase::Traffic => "traffic",
            TampingPhase::Done => "done",
        }
    }

    /// The phase of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|phase| phase.name() == name)
    }
}

/// A tamping cycle over the driven bodies of a model, with the motions and loads of plates.
#[derive(Debug, Clone, PartialEq)]
pub struct TampingCycle {
    /// `None`: neither tines nor sleepers move.
    machine: Option<Machine>,
    /// Plates with a motion or a load, and their indices among the driven bodies.
    plates: Vec<(usize, PlatePlan)>,
}

#[derive(Debug, Clone, PartialEq)]
struct Machine {
    plan: TampingPlan,
    /// Ends of lift, insertion, squeeze, hold, withdrawal, release and traffic, s.
    ends: [f64; 7],
    sleepers: Vec<Lifted>,
    tines: Vec<TinePath>,
    control: MachineControl,
}

/// A tamped sleeper: its index among the driven bodies, and where it stands before the lift.
#[derive(Debug, Clone, PartialEq)]
struct Lifted {
    body: usize,
    rest: Vec3,
}

/// Path of a tine through the cycle.
#[derive(Debug, Clone, PartialEq)]
pub struct TinePath {
    /// Index among the driven bodies.
    pub body: usize,
    /// Index into [`TampingCycle::pairs`].
    pub pair: usize,
    /// Direction of its squeeze along x: 1 or -1.
    pub direction: f64,
    /// Position of its reference point before the cycle, m.
    pub start: Vec3,
    /// Height of the reference point at full depth, m.
    pub deep: f64,
    /// Closing distance, m.
    pub stroke: f64,
}

impl TampingCycle {
    /// Kind of the encoded state.
    pub const KIND: &str = "tamping_cycle";
    /// Version of the encoded state.
    const VERSION: u32 = 1;

    /// The cycle of `plan` for a model that holds the plan's sleepers, tines and plates.
    ///
    /// # Errors
    /// Times, speeds or forces that are no cycle; bodies that the model does not have;
    /// tines that would meet a sleeper or a wall on their way.
    pub fn new(plan: &Plan, model: &Model) -> Result<Self> {
        let plates = driven_plates(plan, model)?;
        let Some(tamping) = plan.tamping else { return Ok(Self { machine: None, plates }) };
        check_numbers(&tamping)?;
        check_period(plan, &tamping, model)?;
        clearance::check(plan, &tamping)?;
        let control = MachineControl::new(&tamping, &plan.tines, model)?;
        let tines = driven_tines(plan, &tamping, model, &control)?;
        let sleepers = lifted_sleepers(plan, model)?;
        Ok(Self {
            machine: Some(Machine {
                ends: tamping.ends(),
                plan: tamping,
                sleepers,
                tines,
                control,
            }),
            plates,
        })
    }

    /// Poses of all driven bodies at the end of the step that starts at `state`; what the cycle
    /// does not move stays where it is.
    ///
    /// `out` is overwritten `[nd]`.
    pub fn targets(
        &self,
        model: &Model,
        state: &State,
        tamping: &TampingState,
        out: &mut Vec<Pose>,
    ) {
        out.clear();
        out.extend((0..model.driven.len()).map(|d| state.imposed(model, d)));
        self.positions(model, state, tamping, |body, position| out[body].position = position);
    }

    /// Calls `set` for each body that the cycle moves, with its index among the driven bodies and its position (m) at
    /// the end of the step that starts at `state`.
    pub fn positions(
        &self,
        model: &Model,
        state: &State,
        tamping: &TampingState,
        mut set: impl FnMut(usize, Vec3),
    ) {
        let end_ns = state.time_ns + model.stepping.step_ns;
        for (body, plate) in self.plates.iter().filter(|(_, plate)| plate.is_moved()) {
            // From where it is: a plate without a height of the plan has been lowered onto the grains.
            let way = plate.displacement(end_ns) - plate.displacement(state.time_ns);
            set(*body, state.imposed(model, *body).position + way);
        }
        let Some(machine) = &self.machine else { return };
        let end = clock(end_ns);
        let lift = machine.lift(end);
        for sleeper in &machine.sleepers {
            set(sleeper.body, sleeper.rest + Vec3::z() * lift);
        }
        let h = model.stepping.h();
        let [inserting, squeezing] = machine.since(end);
        let lowered = machine.control.lowered_next(tamping, inserting, h);
        for tine in &machine.tines {
            let squeezed = machine.control.squeezed_next(tamping, tine.pair, squeezing, h);
            set(tine.body, machine.tine_position(tine, end, lowered, squeezed));
        }
    }

    /// Calls `set` for each plate with a load and each sleeper that carries traffic in the step that starts at `time_ns`, with
    /// its index among the driven bodies and the force on it (N).
    pub fn loads(&self, model: &Model, time_ns: u64, mut set: impl FnMut(usize, Vec3)) {
        let middle_ns = time_ns + model.stepping.step_ns / 2;
        for (body, plate) in self.plates.iter().filter(|(_, plate)| !plate.load.is_empty()) {
            set(*body, plate.force(middle_ns));
        }
        let Some(machine) = &self.machine else { return };
        let Some(traffic) = &machine.plan.traffic else { return };
        let load = traffic.load(clock(middle_ns) - machine.ends[5]);
        if load > 0.0 {
            let force = Vec3::new(0.0, 0.0, -load);
            machine.sleepers.iter().for_each(|sleeper| set(sleeper.body, force));
        }
    }

    /// Takes the reactions of the step that has just led to `state` into the state of the cycle.
    pub fn observe(
        &self,
        model: &Model,
        report: &StepReport,
        state: &State,
        tamping: &mut TampingState,
    ) {
        let Some(machine) = &self.machine else { return };
        let since = machine.since(clock(state.time_ns));
        let h = model.stepping.h();
        machine.control.observe(tamping, report, state.step, since, h);
    }

    /// Encodes the state of the cycle for checkpoints.
    pub fn encode(&self, tamping: &TampingState) -> DriverState {
        let control = self.machine.as_ref().map(|m| &m.control);
        let values = control.map_or_else(Vec::new, |control| control.encode(tamping));
        DriverState { kind: Self::KIND.into(), version: Self::VERSION, values }
    }

    /// Decodes a state of the cycle; that of no driver is the state before the first step.
    ///
    /// # Errors
    /// [`Error::State`] for a state of another driver, or of another cycle.
    pub fn decode(&self, saved: &DriverState) -> Result<TampingState> {
        let values = saved.values_of(Self::KIND, Self::VERSION)?.unwrap_or_default();
        match &self.machine {
            Some(machine) => machine.control.decode(values),
            None if values.is_empty() => Ok(TampingState::default()),
            None => Err(Error::State {
                place: "driver state".into(),
                expected: "no values: the case has no tamping".into(),
                found: values.len().to_string(),
            }),
        }
    }

    /// Phase at a time of the run, s.
    pub fn phase(&self, time_s: f64) -> TampingPhase {
        let Some(machine) = &self.machine else { return TampingPhase::Done };
        // In nanoseconds, as time is counted: sums of seconds miss them by rounding.
        let ns = |time: f64| (1e9 * time).round();
        let is_over = |end: f64| ns(time_s) >= ns(end);
        if !is_over(machine.plan.start) {
            return TampingPhase::Waiting;
        }
        let ended = machine.ends.iter().take_while(|end| is_over(**end)).count();
        // The first that can end is the one after waiting.
        TampingPhase::ALL[1 + ended]
    }

    /// Time of the run at which the cycle is over, s; 0 without tamping.
    pub fn duration(&self) -> f64 {
        self.machine.as_ref().map_or(0.0, |m| m.ends[6])
    }

    /// The ways of the tines; none without tamping.
    pub fn tines(&self) -> &[TinePath] {
        self.machine.as_ref().map_or(&[], |m| &m.tines)
    }

    /// The tine pairs in order of their numbers.
    pub fn pairs(&self) -> &[TinePair] {
        self.machine.as_ref().map_or(&[], |m| &m.control.pairs)
    }

    /// Closing of each side of pair `p` (index into [`Self::pairs`]) before the withdrawal, m.
    pub fn closing(&self, tamping: &TampingState, p: usize) -> f64 {
        self.machine.as_ref().map_or(0.0, |m| m.closing(m.control.squeezed(tamping, p)))
    }

    /// Fraction of the way down to full depth before the withdrawal, 0 to 1.
    pub fn insertion(&self, tamping: &TampingState) -> f64 {
        self.machine.as_ref().map_or(0.0, |m| m.depth(m.control.lowered(tamping)))
    }

    /// Mean force of pair `p` over the last vibration period, N.
    pub fn mean_force(&self, tamping: &TampingState, p: usize) -> f64 {
        self.machine.as_ref().map_or(0.0, |m| m.control.mean_force(tamping, p))
    }
}

/// A time on the clock that motions go by, s. A product, not the quotient of [`State::time`], which differs from it in the
/// last digit now and then: one clock for what moves the tools and for what they have felt.
fn clock(time_ns: u64) -> f64 {
    time_ns as f64 * 1e-9
}

impl Machine {
    /// Lift of the tamped sleepers, m.
    fn lift(&self, t: f64) -> f64 {
        let lifted = self.plan.lift.height * ramp(t, self.plan.start, self.plan.lift.duration);
        let Some(release) = self.plan.release else { return lifted };
        lifted + (release.height - lifted) * ramp(t, self.ends[4], release.duration)
    }

    /// Closing of each side after `squeezed` seconds of squeezing, m.
    fn closing(&self, squeezed: f64) -> f64 {
        self.plan.squeeze.stroke * travel(squeezed / self.plan.squeeze.duration)
    }

    /// Share of the way down after `lowered` seconds of lowering.
    fn depth(&self, lowered: f64) -> f64 {
        travel(lowered / self.plan.insertion.duration)
    }

    /// Seconds since the beginnings of insertion and squeeze.
    fn since(&self, t: f64) -> [f64; 2] {
        [t - self.ends[0], t - self.ends[1]]
    }

    fn tine_position(&self, tine: &TinePath, t: f64, lowered: f64, squeezed: f64) -> Vec3 {
        // The tines open in the first half of the withdrawal: pressed together, they would tear at
        // what they have just squeezed.
        let leaving = (t - self.ends[3]) / self.plan.withdrawal;
        let down = self.depth(lowered) * (1.0 - travel(leaving));
        let closed = self.closing(squeezed) * (1.0 - travel(2.0 * leaving));
        let x = tine.start.x + tine.direction * (closed + self.vibration(t));
        let z = tine.start.z + (tine.deep - tine.start.z) * down;
        Vec3::new(x, tine.start.y, z)
    }

    /// Displacement by vibration along the tine's direction, m; facing rows have opposite
    /// directions, so they move in opposition.
    fn vibration(&self, t: f64) -> f64 {
        let [begin, inserted, _, held, end, ..] = self.ends;
        let v = &self.plan.vibration;
        sine_between(v.amplitude, t, [begin, end], v.frequency, [inserted - begin, end - held])
    }
}

fn driven_tines(
    plan: &Plan,
    tamping: &TampingPlan,
    model: &Model,
    control: &MachineControl,
) -> Result<Vec<TinePath>> {
    let deep = tamping.deep_edge(&plan.bed);
    let tine = |tine: &crate::track::plan::TinePlan| {
        let pair = control.pairs.iter().position(|p| p.number == tine.pair);
        Ok(TinePath {
            body: driven_index(model, "tine", &tine.name)?,
            // Pairs are made from these very tines.
            pair: pair.unwrap_or_default(),
            direction: tine.direction,
            start: start_position(plan, tine),
            deep,
            stroke: tamping.squeeze.stroke,
        })
    };
    plan.tines.iter().map(tine).collect()
}

fn driven_plates(plan: &Plan, model: &Model) -> Result<Vec<(usize, PlatePlan)>> {
    let moved = plan.plates.iter().filter(|p| p.is_moved() || !p.load.is_empty());
    let driven = moved.map(|p| {
        check_program(p)?;
        Ok((driven_index(model, "plate", &p.name)?, p.clone()))
    });
    driven.collect()
}

/// Returns the position of a tine's reference point before the cycle, with its blade clear of the bed, m.
pub fn start_position(plan: &Plan, tine: &crate::track::plan::TinePlan) -> Vec3 {
    // Whoever drives the tines instead of a cycle begins above the grains that stick out.
    let idle = || IDLE_CLEARANCE.max(MAX_PROTRUSION * plan.bed.grains.mean_size());
    let clearance = plan.tamping.map_or_else(idle, |t| t.insertion.clearance);
    let z = plan.bed.preparation.fill_level + clearance - tine.bounds().low.z;
    Vec3::new(tine.position[0], tine.position[1], z)
}

fn lifted_sleepers(plan: &Plan, model: &Model) -> Result<Vec<Lifted>> {
    let depth = plan.bed.preparation.ballast_depth;
    let lifted = |s: &SleeperPlan| {
        let body = driven_index(model, "sleeper", &s.name)?;
        check_loadable(plan, s, model, body)?;
        Ok(Lifted { body, rest: Vec3::new(s.centre[0], s.centre[1], depth) })
    };
    plan.sleepers.iter().filter(|s| s.tamped).map(lifted).collect()
}

/// Refuses traffic over a sleeper that no load can move.
fn check_loadable(plan: &Plan, s: &SleeperPlan, model: &Model, body: usize) -> Result<()> {
    let vertical = model.driven[body].mount.map(|mount| mount.dof_modes[2]);
    let moves = vertical.is_some_and(|mode| mode != DofMode::Prescribed);
    if moves || plan.tamping.is_none_or(|tamping| tamping.traffic.is_none()) {
        return Ok(());
    }
    Err(Error::Model {
        place: format!("sleeper {:?}", s.name),
        expected: "a mount that is free or has a spring in z, to carry traffic".into(),
        found: "a sleeper whose vertical motion is prescribed".into(),
    })
}

fn check_numbers(plan: &TampingPlan) -> Result<()> {
    let at_least = |place: &str, value: f64, least: f64, strictly: bool| {
        if value.is_finite() && (value > least || (!strictly && value == least)) {
            return Ok(());
        }
        Err(Error::Model {
            place: format!("tamping.{place}"),
            expected: format!("{} {least}", if strictly { "more than" } else { "at least" }),
            found: value.to_string(),
        })
    };
    at_least("start", plan.start, 0.0, false)?;
    at_least("lift.height", plan.lift.height, 0.0, false)?;
    at_least("lift.duration", plan.lift.duration, 0.0, plan.lift.height > 0.0)?;
    at_least("insertion.duration", plan.insertion.duration, 0.0, true)?;
    at_least("insertion.clearance", plan.insertion.clearance, 0.0, false)?;
    at_least("squeeze.duration", plan.squeeze.duration, 0.0, true)?;
    at_least("squeeze.stroke", plan.squeeze.stroke, 0.0, false)?;
    at_least("hold", plan.hold, 0.0, false)?;
    at_least("withdrawal", plan.withdrawal, 0.0, true)?;
    at_least("vibration.frequency", plan.vibration.frequency, 0.0, false)?;
    at_least("vibration.amplitude", plan.vibration.amplitude, 0.0, false)?;
    if let Some(release) = plan.release {
        at_least("release.duration", release.duration, 0.0, true)?;
        at_least("release.height", release.height, f64::MIN, false)?;
    }
    if let Some(traffic) = &plan.traffic {
        check_load_cycles(traffic, "tamping.traffic")?;
    }
    let limits = [("insertion", plan.insertion.force_limit), ("squeeze", plan.squeeze.force_limit)];
    for (phase, limit) in limits {
        if !(limit > 0.0) {
            return Err(Error::Model {
                place: format!("tamping.{phase}.force_limit"),
                expected: "more than 0 N, or infinite".into(),
                found: limit.to_string(),
            });
        }
    }
    Ok(())
}

/// Refuses load cycles with a number out of range; `place` is their place in the plan.
pub(super) fn check_load_cycles(load: &LoadCycles, place: &str) -> Result<()> {
    let LoadCycles { cycles, max_load, min_load, frequency } = *load;
    let positive = |x: f64| x.is_finite() && x > 0.0;
    expect(cycles > 0, &format!("{place}.cycles"), "1 or more", cycles)?;
    expect(positive(max_load), &format!("{place}.max_load"), "more than 0 N", max_load)?;
    let expected = "0 N or more, below the largest load";
    let valid = (0.0..max_load).contains(&min_load);
    expect(valid, &format!("{place}.min_load"), expected, min_load)?;
    expect(positive(frequency), &format!("{place}.frequency"), "more than 0 Hz", frequency)
}

/// Refuses time steps that are too long for the period of the vibration.
fn check_period(plan: &Plan, tamping: &TampingPlan, model: &Model) -> Result<()> {
    let Some(period) = tamping.vibration.period().filter(|_| !plan.tines.is_empty()) else {
        return Ok(());
    };
    let per_period = period / model.stepping.h();
    if per_period < MIN_STEPS_PER_PERIOD {
        return Err(Error::Model {
            place: "tamping.vibration.frequency".into(),
            expected: format!("at least {MIN_STEPS_PER_PERIOD} time steps per period"),
            found: format!("{per_period:.1}"),
        });
    }
    Ok(())
}

#[cfg(test)]
#[path = "tamping_cycle_tests.rs"]
mod tests;
