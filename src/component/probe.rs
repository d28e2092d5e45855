//! Probes of the track: static load and lateral push on one sleeper, as engineers measure them.
//!
//! Reads: model and state, which stay as they are. Cost: the steps of the probe. Contract: same model, state and probe, same
//! result.

use super::limits::Limits;
use super::load::{LoadKnot, LoadWaveform};
use super::refusal::Refusal;
use super::stepper::Component;
use super::waveform::{Interpolation, Knot, Waveform};
use super::window::{LoadInput, MotionInput, WindowInputs};
use crate::drive::Load;
use crate::integrate;
use crate::math::Vec3;
use crate::model::check::expect;
use crate::model::{DofMode, Model, Mount, Part, Role};
use crate::state::State;
use crate::step::StepObserver;
use crate::track::mounting::put_on_mount;
use crate::track::sleeper::CONCRETE;
use std::sync::Arc;

/// Maximum number of points of each ramp and of a push.
const MAX_POINTS: u64 = 50;

/// Static load on a sleeper: vertical ramps from zero to the largest load and back to the smallest, several times.
///
/// The sleeper moves vertically under its weight and the load; its other degrees of freedom are held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StiffnessProbe {
    /// Largest load, N.
    pub max_load: f64,
    /// Load to which the sleeper is unloaded, N.
    pub min_load: f64,
    /// Number of load cycles.
    pub cycles: u32,
    /// Duration of each ramp, and of the seating under the weight before the first, s.
    pub ramp: f64,
}

impl Default for StiffnessProbe {
    fn default() -> Self {
        Self { max_load: 20e3, min_load: 1e3, cycles: 2, ramp: 0.2 }
    }
}

/// Lateral push of a sleeper: motion across the track with a constant speed.
///
/// The sleeper moves vertically under its weight; its other degrees of freedom are held.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PushProbe {
    /// Largest displacement, m.
    pub displacement: f64,
    /// Speed, m/s.
    pub speed: f64,
    /// Duration of the seating under the weight before the push, s.
    pub seating: f64,
}

impl Default for PushProbe {
    fn default() -> Self {
        Self { displacement: 5e-3, speed: 0.01, seating: 0.2 }
    }
}

/// Point of the curve of a probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProbePoint {
    /// Time since the start of the probe, s.
    pub time: f64,
    /// Load on the sleeper without its weight, or force against the push, N.
    pub force: f64,
    /// Settlement since the seating, downwards, or displacement of the push, m.
    pub displacement: f64,
}

/// Secant stiffness and settlements of one load cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoadCycle {
    /// Secant stiffness from the beginning of the cycle to the largest load, N/m.
    pub loading: f64,
    /// Secant stiffness from the largest to the smallest load, N/m.
    pub unloading: f64,
    /// Settlement at the largest load, since the seating, m.
    pub settlement: f64,
    /// Settlement that remains at the smallest load, since the seating, m.
    pub rest: f64,
}

/// Result of a [`StiffnessProbe`].
#[derive(Debug, Clone, PartialEq)]
pub struct StiffnessCurve {
    /// Load over settlement.
    pub points: Vec<ProbePoint>,
    /// Cycles, in order of time.
    pub cycles: Vec<LoadCycle>,
}

/// Result of a [`PushProbe`].
#[derive(Debug, Clone, PartialEq)]
pub struct PushCurve {
    /// Force over displacement.
    pub points: Vec<ProbePoint>,
    /// Weight of the sleeper, N.
    pub weight: f64,
}

impl PushCurve {
    /// Displacement at which forces of pushes are compared, m.
    pub const REFERENCE_DISPLACEMENT: f64 = 2e-3;

    /// Returns the force at a displacement (m), N, linear between points; `None` beyond the curve.
    pub fn force_at(&self, displacement: f64) -> Option<f64> {
        let after = self.points.iter().position(|p| p.displacement >= displacement)?;
        let before = after
            .checked_sub(1)
            .map_or(ProbePoint { displacement: 0.0, ..self.points[0] }, |k| self.points[k]);
        let end = self.points[after];
        let length = end.displacement - before.displacement;
        let share = if length > 0.0 { (displacement - before.displacement) / length } else { 1.0 };
        Some(before.force + (end.force - before.force) * share)
    }
}

impl StiffnessProbe {
    /// Returns the duration of the probe, s.
    pub fn duration(&self) -> f64 {
        f64::from(2 * self.cycles + 1) * self.ramp
    }

