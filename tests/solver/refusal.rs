//! A refused step leaves the state as it was.

use crate::bits;
use crate::common::heap;
use crate::common::scene::{SCHEDULES, Scene};
use ballast::error::Error;
use ballast::math::{Quat, Vec3};
use ballast::model::{DofMode, Mount, PartitionRule};

/// A heap in contact.
fn heap_in_contact() -> Scene {
    let mut scene = heap::falling(2, 1_000_000);
    scene.run(0.1);
    scene
}

/// Spoils a scene, and checks the error.
type Spoiling = (&'static str, fn(&mut Scene), fn(&Error) -> bool);

const SPOILINGS: [Spoiling; 7] = [
    (
        "a target that is not finite",
        |s| s.targets[0].position.x = f64::NAN,
        |e| matches!(e, Error::Input { .. }),
    ),
    (
        "a target at infinity",
        |s| s.targets[1].position.y = f64::INFINITY,
        |e| matches!(e, Error::Input { .. }),
    ),
    (
        "a target whose quaternion scales",
        |s| {
            s.targets[2].orientation =
                Quat::new_unchecked(nalgebra::Quaternion::new(2.0, 0.0, 0.0, 0.0))
        },
        |e| matches!(e, Error::Input { .. }),
    ),
    ("a missing target", |s| s.targets.truncate(4), |e| matches!(e, Error::Input { .. })),
    ("a velocity that is not finite", |s| s.state.velocity[0].z = f64::NAN, is_refusal),
    ("a spin that is not finite", |s| s.state.angular_velocity[5].x = f64::INFINITY, is_refusal),
    ("a position that is not finite", |s| s.state.position[2].x = f64::NAN, is_refusal),
];

fn is_refusal(error: &Error) -> bool {
    matches!(error, Error::State { .. } | Error::Step { .. })
}

#[test]
fn refused_steps_change_nothing_and_say_why() {
    for schedule in SCHEDULES {
        for (what, spoil, is_right) in SPOILINGS {
            let mut scene = heap_in_contact().scheduled(schedule, [2, 1, 1]);
            spoil(&mut scene);
            let before = bits(&scene.state);
            let error = scene.try_step().expect_err(what);
            assert!(is_right(&error), "{schedule:?}, {what}: {error}");
            assert!(before == bits(&scene.state), "{schedule:?}, {what}: the state changed");
        }
    }
}

#[test]
fn a_good_step_after_a_refused_one_is_as_if_nothing_had_been() {
    for schedule in SCHEDULES {
        let mut spared = heap_in_contact().scheduled(schedule, [1, 1, 1]);
        spared.step();
        let mut tried = heap_in_contact().scheduled(schedule, [1, 1, 1]);
        let good = tried.state.clone();
        tried.state.velocity[3] = Vec3::repeat(f64::NAN);
        tried.try_step().expect_err("a velocity that is not finite");
        tried.state = good;
        tried.step();
        assert!(bits(&spared.state) == bits(&tried.state), "{schedule:?}");
    }
}

#[test]
fn nan_is_reported_with_its_grain() {
    type Injection = (&'static str, fn(&mut Scene, usize));
    let injections: [Injection; 4] = [
        ("position", |s, g| s.state.position[g].y = f64::NAN),
        ("velocity", |s, g| s.state.velocity[g].x = f64::NAN),
        ("spin", |s, g| s.state.angular_velocity[g].z = f64::NEG_INFINITY),
        ("orientation", |s, g| {
            let q = s.state.orientation[g].coords * f64::NAN;
            s.state.orientation[g] = Quat::new_unchecked(q.into());
        }),
    ];
    let heap = heap_in_contact().state;
    for grain in [0, 7, heap.velocity.len() - 6] {
        for (what, inject) in injections {
            let mut scene = heap_in_contact();
            inject(&mut scene, grain);
            let message = scene.try_step().expect_err(what).to_string();
            // Not a neighbour that the solver would have spoilt next.
            assert!(
                message.contains(&format!("grain {grain}:")),
                "{what} of grain {grain}: {message}"
            );
        }
    }
}

#[test]
fn values_out_of_the_range_of_f32_are_refused_by_name() {
    type Change = (&'static str, fn(&mut Scene));
    let changes: [Change; 8] = [
        ("grain_friction", |s| s.model.grain_friction = 1e39),
        ("at most 1e30", |s| s.model.driven[0].friction = f64::MAX),
        ("grain 3", |s| s.model.grains.mass[3] = 1e-46),
        ("a mass from 1e-30 to 1e30 kg", |s| {
            s.model.driven[0].mount = Some(Mount::spring(1e-46, 1.0, 0.0));
        }),
        ("moments of inertia from 1e-30", |s| {
            let freedoms = [DofMode::Free; 6];
            let mount = Mount {
                dof_modes: freedoms,
                inertia: Vec3::repeat(1e-46),
                ..Mount::spring(1.0, 1.0, 0.0)
            };
            s.model.driven[0].mount = Some(mount);
        }),
        ("solver.convergence_check_interval", |s| s.model.solver.convergence_check_interval = 0),
        ("at most 100000 subdomains", |s| {
            s.model.solver.partition = PartitionRule::Boxes([1 << 22, 1 << 22, 1 << 20]);
        }),
        ("1 to 4096 parts", |s| {
            let part = s.model.driven[0].parts[0].clone();
            s.model.driven[0].parts = vec![part; 4097];
        }),
    ];
    for (place, change) in changes {
        let mut scene = heap_in_contact();
        change(&mut scene);
        let message = scene.model.check().expect_err(place).to_string();
        assert!(message.contains(place), "{place}: {message}");
    }
}
