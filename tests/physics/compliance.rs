//! Compliant contacts in closed form (T-42): overlap at rest, yielding on a slope, rebound, energy.

use crate::common::heap;
use crate::common::scene::{GRAVITY, SCHEDULES, Scene, slope};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Vec3};
use ballast::model::{ContactStiffness, Schedule};

/// Time steps at which closed forms must hold, ns.
const STEPS_NS: [u64; 3] = [1_000_000, 500_000, 250_000];
const NORMAL_STIFFNESS: f64 = 1e6;
const TANGENTIAL_RATIO: f64 = 0.5;

/// Makes all contacts springs.
fn soften(scene: &mut Scene, damping_time: f64) {
    let stiffness = ContactStiffness {
        normal: NORMAL_STIFFNESS,
        tangential_ratio: TANGENTIAL_RATIO,
        damping_time,
    };
    scene.model.grain_stiffness = stiffness;
    scene.model.driven.iter_mut().for_each(|body| body.stiffness = stiffness);
}

/// Calls `check` with every time step and schedule.
fn over_steps_and_schedules(mut check: impl FnMut(u64, Schedule)) {
    for step_ns in STEPS_NS {
        SCHEDULES.into_iter().for_each(|schedule| check(step_ns, schedule));
    }
}

#[test]
fn a_stack_at_rest_overlaps_by_the_weight_over_the_stiffness() {
    let (count, edge) = (3, 0.1);
    over_steps_and_schedules(|step_ns, schedule| {
        let mut scene = Scene::new(step_ns, 0.5).scheduled(schedule, [1, 1, 3]);
        for k in 0..count {
            // Narrower upwards, so that the corners of one lie inside the face of the other.
            let width = 0.5 * edge * (1.0 - 0.1 * k as f64);
            let block = scene.shape(cuboid(Vec3::new(width, width, 0.5 * edge)));
            scene.grain(block, Pose::at(Vec3::new(0.0, 0.0, edge * (k as f64 + 0.5))));
        }
        scene.plane("floor", Pose::identity(), 0.5);
        soften(&mut scene, 2e-3);
        scene.run(1.0);
        let (mut sunk, mut elastic) = (0.0, 0.0);
        for k in 0..count {
            // Four points carry what is above.
            let weight = scene.model.grains.mass[k..].iter().sum::<f64>() * GRAVITY;
            let overlap = weight / (4.0 * NORMAL_STIFFNESS);
            sunk += overlap;
            elastic += 2.0 * NORMAL_STIFFNESS * overlap * overlap;
            let found = edge * (k as f64 + 0.5) - scene.state.position[k].z;
            assert!(
                (found - sunk).abs() < 1e-6 * sunk,
                "{step_ns} ns, {schedule:?}: box {k} sank by {found} m, not {sunk} m"
            );
        }
        let found = scene.state.energy.elastic;
        assert!((found - elastic).abs() < 1e-5 * elastic, "{found} J, not {elastic} J");
    });
}

#[test]
fn a_slab_on_a_slope_yields_along_it_and_stays() {
    let (half, height, angle) = (0.1, 0.01, 0.5_f64);
    // No point slips while the load comes on.
    let friction = 3.0;
    over_steps_and_schedules(|step_ns, schedule| {
        let mut scene = Scene::new(step_ns, friction).scheduled(schedule, [1, 1, 1]);
        let slab = scene.shape(cuboid(Vec3::new(half, half, height)));
        let ground = slope(angle);
        scene.grain(slab, ground.then(&Pose::at(Vec3::new(0.0, 0.0, height))));
        scene.plane("slope", ground, friction);
        soften(&mut scene, 2e-3);
        scene.run(1.0);
        let downhill = |p: &Vec3| p.dot(&Vec3::new(angle.cos(), 0.0, -angle.sin()));
        let force = scene.model.grains.mass[0] * GRAVITY * angle.sin();
        // The four tangential springs, and the rotation by the moment of friction at the base.
        let way = force / (4.0 * NORMAL_STIFFNESS * TANGENTIAL_RATIO)
            + force * height * height / (4.0 * NORMAL_STIFFNESS * half * half);
        let found = downhill(&scene.state.position[0]);
        assert!(
            (found - way).abs() < 1e-3 * way,
            "{step_ns} ns, {schedule:?}: {found} m instead of {way} m"
        );
        scene.run(1.0);
        let creep = downhill(&scene.state.position[0]) - found;
        assert!(creep.abs() < 1e-9, "{step_ns} ns, {schedule:?}: creeps by {creep} m in 1 s");
    });
}

#[test]
fn a_slab_slides_with_the_acceleration_of_the_incline() {
    let friction = 0.5_f64;
    let angle = friction.atan() + 0.1;
    over_steps_and_schedules(|step_ns, schedule| {
        let mut scene = Scene::new(step_ns, friction).scheduled(schedule, [1, 1, 1]);
        let slab = scene.shape(cuboid(Vec3::new(0.1, 0.1, 0.01)));
        let ground = slope(angle);
        scene.grain(slab, ground.then(&Pose::at(Vec3::new(0.0, 0.0, 0.01))));
        scene.plane("slope", ground, friction);
        soften(&mut scene, 2e-3);
        let speed =
            |scene: &Scene| scene.state.velocity[0].dot(&Vec3::new(angle.cos(), 0.0, -angle.sin()));
        scene.run(0.3);
        let before = speed(&scene);
        scene.run(0.2);
        let found = (speed(&scene) - before) / 0.2;
        let expected = GRAVITY * (angle.sin() - friction * angle.cos());
        assert!(
            (found - expected).abs() < 1e-5 * expected,
            "{step_ns} ns, {schedule:?}: {found} m/s² instead of {expected} m/s²"
        );
    });
}

