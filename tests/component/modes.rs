//! Compliant and loaded bodies under a component, zones, and what else an outcome tells.

use crate::MS;
use crate::common::scene::{GRAVITY, Scene};
use ballast::component::{
    Component, Interpolation, Knot, Limits, LoadInput, LoadKnot, LoadWaveform, MotionInput,
    StepCallback, Waveform, WindowInputsRef, WindowStatus,
};
use ballast::drive::Load;
use ballast::geometry::cuboid;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{DofMode, Mount, Part};
use ballast::observe::Zone;
use std::f64::consts::TAU;

const US: u64 = 1000;
/// Underside of the tool at rest, m.
pub const TOP: f64 = 0.12;

/// Two cubes on a floor, and above them a tool on a mount.
pub fn press(mount: Mount, step_ns: u64) -> Scene {
    let mut scene = Scene::new(step_ns, 0.5);
    let cube = scene.shape(cuboid(Vec3::repeat(0.03)));
    for k in 0..2 {
        scene.grain(cube, Pose::at(Vec3::z() * (0.03 + 0.06 * f64::from(k))));
    }
    let plate = scene.shape(cuboid(Vec3::new(0.05, 0.05, 0.01)));
    let part = Part::Convex { shape: plate, pose: Pose::at(Vec3::z() * 0.01) };
    scene.driven("tool", part, Pose::at(Vec3::z() * TOP), 0.5);
    scene.mount(mount);
    scene.plane("floor", Pose::identity(), 0.5);
    scene
}

/// The mount's height: pressed down by 4 mm and back within 40 ms.
fn knot(time_ns: u64) -> Knot {
    let phase = TAU * time_ns as f64 * 1e-9 / 0.04;
    let position = Vec3::z() * (TOP - 0.002 * (1.0 - phase.cos()));
    let velocity = Vec3::z() * (-0.002 * TAU / 0.04 * phase.sin());
    Knot { time_ns, pose: Pose::at(position), velocity, angular_velocity: Vec3::zeros() }
}

/// Forces on the tool of 100 kg, one per 5 ms, and the largest energy of tool and spring beyond what the
/// machine has put into them, J.
fn pressed(stiffness: f64, window_ns: u64) -> (Vec<f64>, f64) {
    let mut scene = press(Mount::spring(100.0, stiffness, 0.0), 100 * US);
    scene.model.solver.tolerance = Some(1e-6);
    scene.model.solver.max_iterations = 300;
    let mut component =
        Component::new(scene.model.into(), scene.state, Limits::default()).expect("a press");
    let (mut forces, mut impulse) = (vec![], 0.0);
    let (mut put_in, mut excess, mut pull) = (0.0, f64::NEG_INFINITY, 0.0);
    while component.now_ns() < 40 * MS {
        let t0 = component.now_ns();
        let t1 = t0 + window_ns;
        let knots = vec![knot(t0), knot(t1)];
        let waveform = Waveform { interpolation: Interpolation::Hermite, knots };
        let input = MotionInput { body: "tool".into(), waveform, allow_jump: false };
        let (mut last, mut tool) = (component.state().mount[0].position.z, Vec3::zeros());
        let mut work = 0.0;
        let mut watch =
            StepCallback(|state: &ballast::state::State, report: &ballast::step::StepReport| {
                // The mount pulls its spring by the deflection at the end of each step.
                let mount = state.mount[0].position.z;
                let now = stiffness * (mount - state.position[2].z);
                put_in += 0.5 * (pull + now) * (mount - last);
                (last, pull) = (mount, now);
                tool += report.reactions[0].impulse;
                work += report.reactions[0].work;
                let deflection = mount - state.position[2].z;
                let speed = state.velocity[2].norm();
                let stored = 0.5 * (stiffness * deflection * deflection + 100.0 * speed * speed);
                excess = f64::max(excess, stored + work - put_in);
                std::ops::ControlFlow::Continue(())
            });
        component.advance_observed(t1, &[input], &mut watch).expect("a window");
        put_in -= work;
        impulse += tool.z;
        if component.now_ns().is_multiple_of(5 * MS) {
            forces.push(impulse / 5e-3);
            impulse = 0.0;
        }
    }
    (forces, excess)
}

