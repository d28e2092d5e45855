//! Coulomb's law on a slope (T-8): stick, slide, topple.

use crate::common::scene::{GRAVITY, SCHEDULES, Scene, slope};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Vec3};
use ballast::model::Schedule;

/// Two flat slabs one on the other, on a slope; they grip each other more than the slope, so they
/// move as one. With `[1, 1, 2]` boxes the joint between them is the interface.
fn slabs(angle: f64, friction: f64, schedule: Schedule) -> Scene {
    let mut scene = Scene::new(1_000_000, friction + 0.5).scheduled(schedule, [1, 1, 2]);
    let slab = scene.shape(cuboid(Vec3::new(0.1, 0.1, 0.01)));
    let ground = slope(angle);
    for k in 0..2 {
        let height = 0.01 + 0.02 * k as f64;
        scene.grain(slab, ground.then(&Pose::at(Vec3::new(0.0, 0.0, height))));
    }
    scene.plane("slope", ground, friction);
    scene
}

/// Way along the slope, m.
fn downhill(scene: &Scene, angle: f64, grain: usize) -> f64 {
    scene.state.position[grain].dot(&Vec3::new(angle.cos(), 0.0, -angle.sin()))
}

#[test]
fn a_slab_sticks_below_the_angle_of_friction() {
    // Friction is kept in single precision: 1e-6 rad below the angle is still below.
    for friction in [1.0_f64, 0.8, 0.3] {
        for schedule in SCHEDULES {
            let angle = friction.atan() - 1e-4;
            let mut scene = slabs(angle, friction, schedule);
            scene.run(0.5);
            for grain in 0..2 {
                let way = downhill(&scene, angle, grain);
                assert!(way.abs() < 1e-7, "{friction} {schedule:?}: {grain} moved {way:e} m");
            }
        }
    }
}

#[test]
fn a_slab_slides_with_the_acceleration_of_the_incline() {
    for friction in [1.0_f64, 0.8, 0.3] {
        for schedule in SCHEDULES {
            let angle = friction.atan() + 0.05;
            let mut scene = slabs(angle, friction, schedule);
            scene.run(0.5);
            let acceleration = GRAVITY * (angle.sin() - friction * angle.cos());
            for grain in 0..2 {
                let way = downhill(&scene, angle, grain);
                // The scheme is exact for constant acceleration.
                let expected = 0.5 * acceleration * 0.25;
                assert!(
                    (way - expected).abs() < 2e-6 * expected,
                    "{friction} {schedule:?}: {way} m instead of {expected} m"
                );
            }
        }
    }
}

#[test]
fn a_box_topples_before_it_slides_iff_it_is_slender() {
    // tan α = 0.6 is below μ = 0.7: a box of breadth/height 0.5 topples, one of 0.7 stays.
    for schedule in SCHEDULES {
        let angle = 0.6_f64.atan();
        let mut scene = Scene::new(1_000_000, 0.7).scheduled(schedule, [2, 1, 1]);
        scene.model.solver.tolerance = Some(1e-7);
        scene.model.solver.max_iterations = 200;
        let ground = slope(angle);
        for (breadth, x) in [(0.1, 0.0), (0.14, -1.0)] {
            let shape = scene.shape(cuboid(Vec3::new(0.5 * breadth, 0.1, 0.1)));
            scene.grain(shape, ground.then(&Pose::at(Vec3::new(x, 0.0, 0.1))));
        }
        scene.plane("slope", ground, 0.7);
        scene.run(0.4);
        let turned: Vec<f64> =
            (0..2).map(|g| scene.state.orientation[g].angle_to(&ground.orientation)).collect();
        assert!(turned[0] > 0.3, "{schedule:?}: the slender box turned {} rad", turned[0]);
        assert!(turned[1] < 1e-6, "{schedule:?}: the stout box turned {} rad", turned[1]);
        assert!((downhill(&scene, angle, 1) + 1.0).abs() < 1e-6, "{schedule:?}: it slid");
    }
}

#[test]
fn a_stout_box_slides_without_toppling() {
    // tan α = 0.7 is above μ = 0.6, and below breadth/height 0.9.
    for schedule in SCHEDULES {
        let angle = 0.7_f64.atan();
        let mut scene = Scene::new(1_000_000, 0.6).scheduled(schedule, [1, 1, 1]);
        let ground = slope(angle);
        let shape = scene.shape(cuboid(Vec3::new(0.09, 0.1, 0.1)));
        scene.grain(shape, ground.then(&Pose::at(Vec3::new(0.0, 0.0, 0.1))));
        scene.plane("slope", ground, 0.6);
        scene.run(0.4);
        let turned = scene.state.orientation[0].angle_to(&ground.orientation);
        assert!(turned < 1e-6, "{schedule:?}: turned {turned} rad");
        let expected = 0.08 * GRAVITY * (angle.sin() - 0.6 * angle.cos());
        let way = downhill(&scene, angle, 0);
        assert!((way - expected).abs() < 2e-6 * expected, "{schedule:?}: {way}, not {expected}");
    }
}