/// Two cubes that meet face to face at 1 m/s without gravity; returns the scene after they have parted.
fn meeting(step_ns: u64, schedule: Schedule, damping_time: f64) -> Scene {
    let mut scene = Scene::new(step_ns, 0.5).scheduled(schedule, [2, 1, 1]);
    let cube = scene.shape(cuboid(Vec3::repeat(0.05)));
    scene.model.gravity = Vec3::zeros();
    scene.grain(cube, Pose::at(Vec3::new(-0.055, 0.0, 0.0)));
    scene.grain(cube, Pose::at(Vec3::new(0.055, 0.0, 0.0)));
    scene.state.velocity = vec![Vec3::new(1.0, 0.2, 0.0), Vec3::new(0.0, 0.2, 0.0)];
    soften(&mut scene, damping_time);
    scene.run(0.06);
    scene
}

#[test]
fn a_blow_keeps_momentum_and_gives_back_the_energy_as_steps_shrink() {
    for schedule in SCHEDULES {
        let mut lost = Vec::new();
        for step_ns in [40_000, 20_000, 10_000] {
            let scene = meeting(step_ns, schedule, 0.0);
            let [a, b] = [scene.state.velocity[0], scene.state.velocity[1]];
            assert!((a + b - Vec3::new(1.0, 0.4, 0.0)).norm() < 1e-9, "{schedule:?}: {a:?} {b:?}");
            // Four springs between two equal masses: of implicit steps, each costs half of ω h of the amplitude.
            let mass = scene.model.grains.mass[0];
            let frequency = (4.0 * NORMAL_STIFFNESS * 2.0 / mass).sqrt();
            let step_loss = std::f64::consts::FRAC_PI_2 * frequency * step_ns as f64 * 1e-9;
            let restitution = b.x - a.x;
            lost.push(1.0 - restitution);
            assert!(
                (lost[lost.len() - 1] / step_loss - 1.0).abs() < 0.2,
                "{schedule:?}, {step_ns} ns: e = {restitution}, expected {}",
                1.0 - step_loss
            );
            let energy = &scene.state.energy;
            assert!(energy.balance_error().abs() < 1e-6 * energy.initial_kinetic);
            assert_eq!(energy.elastic, 0.0);
        }
        assert!(lost[2] < 0.6 * lost[1] && lost[1] < 0.6 * lost[0], "{lost:?}");
    }
}

#[test]
fn damping_lowers_the_rebound() {
    let rebound = |damping_time: f64| {
        let scene = meeting(20_000, Schedule::Sequential, damping_time);
        scene.state.velocity[1].x - scene.state.velocity[0].x
    };
    let (none, some, much) = (rebound(0.0), rebound(2e-4), rebound(5e-3));
    assert!(none > some + 0.1 && some > much + 0.1 && much >= 0.0, "{none} {some} {much}");
}

/// Stones that fall into a box.
fn falling(step_ns: u64, schedule: Schedule) -> Scene {
    let mut scene = heap::falling(3, step_ns).scheduled(schedule, [2, 1, 2]);
    scene.model.solver.tolerance = Some(1e-5);
    soften(&mut scene, 1e-3);
    scene
}

#[test]
fn a_heap_comes_to_rest_without_creating_energy() {
    for (step_ns, schedule) in [
        (800_000, Schedule::Sequential),
        (400_000, Schedule::Synchronous),
        (200_000, Schedule::Synchronous),
        (800_000, Schedule::Asynchronous),
    ] {
        let mut scene = falling(step_ns, schedule);
        let (mut created, mut last) = (0.0, 0.0);
        for _ in 0..(2.0 / scene.h()).round() as usize {
            scene.step();
            let dissipated = scene.state.energy.dissipated;
            created += f64::max(0.0, last - dissipated);
            last = dissipated;
        }
        let kinetic = scene.state.energy.kinetic;
        assert!(created < 1e-3 * last, "{step_ns} ns, {schedule:?}: {created} of {last} J");
        // The end of an asynchronous solve depends on its threads.
        let rest = if schedule == Schedule::Asynchronous { 1e-9 } else { 1e-12 };
        assert!(kinetic < rest, "{step_ns} ns, {schedule:?}: {kinetic} J after 2 s");
    }
}

#[test]
fn a_coefficient_of_restitution_is_refused_beside_springs() {
    let mut scene = falling(1_000_000, Schedule::Sequential);
    scene.model.restitution = 0.5;
    let refused = scene.model.check().unwrap_err().to_string();
    assert!(
        refused.contains("restitution: expected 0 where contacts have a stiffness"),
        "{refused}"
    );
}
