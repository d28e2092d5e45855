//! Bodies on elastic mounts (T-28): alone like an oscillator, loaded like a spring, and in a jam.

use crate::common::scene::{GRAVITY, SCHEDULES, Scene};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Vec3};
use ballast::model::{Mount, Part, Schedule};
use std::f64::consts::TAU;

const EDGE: f64 = 0.1;

/// A plate on a mount, nothing else.
fn plate(step_ns: u64, mount: Mount) -> Scene {
    let mut scene = Scene::new(step_ns, 0.5);
    add_plate(&mut scene, Vec3::zeros(), mount);
    scene
}

fn add_plate(scene: &mut Scene, middle: Vec3, mount: Mount) {
    let shape = scene.shape(cuboid(Vec3::new(0.2, 0.2, 0.01)));
    let part = Part::Convex { shape, pose: Pose::identity() };
    scene.driven("plate", part, Pose::at(middle), 0.5);
    scene.mount(mount);
}

/// Amplitude of the plate over that of its mount, which oscillates with `frequency`, once the start
/// has died away.
fn response(mount: Mount, frequency: f64, step_ns: u64) -> f64 {
    let mut scene = plate(step_ns, mount);
    let amplitude = 0.005;
    let mut largest = 0.0_f64;
    let period = 1.0 / frequency;
    while scene.state.time() < 40.0 * period {
        let end = scene.state.time() + scene.h();
        scene.targets[0].position.x = amplitude * (TAU * frequency * end).sin();
        scene.step();
        if scene.state.time() > 38.0 * period {
            largest = largest.max(scene.state.position[0].x);
        }
    }
    largest / amplitude
}

#[test]
fn a_vibrated_mount_carries_its_body_as_an_oscillator() {
    let (mass, stiffness, frequency) = (3.0, 7.5e5_f64, 35.0);
    let natural = (stiffness / mass).sqrt();
    let damping_ratio = 0.1;
    let mount = Mount::spring(mass, stiffness, 2.0 * damping_ratio * (stiffness * mass).sqrt());
    let ratio = TAU * frequency / natural;
    let drag = 2.0 * damping_ratio * ratio;
    let exact = ((1.0 + drag * drag) / ((1.0 - ratio * ratio).powi(2) + drag * drag)).sqrt();
    let error = |step_ns| (response(mount, frequency, step_ns) - exact).abs();
    let errors = [200_000, 100_000, 50_000].map(error);
    // Second order; the sampled maximum hides some of it.
    assert!(errors[0] < 2e-3 * exact && errors[2] < 2e-4 * exact, "{errors:?}");
}

#[test]
fn an_undamped_mount_never_gains_energy() {
    for stiffness in [1e5, 1e6, 1e7, 1e8, 1e9] {
        for step_ns in [100_000, 800_000, 5_000_000] {
            for energy in swinging(stiffness, step_ns, 2000) {
                assert!(energy <= 1.0 + 1e-9, "{stiffness} N/m, {step_ns} ns: {energy}");
            }
        }
    }
}

/// Energies of an undamped plate that is let go, over the first, by step.
fn swinging(stiffness: f64, step_ns: u64, steps: usize) -> Vec<f64> {
    let mut scene = plate(step_ns, Mount::spring(100.0, stiffness, 0.0));
    scene.state.position[0].z = 0.01;
    let energy = |scene: &Scene| {
        let (x, v) = (scene.state.position[0].z, scene.state.velocity[0].z);
        0.5 * (stiffness * x * x + 100.0 * v * v)
    };
    let start = energy(&scene);
    let mut step = |_| {
        scene.step();
        energy(&scene) / start
    };
    (0..steps).map(&mut step).collect()
}

#[test]
fn a_spring_that_the_step_resolves_swings_on_and_a_stiffer_one_comes_to_rest() {
    // ω h = 0.09, 0.28, 0.8, 2.
    for (stiffness, step_ns) in [(1e6, 900_000), (1e7, 900_000), (1e8, 800_000), (1e8, 2_000_000)] {
        let last = swinging(stiffness, step_ns, 5000)[4999];
        assert!((last - 1.0).abs() < 1e-9, "{stiffness} N/m, {step_ns} ns: {last}");
    }
    // ω h = 3, 50.
    for (stiffness, step_ns) in [(1e8, 3_000_000), (1e9, 15_800_000)] {
        let last = swinging(stiffness, step_ns, 200)[199];
        assert!(last < 1e-6, "{stiffness} N/m, {step_ns} ns: {last}");
    }
}