    /// Loads driven body `sleeper` of `model`, from `state` on.
    ///
    /// # Errors
    /// Settings out of range, a body that is no sleeper, or a step that fails.
    pub fn run(
        &self,
        model: &Model,
        state: &State,
        sleeper: usize,
        observer: &mut impl StepObserver,
    ) -> Result<StiffnessCurve, Refusal> {
        let Self { max_load, min_load, cycles, ramp } = *self;
        let positive = |x: f64| x.is_finite() && x > 0.0;
        expect(positive(max_load), "probe: largest load", "a finite load above 0 N", max_load)?;
        let valid = (0.0..max_load).contains(&min_load);
        expect(valid, "probe: smallest load", "0 N or more, below the largest load", min_load)?;
        expect(positive(ramp), "probe: ramp", "a finite duration above 0 s", ramp)?;
        expect(cycles > 0, "probe: cycles", "1 or more", cycles)?;
        let mut bench = TestBench::new(model, state, sleeper)?;
        let Windows { length: window, count } = bench.windows(ramp);
        let duration = window * count;
        bench.seat(duration, observer)?;
        let start = bench.component.now_ns();
        let knot = |ramps: u64, load: f64| LoadKnot {
            time_ns: start + ramps * duration,
            load: Load { force: Vec3::new(0.0, 0.0, -load), torque: Vec3::zeros() },
        };
        let ramps = 2 * u64::from(cycles);
        let loads = (1..=ramps).map(|k| knot(k, if k % 2 == 1 { max_load } else { min_load }));
        let knots: Vec<LoadKnot> = std::iter::once(knot(0, 0.0)).chain(loads).collect();
        let waveform = LoadWaveform { is_held: false, knots };
        let inputs = WindowInputs {
            motions: Vec::new(),
            loads: vec![LoadInput { body: bench.name.clone(), waveform: waveform.clone() }],
        };
        let seat = bench.position().z;
        let mut points = Vec::new();
        for _ in 0..ramps * count {
            bench.advance(window, &inputs, observer)?;
            let now = bench.component.now_ns();
            points.push(ProbePoint {
                time: (now - start) as f64 * 1e-9,
                force: -waveform.load(now).force.z,
                displacement: seat - bench.position().z,
            });
        }
        let cycles = evaluate_cycles(&points, count as usize, min_load);
        Ok(StiffnessCurve { points, cycles })
    }
}

/// Returns stiffness and settlements of each cycle of `half` points up and as many down.
fn evaluate_cycles(points: &[ProbePoint], half: usize, min_load: f64) -> Vec<LoadCycle> {
    let (mut start, mut start_load) = (0.0, 0.0);
    let cycles = points.chunks_exact(2 * half).map(|cycle| {
        let (top, end) = (cycle[half - 1], cycle[2 * half - 1]);
        let loading = (top.force - start_load) / (top.displacement - start);
        let unloading = (top.force - end.force) / (top.displacement - end.displacement);
        (start, start_load) = (end.displacement, min_load);
        LoadCycle { loading, unloading, settlement: top.displacement, rest: end.displacement }
    });
    cycles.collect()
}

impl PushProbe {
    /// Returns the duration of the probe, s.
    pub fn duration(&self) -> f64 {
        self.seating + self.displacement / self.speed
    }

    /// Pushes driven body `sleeper` of `model` towards +y, from `state` on.
    ///
    /// # Errors
    /// Settings out of range, a body that is no sleeper, or a step that fails.
    pub fn run(
        &self,
        model: &Model,
        state: &State,
        sleeper: usize,
        observer: &mut impl StepObserver,
    ) -> Result<PushCurve, Refusal> {
        let Self { displacement, speed, seating } = *self;
        let positive = |x: f64| x.is_finite() && x > 0.0;
        let expected = "a finite displacement above 0 m";
        expect(positive(displacement), "probe: displacement", expected, displacement)?;
        expect(positive(speed), "probe: speed", "a finite speed above 0 m/s", speed)?;
        expect(positive(seating), "probe: seating", "a finite duration above 0 s", seating)?;
        let mut bench = TestBench::new(model, state, sleeper)?;
        let seating = bench.windows(seating);
        bench.seat(seating.length * seating.count, observer)?;
        let Windows { length: window, count } = bench.windows(displacement / speed);
        let (start, duration) = (bench.component.now_ns(), window * count);
        let rest = bench.component.state().imposed(bench.component.model(), bench.sleeper);
        let knot = |time_ns: u64, way: f64| {
            let mut pose = rest;
            pose.position.y += way;
            Knot { time_ns, pose, velocity: Vec3::zeros(), angular_velocity: Vec3::zeros() }
        };
        let end = knot(start + duration, speed * duration as f64 * 1e-9);
        let waveform =
            Waveform { interpolation: Interpolation::Linear, knots: vec![knot(start, 0.0), end] };
        let inputs = WindowInputs {
            motions: vec![MotionInput { body: bench.name.clone(), waveform, allow_jump: false }],
            loads: Vec::new(),
        };
        let from = bench.position().y;
        let mut points = Vec::new();
        for _ in 0..count {
            let force = bench.advance(window, &inputs, observer)?;
            points.push(ProbePoint {
                time: (bench.component.now_ns() - start) as f64 * 1e-9,
                force: -force.y,
                displacement: bench.position().y - from,
            });
        }
        Ok(PushCurve { points, weight: bench.weight })
    }
}

