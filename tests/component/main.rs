//! The stepping component: waveforms, windows, redo, restore, refusals.

#[path = "../common/mod.rs"]
mod common;

mod drivers;
mod halving;
mod modes;
mod parameters;
mod probes;
mod readme;
mod refusals;
mod stops;
mod waveforms;
mod windows;

use ballast::component::{Component, Interpolation, Knot, Limits, MotionInput, Waveform};
use ballast::math::{Pose, Vec3};
use ballast::model::Schedule;
use ballast::state::State;
use common::heap;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Nanoseconds of a millisecond.
pub const MS: u64 = 1_000_000;
/// The driven body.
pub const FLOOR: &str = "floor";

/// Amplitude (m) and frequency (Hz) of the floor.
const AMPLITUDE: f64 = 2e-3;
const FREQUENCY: f64 = 10.0;

/// Stones that have fallen onto each other, ready to be shaken.
pub fn heap(limits: Limits) -> Component {
    heap_scheduled(limits, Schedule::Synchronous)
}

/// Builds the scene of [`heap`] with a schedule.
pub fn heap_scheduled(limits: Limits, schedule: Schedule) -> Component {
    let mut scene = heap::falling(2, MS).scheduled(schedule, [2, 1, 1]);
    scene.model.solver.max_iterations = 200;
    scene.model.solver.tolerance = Some(1e-5);
    scene.run(0.15);
    scene.state.step = 0;
    scene.state.time_ns = 0;
    Component::new(Arc::new(scene.model), scene.state, limits).expect("a sound scene")
}

/// The floor's knot at a time: it swings about where it stood, from rest.
pub fn floor_knot(rest: Pose, time_ns: u64) -> Knot {
    let (t, w) = (1e-9 * time_ns as f64, TAU * FREQUENCY);
    let way = AMPLITUDE * (1.0 - (w * t).cos());
    Knot {
        time_ns,
        pose: Pose { position: rest.position - Vec3::z() * way, ..rest },
        velocity: -Vec3::z() * (AMPLITUDE * w * (w * t).sin()),
        angular_velocity: Vec3::zeros(),
    }
}

/// The shaken floor from `t0` to `t1` with a knot every 5 ms.
pub fn shaken(rest: Pose, t0_ns: u64, t1_ns: u64) -> MotionInput {
    let knots = (t0_ns / MS..=t1_ns / MS).step_by(5).map(|t| floor_knot(rest, t * MS)).collect();
    let waveform = Waveform { interpolation: Interpolation::Hermite, knots };
    MotionInput { body: FLOOR.into(), waveform, allow_jump: false }
}

/// Returns the pose of the floor.
pub fn floor(component: &Component) -> Pose {
    let model = component.model();
    let d = model.driven_index(FLOOR).expect("the floor");
    component.state().imposed(model, d)
}

/// Returns true if two states are equal bit for bit.
pub fn same(a: &State, b: &State) -> bool {
    let bits = |s: &State| {
        let vectors = s
            .position
            .iter()
            .chain(&s.velocity)
            .chain(&s.angular_velocity)
            .chain(&s.contacts.impulse);
        let numbers = vectors.flat_map(|v| v.iter().copied().collect::<Vec<_>>());
        let turns = s.orientation.iter().flat_map(|q| q.coords.iter().copied().collect::<Vec<_>>());
        (s.step, s.time_ns, numbers.chain(turns).map(f64::to_bits).collect::<Vec<_>>())
    };
    bits(a) == bits(b)
}