#[test]
fn a_compliant_tool_on_a_stiff_bed_gains_no_energy_in_any_window() {
    for stiffness in [1e5, 1e7, 1e9] {
        let reference = pressed(stiffness, 100 * US).0;
        let largest = reference.iter().fold(0.0, |l: f64, f| l.max(f.abs()));
        assert!(largest > 0.3 * 0.004 * stiffness.min(1e6), "{stiffness}: {largest} N");
        let mut errors = vec![];
        for window in [5000, 1000] {
            let (forces, excess) = pressed(stiffness, window * US);
            // A thousandth of the energy of the whole press.
            assert!(excess < 2e-3 * 0.004 * largest, "{stiffness} N/m, {window} µs: {excess} J");
            let error = forces.iter().zip(&reference).map(|(a, b)| (a - b).abs());
            errors.push(error.fold(0.0, f64::max) / largest);
        }
        assert!(errors[0] < 5e-2 && errors[1] < 5e-3, "{stiffness} N/m: {errors:?}");
        assert!(errors[1] < 0.5 * errors[0], "{stiffness} N/m: {errors:?}");
    }
}

/// A sleeper of 60 kg that wheels press onto two cubes.
fn sleeper() -> Component {
    let mut freedoms = [DofMode::Prescribed; 6];
    freedoms[2] = DofMode::Free;
    let mount =
        Mount { mass: 60.0, inertia: Vec3::zeros(), centre: Vec3::zeros(), dof_modes: freedoms };
    let mut scene = press(mount, 500 * US);
    scene.state.position[2].z += 5e-4;
    // Without friction the stress has no part across, so that the pressure is known.
    scene.model.grain_friction = 0.0;
    scene.model.driven.iter_mut().for_each(|d| d.friction = 0.0);
    let zone = Zone::new("below", Vec3::new(-0.03, -0.03, 0.0), Vec3::new(0.03, 0.03, 0.12));
    Component::new(scene.model.into(), scene.state, Limits::default())
        .expect("a sleeper")
        .with_zones(vec![zone.expect("a box")])
}

/// Wheels: 20 kN in half a second and off again.
fn wheels() -> [LoadInput; 1] {
    let knot = |time_ms: u64, newtons: f64| LoadKnot {
        time_ns: time_ms * MS,
        load: Load { force: Vec3::z() * -newtons, torque: Vec3::zeros() },
    };
    let knots = vec![knot(0, 0.0), knot(250, 20e3), knot(500, 0.0), knot(1000, 0.0)];
    [LoadInput { body: "tool".into(), waveform: LoadWaveform { is_held: false, knots } }]
}

#[test]
fn a_loaded_sleeper_settles_under_wheels_and_comes_to_rest() {
    let run = |window: u64| {
        let mut component = sleeper();
        let loads = wheels();
        let mut forces = vec![];
        while component.now_ns() < 1000 * MS {
            let t1 = component.now_ns() + window * MS;
            let window = WindowInputsRef { motions: &[], loads: &loads };
            let outcome = component.advance_to(t1, window).expect("a window");
            forces.push((t1, outcome.bodies[0].moving_average_force.z, outcome.zones[0].clone()));
        }
        (component.save(), forces)
    };
    let (end, forces) = run(10);
    assert!(end.velocity[2].norm() < 1e-6, "{}", end.velocity[2]);
    assert!((end.position[2].z - TOP).abs() < 2e-6, "{}", end.position[2]);
    let at = |ms: u64| forces.iter().find(|f| f.0 == ms * MS).expect("a window's end");
    // On its way to the top the mean over the last 4 ms is that of 2 ms ago.
    let expected = 20e3 * (200.0 - 2.0) / 250.0 + 60.0 * GRAVITY;
    assert!((at(200).1 - expected).abs() < 1e-2 * expected, "{} N, not {expected} N", at(200).1);
    assert!((at(1000).1 - 60.0 * GRAVITY).abs() < 0.1, "{} N", at(1000).1);
    let zone = &at(200).2;
    assert!((zone.compactness.expect("room") - 1.0).abs() < 1e-3, "{zone:?}");
    // The lower cube touches floor and cube, the upper one cube and sleeper.
    assert_eq!(zone.coordination, Some(2.0));
    let pressure = (20e3 * 200.0 / 250.0 + 60.0 * GRAVITY) / (0.06 * 0.06) / 3.0;
    assert!((zone.pressure - pressure).abs() < 1e-2 * pressure, "{zone:?}, not {pressure} Pa");
    // Cut otherwise: the same bytes, the mean over windows included.
    let (other, coarse) = run(50);
    assert_eq!(other, end);
    assert_eq!(coarse.last().map(|f| f.1), forces.last().map(|f| f.1));
}