/// Windows of equal length.
struct Windows {
    /// Length of each, ns.
    length: u64,
    count: u64,
}

/// Component in which one sleeper may move vertically.
struct TestBench {
    component: Component,
    name: String,
    /// Number among the driven bodies.
    sleeper: usize,
    /// Weight of the sleeper, N.
    weight: f64,
}

impl TestBench {
    fn new(model: &Model, state: &State, sleeper: usize) -> Result<Self, Refusal> {
        let (mut model, mut state) = (model.clone(), state.clone());
        let known: Vec<&str> = sleepers(&model).map(|d| &model.driven[d].name[..]).collect();
        let is_sleeper = sleepers(&model).any(|d| d == sleeper);
        expect(is_sleeper, "probe: body", &format!("a sleeper, one of {known:?}"), sleeper)?;
        let name = model.driven[sleeper].name.clone();
        let free = vertical_mount(&model, sleeper);
        match &mut model.driven[sleeper].mount {
            Some(mount) => *mount = free,
            None => put_on_mount(&mut model, &mut state, sleeper, free),
        }
        let sleeper = model.driven_index(&name).unwrap_or(sleeper);
        // The time of the probe begins at 0, and nothing moves then.
        (state.step, state.time_ns) = (0, 0);
        (state.window, state.driver) = (Arc::default(), Arc::default());
        for b in model.grains.len()..model.body_count() {
            (state.velocity[b], state.angular_velocity[b]) = (Vec3::zeros(), Vec3::zeros());
        }
        model.solver.force_check_interval = 0;
        state.energy = integrate::open_ledger(&model, &state);
        let weight = free.mass * model.gravity.norm();
        let component = Component::new(Arc::new(model), state, Limits::default())?;
        Ok(Self { component, name, sleeper, weight })
    }

    /// Divides a duration (s) into windows of whole steps.
    fn windows(&self, duration: f64) -> Windows {
        let step = self.component.model().stepping.step_ns;
        let steps = (duration / (step as f64 * 1e-9)).round().max(1.0) as u64;
        let length = steps.div_ceil(MAX_POINTS);
        Windows { length: length * step, count: steps.div_ceil(length) }
    }

    /// Position of the sleeper's reference point, m.
    fn position(&self) -> Vec3 {
        let model = self.component.model();
        self.component.state().position[model.grains.len() + self.sleeper]
    }

    /// Lets the sleeper find its seat under its weight.
    fn seat(&mut self, duration_ns: u64, observer: &mut impl StepObserver) -> Result<(), Refusal> {
        self.advance(duration_ns, &WindowInputs::default(), observer).map(|_| ())
    }

    /// Advances by `window` ns, and returns the mean force of the ballast on the sleeper, N.
    fn advance(
        &mut self,
        window: u64,
        inputs: &WindowInputs,
        observer: &mut impl StepObserver,
    ) -> Result<Vec3, Refusal> {
        let end = self.component.now_ns() + window;
        let result = self.component.advance_observed(end, inputs, observer)?;
        match result.error {
            Some(error) => Err(error.into()),
            None if result.t1_ns < end => Err(Refusal::Cancelled),
            None => Ok(result.bodies[self.sleeper].mean_force),
        }
    }
}

/// Returns the numbers of the sleepers among the driven bodies.
pub fn sleepers(model: &Model) -> impl Iterator<Item = usize> + '_ {
    (0..model.driven.len()).filter(|d| model.driven[*d].role == Role::Sleeper)
}

/// Returns the number of the sleeper with a name among the driven bodies, that of the first sleeper if no name is given.
pub fn find_sleeper(model: &Model, name: Option<&str>) -> Option<usize> {
    sleepers(model).find(|d| name.is_none_or(|name| model.driven[*d].name == name))
}

/// Returns a mount of driven body `d` that moves vertically under loads, with its mass or that of concrete.
fn vertical_mount(model: &Model, d: usize) -> Mount {
    let body = &model.driven[d];
    let volume = |part: &Part| match part {
        Part::Convex { shape, .. } => model.shapes[*shape as usize].volume,
        Part::HalfSpace { .. } => 0.0,
    };
    let of_concrete = Mount {
        mass: CONCRETE * body.parts.iter().map(volume).sum::<f64>(),
        inertia: Vec3::zeros(),
        centre: Vec3::zeros(),
        dof_modes: [DofMode::Prescribed; 6],
    };
    body.mount.unwrap_or(of_concrete).free_vertically()
}