#[test]
fn an_undamped_mount_never_gains_energy_whatever_theta() {
    for theta in [0.5, 0.6, 0.8, 1.0] {
        for stiffness in [1e5, 1e7, 1e8, 1e9] {
            let mut scene = plate(800_000, Mount::spring(100.0, stiffness, 0.0));
            scene.model.stepping.theta = theta;
            scene.state.position[0].z = 0.01;
            let mut highest = 0.0_f64;
            for _ in 0..2000 {
                scene.step();
                highest = highest.max(scene.state.position[0].z.abs());
            }
            assert!(highest <= 0.01 * (1.0 + 1e-9), "{theta}, {stiffness} N/m: {highest} m");
        }
    }
}

#[test]
fn a_loaded_mount_sinks_by_weight_over_stiffness() {
    for schedule in SCHEDULES {
        let mut scene = Scene::new(200_000, 0.5).scheduled(schedule, [1, 1, 2]);
        let cube = scene.shape(cuboid(Vec3::repeat(0.5 * EDGE)));
        for k in 0..2 {
            scene.grain(cube, Pose::at(Vec3::new(0.0, 0.0, EDGE * (k as f64 + 0.5) + 1e-6)));
        }
        let mount = Mount::spring(3.0, 1e5, 500.0);
        add_plate(&mut scene, Vec3::new(0.0, 0.0, -0.01), mount);
        let report = scene.run(0.5);
        let weight: f64 = scene.model.grains.mass.iter().sum::<f64>() * GRAVITY;
        let sunk = -0.01 - scene.state.position[2].z;
        assert!((sunk - weight / 1e5).abs() < 1e-6 * sunk, "{schedule:?}: {sunk} m");
        let force = -report.reactions[0].impulse.z / scene.h();
        assert!((force - weight).abs() < 1e-5 * weight, "{schedule:?}: {force} N, not {weight} N");
        assert!(scene.fastest() < 1e-6, "{schedule:?}: {} m/s", scene.fastest());
    }
}

/// A row of cubes without gaps between a wall and a plate on a mount that is pushed towards them by
/// `push`; the force on the plate once it rests.
fn jam(schedule: Schedule, push: f64, iterations: u32) -> (f64, f64) {
    let mut scene = Scene::new(800_000, 0.5).scheduled(schedule, [2, 1, 1]);
    scene.model.gravity = Vec3::zeros();
    scene.model.solver.max_iterations = iterations;
    let cube = scene.shape(cuboid(Vec3::repeat(0.5 * EDGE)));
    for k in 0..3 {
        scene.grain(cube, Pose::at(Vec3::new(EDGE * (k as f64 + 0.5), 0.0, 0.0)));
    }
    let shape = scene.shape(cuboid(Vec3::new(0.01, 0.2, 0.2)));
    let part = Part::Convex { shape, pose: Pose::identity() };
    let start = Vec3::new(3.0 * EDGE + 0.01, 0.0, 0.0);
    scene.driven("tine", part, Pose::at(start), 1.0);
    scene.mount(Mount::spring(3.0, 7.5e5, 300.0));
    scene.container(1.0, 0.8);
    // The container's corner is the wall; its floor and its sides are out of the way.
    for (body, away) in [(1, -Vec3::z()), (3, Vec3::x()), (4, -Vec3::y()), (5, Vec3::y())] {
        scene.state.position[3 + body] += away;
        scene.targets[body].position += away;
    }
    let steps = 250;
    let mut force = 0.0;
    let mut deepest = 0.0_f64;
    for step in 1..=2 * steps {
        let share = (step as f64 / steps as f64).min(1.0);
        scene.targets[0].position.x = start.x - push * share;
        let report = scene.step();
        force = report.reactions[0].impulse.x / scene.h();
        deepest = deepest.max(report.max_penetration);
    }
    (force, deepest)
}

#[test]
fn a_jam_is_pressed_with_the_force_of_the_mount_and_no_more() {
    let push = 0.01;
    for schedule in SCHEDULES {
        for iterations in [500, 4000] {
            let (force, deepest) = jam(schedule, push, iterations);
            let expected = 7.5e5 * push;
            let what = format!("{schedule:?}, {iterations} iterations");
            assert!((force - expected).abs() < 1e-4 * expected, "{what}: {force} N");
            assert!(deepest < 1e-6, "{what}: {deepest} m");
        }
    }
}

#[test]
fn a_mount_that_is_unsound_or_comes_late_is_refused() {
    let mount = Mount::spring(1.0, 1e5, 0.0);
    let mut scene = Scene::new(200_000, 0.5);
    scene.plane("floor", Pose::identity(), 0.5);
    add_plate(&mut scene, Vec3::z(), mount);
    let message = scene.model.check().unwrap_err().to_string();
    assert!(message.contains("mounted bodies before all others"), "{message}");

    for bad in [
        Mount { mass: 0.0, ..mount },
        Mount::spring(1.0, -1.0, 0.0),
        Mount::spring(1.0, 1e5, f64::NAN),
    ] {
        let message = plate(200_000, bad).model.check().unwrap_err().to_string();
        assert!(message.contains("plate"), "{message}");
    }
}
