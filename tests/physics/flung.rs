//! Bodies that a step makes much faster than they were: what is in their way holds them all the same (T-35).

use crate::common::scene::{Random, SCHEDULES, Scene};
use ballast::detection::{Contacts, DetectionRange, Detector};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Quat, Vec3};

const EDGE: f64 = 0.02;
const SPEED: f64 = 5.0;

/// A cube about to strike the last of `count` others at rest, which stand in a row with `space` between them and before
/// the wall x = 0, without gravity and friction.
fn row(count: usize, space: f64) -> Scene {
    let mut scene = Scene::new(1_000_000, 0.0);
    scene.model.gravity = Vec3::zeros();
    scene.model.stepping.detection_distance = 1e-4;
    let cube = scene.shape(cuboid(Vec3::repeat(0.5 * EDGE)));
    for k in 0..count {
        let x = -space - (k as f64) * (EDGE + space) - 0.5 * EDGE;
        scene.grain(cube, Pose::at(Vec3::new(x, 0.0, 0.0)));
    }
    // Half a step of flight comes before contacts are looked for.
    let flight = 0.5 * SPEED * scene.h();
    let x = -(count as f64) * (EDGE + space) - 0.5 * EDGE - flight;
    let striker = scene.grain(cube, Pose::at(Vec3::new(x, 0.0, 0.0)));
    scene.state.velocity[striker].x = SPEED;
    let facing = nalgebra::UnitQuaternion::rotation_between(&Vec3::z(), &-Vec3::x());
    let wall = Pose { position: Vec3::zeros(), orientation: facing.expect("no half turn") };
    scene.plane("wall", wall, 0.0);
    scene
}

#[test]
fn a_flung_cube_does_not_enter_what_was_out_of_its_reach() {
    for schedule in SCHEDULES {
        for space in [3e-4, 1.5e-3, 2.4e-3] {
            let mut scene = row(1, space);
            scene.model.solver.schedule = schedule;
            for step in 0..10 {
                let report = scene.step();
                assert!(step > 0 || report.solve_passes == 2, "{report:?}");
                let deep = report.max_penetration;
                assert!(deep < 1e-9, "{schedule:?}, {space} m, step {step}: {deep} m");
            }
            let face = scene.state.position[0].x + 0.5 * EDGE;
            assert!(face.abs() < 1e-9, "it ends at the wall, not at {face}");
        }
    }
}

/// Each look around finds the next cube only.
#[test]
fn a_row_is_held_to_its_last_cube() {
    let mut scene = row(5, 4e-4);
    for step in 0..10 {
        let report = scene.step();
        assert!(step > 0 || report.solve_passes > 2, "{report:?}");
        assert!(report.max_penetration < 1e-9, "step {step}: {} m", report.max_penetration);
    }
    let ends: Vec<f64> = (0..5).map(|k| scene.state.position[k].x).collect();
    for (k, x) in ends.iter().enumerate() {
        let expected = -(k as f64 + 0.5) * EDGE;
        assert!((x - expected).abs() < 1e-8, "cube {k} ends at {x}, not at {expected}");
    }
}

/// Repeated detection depends on nothing but the state: equal results with and without caches of earlier steps.
#[test]
fn looking_again_is_repeatable() {
    let run = |forget: bool| {
        let mut scene = row(4, 7e-4);
        for _ in 0..6 {
            if forget {
                scene.workspace = Default::default();
            }
            scene.step();
        }
        scene.state
    };
    assert_eq!(run(false), run(true));
}

/// Nothing is ever past a floor, however far it flies in a step.
#[test]
fn no_speed_carries_a_cube_into_a_floor() {
    for schedule in SCHEDULES {
        for speed in [20.0, 30.0, 60.0, 200.0] {
            for start in 0..20 {
                let mut scene = Scene::new(1_000_000, 0.5);
                scene.model.solver.schedule = schedule;
                let cube = scene.shape(cuboid(Vec3::repeat(0.5 * EDGE)));
                let height = 0.25 + 0.002 * f64::from(start);
                let i = scene.grain(cube, Pose::at(Vec3::new(0.0, 0.0, height)));
                scene.state.velocity[i].z = -speed;
                scene.plane("floor", Pose::identity(), 0.5);
                for _ in 0..20 {
                    scene.step();
                    let face = scene.state.position[i].z - 0.5 * EDGE;
                    assert!(face > -1e-9, "{schedule:?}, {speed} m/s from {height} m: {face} m");
                }
            }
        }
    }
}

/// A bar that turns fast lifts a cube that a striker has just hit, with a third cube above: what the first solve asked to be
/// looked for further away is not taken for looked for when contacts were only added at the step's end. Found by a
/// detector that looks 30 mm around.
#[test]
fn nothing_closes_unseen_after_contacts_were_added() {
    let (omega, edge) = (300.0, EDGE);
    let mut looked_again = 0;
    for seed in 0..400u64 {
        let mut random = Random(seed * 7919 + 13);
        let mut scene = Scene::new(1_000_000, 0.0);
        scene.model.gravity = Vec3::zeros();
        scene.model.stepping.detection_distance = 1e-5;
        let bar = scene.shape(cuboid(Vec3::new(0.04, 0.005, 0.03)));
        let cube = scene.shape(cuboid(Vec3::repeat(0.5 * edge)));
        let (angle, h) = (0.15 * random.next(), scene.h());
        let orientation = Quat::from_axis_angle(&Vec3::z_axis(), angle - 0.5 * omega * h);
        let turning = scene.grain(bar, Pose { position: Vec3::zeros(), orientation });
        scene.state.angular_velocity[turning].z = omega;
        // The cube's corner stands over the bar, about as high as that comes in the step.
        let (corner, speed) = (0.03, -12.0);
        let top = corner * angle.tan() + 0.005 / angle.cos();
        let rise = omega * h * corner / angle.cos().powi(2);
        let y = top + rise + 0.0012 * (2.0 * random.next() - 0.6) + 0.5 * edge;
        let x = corner - 0.5 * edge;
        scene.grain(cube, Pose::at(Vec3::new(x, y, 0.0)));
        let striker = scene.grain(cube, Pose::at(Vec3::new(x, y, edge + 0.0005 - 0.5 * h * speed)));
        scene.state.velocity[striker].z = speed;
        let above = y + edge + 0.0002 + 0.0008 * random.next();
        scene.grain(cube, Pose::at(Vec3::new(x - 0.006, above, 0.0)));
        let report = scene.step();
        looked_again += usize::from(report.solve_passes > 2);
        let (motion, state) = (&scene.workspace.motion, &scene.state);
        let mut wide = scene.model.clone();
        wide.stepping.detection_distance = 0.03;
        let reach = DetectionRange::new(&wide, motion);
        let (mut detector, mut all) = (Detector::default(), Contacts::default());
        detector.broad_phase(&wide, motion, &reach);
        detector.narrow_phase(&wide, motion, &reach, &mut all);
        for (i, &pair) in all.bodies.iter().enumerate() {
            let twist = |b: usize| (state.velocity[b], state.angular_velocity[b]);
            let end = all.gap[i] + h * all.opening_speed(i, motion, twist);
            let is_listed = !scene.workspace.contacts.pair_range(pair).is_empty();
            assert!(is_listed || end > -1e-7, "seed {seed}, {pair:?}: {end} m");
        }
    }
    assert!(looked_again > 20, "{looked_again} steps with contacts added after a look further");
}