#[test]
fn a_body_that_loads_hurl_through_the_bed_is_no_result() {
    let mut component = sleeper();
    let start = component.save();
    // Kilonewtons taken for newtons: 60 kg go half of the smallest grain in a step of 0.5 ms.
    let mut loads = wheels();
    loads[0].waveform.knots.iter_mut().for_each(|k| k.load.force *= 1e3);
    let window = WindowInputsRef { motions: &[], loads: &loads };
    let outcome = component.advance_to(250 * MS, window).expect("a window");
    assert_eq!((outcome.status, outcome.steps), (WindowStatus::Discard, 0));
    let trouble = outcome.error.expect("why");
    assert_eq!(trouble.code(), "over_speed", "{trouble}");
    assert!(trouble.to_string().contains("half of the smallest grain"), "{trouble}");
    assert_eq!(component.save(), start);
}

#[test]
fn loads_that_cannot_be_taken_are_refused() {
    let mut component = sleeper();
    let before = component.save();
    let mut refuse = |change: &dyn Fn(&mut LoadInput), code: &str| {
        let mut loads = wheels();
        change(&mut loads[0]);
        let window = WindowInputsRef { motions: &[], loads: &loads };
        let refusal = component.advance_to(1000 * MS, window).expect_err(code);
        assert_eq!(refusal.code(), code, "{refusal}");
        assert!(refusal.to_string().contains("found"), "{refusal}");
        assert_eq!(component.save(), before);
    };
    refuse(&|l| l.body = "floor".into(), "input_invalid");
    refuse(&|l| l.body = "flor".into(), "unknown_body");
    refuse(&|l| l.waveform.knots.clear(), "input_invalid");
    refuse(&|l| l.waveform.knots.swap(0, 1), "input_invalid");
    refuse(&|l| l.waveform.knots[1].load.torque.x = f64::NAN, "input_invalid");
    refuse(&|l| l.waveform.knots.truncate(3), "input_gap");
    refuse(&|l| l.waveform.knots[0].time_ns = 1, "input_gap");
    let twice = [wheels(), wheels()].concat();
    let refusal = component.advance_to(MS, WindowInputsRef { motions: &[], loads: &twice });
    assert_eq!(refusal.expect_err("twice").code(), "input_invalid");
}

#[test]
fn held_loads_jump_at_their_knots() {
    let knot = |time_ns, x: f64| LoadKnot {
        time_ns,
        load: Load { force: Vec3::x() * x, torque: Vec3::zeros() },
    };
    let mut wave = LoadWaveform { is_held: true, knots: vec![knot(0, 1.0), knot(10, 3.0)] };
    let force = |w: &LoadWaveform, t| w.load(t).force.x;
    assert_eq!([9, 10, 50].map(|t| force(&wave, t)), [1.0, 3.0, 3.0]);
    wave.is_held = false;
    assert_eq!([0, 5, 10, 50].map(|t| force(&wave, t)), [1.0, 2.0, 3.0, 3.0]);
}

#[test]
fn the_hint_is_the_time_in_which_no_tool_gets_too_far() {
    let scene = press(Mount::spring(100.0, 1e6, 0.0), 100 * US);
    let mut component =
        Component::new(scene.model.into(), scene.state, Limits::default()).expect("a press");
    let still = component.advance_to(MS, &[]).expect("a window");
    assert!(still.max_knot_spacing_ns > 1000 * MS);
    // No body moves at all: no advice.
    let resting = crate::heap(Limits::default()).advance_to(MS, &[]).expect("a window");
    assert_eq!(resting.max_knot_spacing_ns, 0);
    let up = |time_ns: u64| Knot {
        time_ns,
        pose: Pose {
            position: Vec3::z() * (TOP + 0.5 * (time_ns - MS) as f64 * 1e-9),
            orientation: Quat::from_axis_angle(&Vec3::z_axis(), (time_ns - MS) as f64 * 1e-9),
        },
        velocity: Vec3::z() * 0.5,
        angular_velocity: Vec3::z(),
    };
    let waveform =
        Waveform { interpolation: Interpolation::Hermite, knots: vec![up(MS), up(41 * MS)] };
    let input = MotionInput { body: "tool".into(), waveform, allow_jump: true };
    let moving = component.advance_to(41 * MS, &[input]).expect("a window");
    let body = &moving.bodies[0];
    // What turns goes farther at its corners than at its reference point.
    let corner = Vec3::new(0.05, 0.05, 0.02).norm();
    assert!(body.angular_velocity.norm() > 0.5);
    let speed = body.velocity.norm() + body.angular_velocity.norm() * corner;
    let farthest = moving.max_knot_spacing_ns as f64 * 1e-9 * speed;
    // Half of the nominal diameter of a cube of 60 mm.
    let expected = 0.5 * 0.06 * (6.0 / std::f64::consts::PI).cbrt();
    assert!((farthest - expected).abs() < 1e-6, "{farthest} m, not {expected} m");
}
