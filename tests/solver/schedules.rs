//! Common properties of the schedules.

use crate::common::heap;
use crate::common::scene::{Random, SCHEDULES, Scene, tight};
use crate::{bits, on_threads};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Vec3};
use ballast::model::{Norm, PartitionRule, Schedule, Solver};

#[test]
fn with_one_subdomain_all_schedules_are_the_same_bytes() {
    for threads in [1, 2, 4] {
        let states = SCHEDULES.map(|schedule| {
            on_threads(threads, || {
                let mut scene = heap::falling(3, 1_000_000).scheduled(schedule, [1, 1, 1]);
                scene.model.solver.max_iterations = 40;
                for _ in 0..200 {
                    let report = scene.step();
                    assert_eq!(report.interface_contacts, 0);
                }
                bits(&scene.state)
            })
        });
        assert!(states[0] == states[1], "synchronous differs, {threads} threads");
        assert!(states[0] == states[2], "asynchronous differs, {threads} threads");
    }
}

#[test]
fn schedules_agree_on_the_physics() {
    // One step that hits hard, solved far below what is compared. Velocities are compared, for
    // impulses of face contacts are not unique.
    let mut resting = heap::falling(4, 1_000_000);
    resting.model.solver.max_iterations = 100;
    resting.run(0.6);
    let outcome = |schedule, threads| {
        on_threads(threads, || {
            let mut scene = heap::falling(4, 1_000_000);
            scene.state = resting.state.clone();
            scene.model.solver = Solver {
                tolerance: None,
                max_iterations: 3000,
                ..tight(schedule, PartitionRule::Boxes([2, 2, 2]))
            };
            scene.targets[0].position.z += 1e-3;
            let report = scene.step();
            assert!(report.residuals.qm16() < 1e-3, "{schedule:?}: {report:?}");
            assert!(schedule == Schedule::Sequential || report.interface_contacts > 10);
            (scene.state.velocity, scene.state.angular_velocity, scene.state.energy)
        })
    };
    let reference = outcome(Schedule::Sequential, 1);
    let (grains, kinetic) = (&resting.model.grains, reference.2.kinetic);
    assert!(kinetic > 0.1, "the floor's blow of 1 m/s hardly moved the heap: {kinetic} J");
    for schedule in [Schedule::Synchronous, Schedule::Asynchronous] {
        for threads in [1, 2, 4] {
            let other = outcome(schedule, threads);
            // Kinetic energy of the difference.
            let apart: f64 = (0..grains.len())
                .map(|i| {
                    let v = reference.0[i] - other.0[i];
                    let w = resting.state.orientation[i].inverse() * (reference.1[i] - other.1[i]);
                    let turning = grains.inertia[i].component_mul(&w).dot(&w);
                    0.5 * (grains.mass[i] * v.norm_squared() + turning)
                })
                .sum();
            assert!(
                apart < 1e-4 * kinetic,
                "{schedule:?}, {threads} threads: {apart} of {kinetic} J"
            );
            let energy = (kinetic - other.2.kinetic).abs();
            assert!(energy < 1e-2 * kinetic, "{schedule:?}, {threads} threads: {energy} J apart");
        }
    }
}

/// Two cubes at rest on a floor, in a subdomain each.
fn two_cubes(schedule: Schedule) -> Scene {
    let mut scene = Scene::new(1_000_000, 0.5).scheduled(schedule, [1, 1, 2]);
    let cube = scene.shape(cuboid(Vec3::repeat(0.05)));
    for k in 0..2 {
        scene.grain(cube, Pose::at(Vec3::new(0.0, 0.0, 0.05 + 0.1 * k as f64)));
    }
    scene.plane("floor", Pose::identity(), 0.5);
    scene.model.solver.convergence_check_interval = 1;
    scene.run(0.05);
    scene
}

#[test]
fn a_step_that_opens_every_contact_is_solved_and_not_taken_for_divergence() {
    for (schedule, norm) in
        SCHEDULES.into_iter().flat_map(|s| [(s, Norm::Qm16), (s, Norm::NaturalMap)])
    {
        let mut scene = two_cubes(schedule);
        scene.model.solver.norm = norm;
        assert_eq!(scene.step().active_contacts, 8, "{schedule:?}");
        let (rest, floor) = (scene.state.clone(), scene.targets[0].position.z);
        // The last digits of what the step starts from decide whether impulses end at zero after a
        // few sweeps or fade for ever: try many.
        for seed in 0..100 {
            let mut random = Random(seed);
            scene.state.clone_from(&rest);
            for impulse in &mut scene.state.contacts.impulse {
                *impulse *= 1.0 + 1e-6 * random.next();
            }
            // Floor and warm-start impulses go: the cubes fall freely.
            scene.targets[0].position.z = floor - 1e-3;
            let before = scene.state.velocity[0].z;
            let report = scene.step();
            assert!(report.converged && !report.sync_fallback, "{schedule:?}: {report:?}");
            let map = report.residuals.natural_map;
            assert!(map < 1e-4, "{schedule:?}, {norm:?}, {seed}: natural map {map}");
            let left: f64 = scene.workspace.impulse.iter().map(|f| f.norm()).sum();
            assert!(left < 1e-9, "{schedule:?}: {left} N s between falling cubes");
            let gained = scene.state.velocity[0].z - before + 9.81e-3;
            assert!(gained.abs() < 1e-8, "{schedule:?}: {gained}");
        }
    }
}

#[test]
fn asynchronous_runs_stay_sound_however_finely_divided() {
    // Nearly every grain its own subdomain: the worst splitting there is.
    for threads in [1, 2, 4] {
        on_threads(threads, || {
            let mut scene =
                heap::falling(3, 1_000_000).scheduled(Schedule::Asynchronous, [3, 3, 8]);
            scene.model.solver.max_iterations = 100;
            scene.model.solver.tolerance = Some(1e-4);
            for _ in 0..400 {
                let report = scene.step();
                assert!(report.max_penetration < 2e-3, "{threads} threads: {report:?}");
            }
            assert!(scene.fastest() < 1.0, "{threads} threads: {} m/s", scene.fastest());
            let ledger = scene.state.energy;
            let gain = ledger.balance_error() / ledger.dissipated;
            assert!(gain.abs() < 0.05, "{threads} threads: {ledger:?}");
        });
    }
}
