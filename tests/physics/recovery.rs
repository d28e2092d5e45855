//! Penetration correction (T-34): overlaps fade at the asked rate, nothing gains speed, nothing else moves.

use crate::common::scene::{GRAVITY, SCHEDULES, Scene};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Vec3};
use ballast::model::{Mount, Part, PenetrationCorrection, Schedule};
use ballast::workspace::Workspace;

const EDGE: f64 = 0.1;
const SHARE: f64 = 0.2;
const ALLOWED: f64 = 1e-6;

/// Cubes at these places on a floor, or in the air.
fn cubes(schedule: Schedule, boxes: [u32; 3], places: &[[f64; 3]]) -> Scene {
    let mut scene = Scene::new(1_000_000, 0.5).scheduled(schedule, boxes);
    scene.model.solver.penetration_correction =
        Some(PenetrationCorrection { factor: SHARE, slop: ALLOWED, iterations: 500 });
    let cube = scene.shape(cuboid(Vec3::repeat(0.5 * EDGE)));
    for place in places {
        scene.grain(cube, Pose::at((*place).into()));
    }
    scene.plane("floor", Pose::identity(), 0.5);
    scene
}

#[test]
fn a_stack_that_overlaps_comes_apart_at_the_asked_rate_and_stays_at_rest() {
    let deep = 1e-3;
    for schedule in SCHEDULES {
        let height = |k: f64| 0.5 * EDGE + k * EDGE - (k + 1.0) * deep;
        let places = [0.0, 1.0, 2.0].map(|k| [0.0, 0.0, height(k)]);
        let mut scene = cubes(schedule, [1, 1, 3], &places);
        let mut left = deep;
        for step in 0..20 {
            let report = scene.step();
            let found = (report.mean_penetration, report.max_penetration);
            for depth in [found.0, found.1] {
                assert!(
                    (depth - left).abs() < 1e-4 * deep,
                    "{schedule:?}, step {step}: {found:?}, not {left}"
                );
            }
            assert!(scene.fastest() < 1e-7, "{schedule:?}, step {step}: {} m/s", scene.fastest());
            left -= SHARE * (left - ALLOWED);
        }
        // Only the contacts have lifted the stack.
        let mass = scene.model.grains.mass[0];
        let lifted: f64 = (0..3).map(|k| scene.state.position[k].z - height(k as f64)).sum();
        let ledger = scene.state.energy;
        assert!(lifted > 5.9 * deep, "{schedule:?}: {lifted} m");
        let given = mass * GRAVITY * lifted;
        assert!((ledger.dissipated + given).abs() < 1e-4 * given, "{schedule:?}: {ledger:?}");
        assert!(ledger.balance_error().abs() < 1e-9, "{schedule:?}: {ledger:?}");
    }
}

#[test]
fn neighbours_are_displaced_without_new_penetration() {
    // The first overlaps the second, and the others touch in a row.
    for schedule in SCHEDULES {
        let row = [0.0, 0.099, 0.199, 0.299].map(|x| [x, 0.0, 0.05]);
        let mut scene = cubes(schedule, [4, 1, 1], &row);
        let centre = |scene: &Scene| scene.state.position[..4].iter().sum::<Vec3>() / 4.0;
        let start = centre(&scene);
        let mut deepest = 1e-3;
        for step in 0..30 {
            let depth = scene.step().max_penetration;
            assert!(depth < deepest * 1.0001, "{schedule:?}, step {step}: {depth} after {deepest}");
            deepest = depth;
        }
        assert!(deepest < 5e-6, "{schedule:?}: {deepest} m");
        // What moves them is between them.
        let moved = centre(&scene) - start;
        assert!(moved.norm() < 1e-8, "{schedule:?}: {moved:?}");
    }
}

#[test]
fn penetration_within_the_slop_keeps_its_bits() {
    let run = |recovery: bool| {
        // One lies in the floor and under another, as deep as is allowed; one falls and spins.
        let low = 0.05 - 0.9 * ALLOWED;
        let places = [[0.0, 0.0, low], [0.0, 0.0, low + EDGE - 0.9 * ALLOWED], [0.3, 0.0, 0.2]];
        let mut scene = cubes(Schedule::Synchronous, [2, 1, 1], &places);
        if !recovery {
            scene.model.solver.penetration_correction = None;
        }
        scene.state.angular_velocity[2] = Vec3::new(1.0, 2.0, 3.0);
        assert!(scene.run(0.02).max_penetration > 0.8 * ALLOWED);
        scene.state
    };
    assert_eq!(run(true), run(false));
}

/// A tool keeps its imposed pose, so correction on one side of it moves no body on the other.
#[test]
fn a_mounted_body_stays_as_one_without_a_mount_does() {
    let run = |mount: Option<Mount>| {
        let mut scene = Scene::new(1_000_000, 0.5);
        scene.model.gravity = Vec3::zeros();
        scene.model.solver.penetration_correction =
            Some(PenetrationCorrection { factor: SHARE, slop: 0.0, iterations: 100 });
        let cube = scene.shape(cuboid(Vec3::repeat(0.5 * EDGE)));
        let blade = scene.shape(cuboid(Vec3::new(0.01, 0.06, 0.04)));
        // One overlaps the blade, the other one touches it.
        scene.grain(cube, Pose::at(Vec3::new(-0.056, 0.0, 0.0)));
        scene.grain(cube, Pose::at(Vec3::new(0.06, 0.0, 0.0)));
        let part = Part::Convex { shape: blade, pose: Pose::identity() };
        scene.driven("blade", part, Pose::identity(), 0.5);
        if let Some(mount) = mount {
            scene.mount(mount);
        }
        for _ in 0..5 {
            scene.step();
        }
        scene.state.position
    };
    let rigid = run(None);
    assert!((rigid[0].x + 0.06 - 0.004 * (1.0 - SHARE).powi(5)).abs() < 1e-6, "{}", rigid[0]);
    for mass in [0.1, 1.5] {
        let mounted = run(Some(Mount::spring(mass, 1.6e6, 300.0)));
        for (rigid, mounted) in rigid.iter().zip(&mounted) {
            assert!((rigid - mounted).norm() < 1e-9, "{mass} kg: {mounted}, not {rigid}");
        }
    }
}

/// A workspace that has stepped a model with recovery steps one without as a fresh workspace does.
#[test]
fn a_model_without_recovery_knows_nothing_of_an_earlier_one() {
    let steps = |is_fresh: bool| {
        let mut scene = Scene::new(1_000_000, 0.0);
        scene.model.gravity = Vec3::zeros();
        scene.model.stepping.detection_distance = 1e-4;
        let cube = scene.shape(cuboid(Vec3::repeat(0.1 * EDGE)));
        // Two that overlap by half, and one that the second reaches when it has been moved out.
        for x in [0.0, 0.1, 0.38] {
            scene.grain(cube, Pose::at(Vec3::new(x * EDGE, 0.0, 0.0)));
        }
        scene.model.solver.penetration_correction =
            Some(PenetrationCorrection { factor: 1.0, slop: 0.0, iterations: 50 });
        scene.step();
        scene.model.solver.penetration_correction = None;
        if is_fresh {
            scene.workspace = Workspace::default();
        }
        let report = scene.step();
        (report.solve_passes, report.contacts, scene.state)
    };
    assert!(steps(false) == steps(true));
}
