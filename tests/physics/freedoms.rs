//! Mounted bodies by their degrees of freedom (T-28): loaded, sprung and held, beside grains that are the
//! same bodies.

use crate::common::scene::{GRAVITY, SCHEDULES, Scene};
use ballast::drive::Load;
use ballast::geometry::cuboid;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{DofMode, Mount, Part, Schedule};
use std::f64::consts::TAU;

const HALF: Vec3 = Vec3::new(0.06, 0.05, 0.04);
const LOADED: [DofMode; 6] = [DofMode::Free; 6];

fn mount(freedoms: [DofMode; 6]) -> Mount {
    Mount {
        mass: 5.0,
        inertia: Vec3::new(0.01, 0.02, 0.03),
        centre: Vec3::zeros(),
        dof_modes: freedoms,
    }
}

/// A block alone, hanging on a mount.
fn alone(mount: Mount) -> Scene {
    let mut scene = Scene::new(100_000, 0.5);
    let shape = scene.shape(cuboid(HALF));
    let part = Part::Convex { shape, pose: Pose::identity() };
    scene.driven("block", part, Pose::identity(), 0.5);
    scene.mount(mount);
    scene
}

fn held_but(free: &[(usize, DofMode)]) -> [DofMode; 6] {
    let mut freedoms = [DofMode::Prescribed; 6];
    free.iter().for_each(|&(k, f)| freedoms[k] = f);
    freedoms
}

#[test]
fn a_loaded_body_falls_and_is_accelerated_by_its_load() {
    let mut scene = alone(mount(LOADED));
    scene.loads = vec![Load { force: Vec3::new(10.0, 0.0, 0.0), torque: Vec3::new(0.0, 0.0, 0.6) }];
    scene.run(0.1);
    let (v, w) = (scene.state.velocity[0], scene.state.angular_velocity[0]);
    assert!((v - Vec3::new(10.0 / 5.0, 0.0, -GRAVITY) * 0.1).norm() < 1e-12, "{v}");
    assert!((w - Vec3::z() * (0.6 / 0.03 * 0.1)).norm() < 1e-12, "{w}");
    // Springs carry the weight, and what is held does not move.
    let spring = DofMode::Spring { stiffness: 0.0, damping: 0.0 };
    for freedoms in [[spring; 6], held_but(&[(0, DofMode::Free), (4, DofMode::Free)])] {
        let mut scene = alone(mount(freedoms));
        scene.loads = vec![Load { force: Vec3::x() * 10.0, torque: Vec3::zeros() }];
        scene.run(0.1);
        let v = scene.state.velocity[0];
        assert!((v - Vec3::x() * (10.0 / 5.0 * 0.1)).norm() < 1e-12, "{v}");
    }
}

#[test]
fn springs_that_differ_drive_no_turned_body_round() {
    let spring = DofMode::Spring { stiffness: 1000.0, damping: 0.0 };
    let free = DofMode::Free;
    for yaw in [0.2, 0.5, 1.0] {
        let mut scene = alone(Mount {
            inertia: Vec3::repeat(0.05),
            dof_modes: [free, free, free, spring, spring, free],
            ..mount(LOADED)
        });
        scene.model.gravity = Vec3::zeros();
        let turn = |axis: Vec3, angle: f64| Quat::from_scaled_axis(axis * angle);
        scene.state.orientation[0] = turn(Vec3::x(), 1e-3) * turn(Vec3::z(), yaw);
        for _ in 0..40000 {
            scene.step();
            let kinetic = 0.5 * 0.05 * scene.state.angular_velocity[0].norm_squared();
            // The springs hold that much at the start, where the vector of the whole turn is up to 1.05 mrad off the z axis.
            assert!(kinetic < 1.1 * 0.5 * 1000.0 * 1e-6, "turned by {yaw} rad: {kinetic} J");
        }
    }
}

#[test]
fn a_force_beside_the_centre_of_mass_turns_the_body() {
    let centre = Vec3::new(0.03, -0.02, 0.1);
    let force = Vec3::new(20.0, -7.0, 3.0);
    let load = Load { force, torque: Vec3::new(0.1, 0.2, -0.3) };
    // About the centre of mass: J dw/dt = torque + (-c) × force, and m dv/dt = force at the centre.
    let h = 1e-4;
    let inertia = mount(LOADED).inertia;
    let angular_velocity = (load.torque - centre.cross(&force)).component_div(&inertia) * h;
    let of_centre = (force / 5.0 - Vec3::z() * GRAVITY) * h;
    let mut scene = alone(Mount { centre, ..mount(LOADED) });
    scene.loads = vec![load];
    scene.step();
    let (v, w, q) =
        (scene.state.velocity[0], scene.state.angular_velocity[0], scene.state.orientation[0]);
    let momentum = q * (q.inverse() * w).component_mul(&inertia);
    let moment = angular_velocity.component_mul(&inertia);
    assert!((momentum - moment).norm() < 1e-12 * moment.norm(), "{momentum} {moment}");
    let velocity = v + w.cross(&(q * centre));
    assert!((velocity - of_centre).norm() < 1e-12 * v.norm(), "{velocity} {of_centre}");
    // Of three freedoms, the same body accelerates as the rows and columns of its mass matrix say.
    let freedoms = held_but(&[(0, DofMode::Free), (2, DofMode::Free), (4, DofMode::Free)]);
    let mut scene = alone(Mount { centre, ..mount(freedoms) });
    scene.loads = vec![load];
    scene.step();
    let (v, w) = (scene.state.velocity[0], scene.state.angular_velocity[0]);
    let about = inertia.y + 5.0 * (centre.x * centre.x + centre.z * centre.z);
    let weight = Vec3::z() * (-5.0 * GRAVITY);
    let given = [force.x, force.z + weight.z, load.torque.y + centre.cross(&weight).y];
    let taken = [
        5.0 * (v.x + w.y * centre.z) / h,
        5.0 * (v.z - w.y * centre.x) / h,
        (about * w.y + 5.0 * (centre.z * v.x - centre.x * v.z)) / h,
    ];
    for (given, taken) in given.iter().zip(taken) {
        assert!((given - taken).abs() < 1e-9 * given.abs(), "{given} {taken}");
    }
    assert_eq!((v.y, w.x, w.z), (0.0, 0.0, 0.0));
}

/// A block flies at another one without gravity; the second is a grain, or a driven body that is the same
/// solid. Velocities of the second one's centre of mass, and spins, of both in the end.
fn collision(schedule: Schedule, offset: Option<Vec3>) -> [Vec3; 4] {
    let mut scene = Scene::new(100_000, 0.5).scheduled(schedule, [2, 1, 1]);
    scene.model.gravity = Vec3::zeros();
    let shape = scene.shape(cuboid(HALF));
    let first = Pose {
        position: Vec3::new(-0.2, 0.02, 0.015),
        orientation: Quat::from_scaled_axis(Vec3::new(0.3, -0.5, 0.7)),
    };
    scene.grain(shape, first);
    let turn = Quat::from_scaled_axis(Vec3::new(-0.2, 0.4, 0.1));
    let solid = &scene.model.shapes[shape as usize];
    let mass = crate::common::scene::DENSITY * solid.volume;
    let inertia = solid.unit_inertia * crate::common::scene::DENSITY;
    match offset {
        None => {
            scene.grain(shape, Pose { position: Vec3::zeros(), orientation: turn });
        }
        Some(centre) => {
            let part = Part::Convex { shape, pose: Pose::at(centre) };
            let pose = Pose { position: -(turn * centre), orientation: turn };
            scene.driven("block", part, pose, 0.5);
            scene.mount(Mount { mass, inertia, centre, dof_modes: LOADED });
        }
    }
    scene.state.velocity[0] = Vec3::new(2.0, 0.0, 0.0);
    scene.state.angular_velocity[0] = Vec3::new(1.0, 2.0, 3.0);
    scene.run(0.08);
    let lever = scene.state.orientation[1] * offset.unwrap_or_else(Vec3::zeros);
    let (v, w) = (&scene.state.velocity, &scene.state.angular_velocity);
    [v[0], v[1] + w[1].cross(&lever), w[0], w[1]]
}

#[test]
fn a_free_driven_body_takes_a_blow_like_the_grain_that_it_is() {
    for schedule in SCHEDULES {
        let grain = collision(schedule, None);
        assert!(grain[1].norm() > 0.5 && grain[3].norm() > 1.0, "there was a blow: {grain:?}");
        for centre in [Vec3::zeros(), Vec3::new(0.02, -0.01, 0.05)] {
            let body = collision(schedule, Some(centre));
            for (a, b) in grain.iter().zip(&body) {
                assert!((a - b).norm() < 1e-5 * (1.0 + a.norm()), "{schedule:?}: {a} {b}");
            }
        }
    }
}

#[test]
fn a_sleeper_that_may_settle_carries_its_load_to_the_ground() {
    for freedoms in [
        held_but(&[(2, DofMode::Free)]),
        held_but(&[(2, DofMode::Free), (3, DofMode::Free), (4, DofMode::Free)]),
        LOADED,
    ] {
        for schedule in SCHEDULES {
            let mut scene = Scene::new(500_000, 0.5).scheduled(schedule, [2, 1, 1]);
            let cube = scene.shape(cuboid(Vec3::repeat(0.03)));
            for (x, y) in [(-0.1, -0.05), (0.1, -0.05), (-0.1, 0.05), (0.1, 0.05)] {
                scene.grain(cube, Pose::at(Vec3::new(x, y, 0.03)));
            }
            let block = scene.shape(cuboid(Vec3::new(0.15, 0.1, 0.05)));
            let part = Part::Convex { shape: block, pose: Pose::at(Vec3::z() * 0.05) };
            scene.driven("sleeper", part, Pose::at(Vec3::z() * 0.0605), 0.7);
            let inertia = Vec3::new(0.5, 0.8, 1.2);
            let centre = Vec3::z() * 0.05;
            scene.mount(Mount { mass: 60.0, inertia, centre, dof_modes: freedoms });
            let floor = scene.plane("floor", Pose::identity(), 0.5);
            scene.loads = vec![Load { force: Vec3::z() * -2000.0, torque: Vec3::zeros() }];
            let report = scene.run(0.5);
            let grains: f64 = scene.model.grains.mass.iter().sum();
            let expected = 2000.0 + (60.0 + grains) * GRAVITY;
            let force = -report.reactions[floor].impulse.z / scene.h();
            let what = format!("{schedule:?}, {freedoms:?}");
            assert!((force - expected).abs() < 1e-4 * expected, "{what}: {force}, not {expected}");
            let p = scene.state.position[4];
            assert!((p.z - 0.06).abs() < 2e-6, "{what}: {p}");
            assert!(scene.state.velocity[4].norm() < 1e-5, "{what}");
            assert!(scene.state.orientation[4].angle() < 1e-4, "{what}");
        }
    }
}

#[test]
fn a_sprung_rotation_swings_with_its_own_period() {
    let (stiffness, inertia) = (300.0_f64, 0.02);
    let swing = DofMode::Spring { stiffness, damping: 0.0 };
    // Held beside it, or free beside it: no difference.
    let soft = DofMode::Spring { stiffness: 1e5, damping: 0.0 };
    let held = DofMode::Prescribed;
    for freedoms in [held_but(&[(4, swing)]), [soft, soft, soft, held, swing, held]] {
        let mut scene = alone(mount(freedoms));
        scene.state.orientation[0] = Quat::from_scaled_axis(Vec3::y() * 0.05);
        let period = TAU * (inertia / stiffness).sqrt();
        let mut crossings = vec![];
        let mut before = 0.05;
        while crossings.len() < 3 {
            scene.step();
            let angle = scene.state.orientation[0].scaled_axis().y;
            if before > 0.0 && angle <= 0.0 || before < 0.0 && angle >= 0.0 {
                crossings.push(scene.state.time() - scene.h() * angle / (angle - before));
            }
            before = angle;
        }
        let measured = crossings[2] - crossings[0];
        assert!((measured - period).abs() < 1e-3 * period, "{measured} s, not {period} s");
    }
}

#[test]
fn held_rotations_follow_the_machine_beside_springs() {
    let sprung = DofMode::Spring { stiffness: 1e6, damping: 1e3 };
    let held = DofMode::Prescribed;
    let mut scene = alone(mount([sprung, sprung, sprung, held, held, held]));
    for k in 1..=200 {
        let angle = 0.3 * (0.5 - 0.5 * (TAU * f64::from(k) / 400.0).cos());
        scene.targets[0].orientation = Quat::from_scaled_axis(Vec3::y() * angle);
        scene.step();
        assert_eq!(scene.state.orientation[0], scene.targets[0].orientation);
    }
    assert!(
        scene.state.position[0].norm() < 1e-9,
        "nothing pushes it: {}",
        scene.state.position[0]
    );
    // Other mounts cannot be turned where they are held.
    let mut scene = alone(mount(held_but(&[(2, DofMode::Free)])));
    scene.targets[0].orientation = Quat::from_scaled_axis(Vec3::y() * 0.01);
    let message = scene.try_step().expect_err("held").to_string();
    assert!(message.contains("block") && message.contains("prescribed axis"), "{message}");
}

#[test]
fn mounts_and_loads_that_cannot_be_are_refused() {
    let loaded = DofMode::Free;
    let soft = DofMode::Spring { stiffness: 1.0, damping: 0.0 };
    let four = held_but(&[(0, soft), (1, loaded), (2, loaded), (3, loaded)]);
    for (bad, words) in [
        (mount([DofMode::Prescribed; 6]), "not prescribed"),
        (mount(four), "at most three"),
        (Mount { inertia: Vec3::zeros(), ..mount(LOADED) }, "moments of inertia"),
        (Mount { centre: Vec3::repeat(f64::NAN), ..mount(LOADED) }, "centre of mass"),
    ] {
        let message = alone(bad).model.check().expect_err("refused").to_string();
        assert!(message.contains("block") && message.contains(words), "{message}");
    }
    let mut scene = alone(mount(LOADED));
    let nan = Load { force: Vec3::repeat(f64::NAN), torque: Vec3::zeros() };
    scene.loads = vec![nan];
    assert!(scene.try_step().expect_err("not finite").to_string().contains("load on"));
    scene.loads = vec![Load::zero(); 2];
    assert!(scene.try_step().expect_err("too many").to_string().contains("loads"));
}

/// A block free to move, whose rotations are held away from its centre of mass, in the air without gravity.
fn turned_about_a_corner() -> (Scene, Vec3) {
    let centre = Vec3::new(0.1, 0.0, 0.0);
    let free = held_but(&[0, 1, 2].map(|k| (k, DofMode::Free)));
    let mut scene = alone(Mount { centre, ..mount(free) });
    scene.model.gravity = Vec3::zeros();
    (scene, centre)
}

#[test]
fn a_body_that_stops_rotating_keeps_the_momentum_of_its_centre_of_mass() {
    let (mut scene, centre) = turned_about_a_corner();
    let speed = |scene: &Scene| {
        let arm = scene.state.orientation[0] * centre;
        scene.state.velocity[0] + scene.state.angular_velocity[0].cross(&arm)
    };
    for _ in 0..5 {
        scene.targets[0].orientation =
            Quat::from_scaled_axis(Vec3::z() * 1e-3) * scene.targets[0].orientation;
        scene.step();
    }
    // No force acts on it, only couples, which start and stop it.
    assert!(speed(&scene).norm() < 1e-3, "{}", speed(&scene));
    let (before, reference) = (speed(&scene), scene.state.velocity[0]);
    assert!(reference.norm() > 0.9, "{reference}");
    for _ in 0..3 {
        scene.step();
        assert_eq!(scene.state.angular_velocity[0], Vec3::zeros());
        assert!((speed(&scene) - before).norm() < 1e-9, "{} after {before}", speed(&scene));
    }
}

/// A stone at the centre of mass of a body that stops turning sees nothing of it: not in restitution, nor in the ledger.
#[test]
fn a_body_that_stops_rotating_starts_the_step_with_its_centre_of_mass_unchanged() {
    let (mut scene, centre) = turned_about_a_corner();
    for turn in [1e-3, 1e-3, 0.0] {
        let before = (scene.state.velocity[0], scene.state.angular_velocity[0]);
        let arm = scene.state.orientation[0] * centre;
        let state = scene.state.clone();
        scene.targets[0].orientation =
            Quat::from_scaled_axis(Vec3::z() * turn) * scene.targets[0].orientation;
        scene.step();
        let (v, w) = scene.workspace.motion.initial_twist(&scene.model, &state, 0);
        let expected = before.0 + before.1.cross(&arm);
        assert!((v + w.cross(&arm) - expected).norm() < 1e-12, "{v}, {w}");
        assert!((w.z - turn / scene.h()).abs() < 1e-6, "{w}");
    }
}

/// Held, a direction moves with the velocity of the step throughout: that is what its forces do work on.
#[test]
fn a_prescribed_body_does_the_work_of_its_force_along_its_path() {
    let spring = DofMode::Spring { stiffness: 1e6, damping: 1e3 };
    for mounted in [false, true] {
        let mut scene = Scene::new(1_000_000, 0.0);
        let shape = scene.shape(cuboid(Vec3::repeat(0.05)));
        scene.grain(shape, Pose::at(Vec3::new(0.0, 0.0, 0.1)));
        let part = Part::Convex { shape, pose: Pose::identity() };
        scene.driven("block", part, Pose::identity(), 0.0);
        if mounted {
            scene.mount(mount(held_but(&[(0, spring)])));
        }
        let (mut work, mut expected, mut z) = (0.0, 0.0, 0.0);
        for step in 1..=200 {
            let next = 2e-4 * (1.0 - (TAU * 20.0 * 1e-3 * f64::from(step)).cos());
            scene.targets[0].position.z = next;
            let reaction = scene.step().reactions[0];
            work += reaction.work;
            expected -= reaction.impulse.z / scene.h() * (next - z);
            z = next;
        }
        assert!(expected > 1e-3, "the cube bounces: {expected} J");
        assert!((work - expected).abs() < 1e-9, "mounted {mounted}: {work}, not {expected} J");
        assert!((scene.state.energy.work_in - work).abs() < 1e-12);
        assert!(scene.state.energy.balance_error().abs() < 1e-12);
    }
}

/// Energy (J) and angular momentum about the reference point (N m s) of the only body, which is held in its place.
fn about_its_place(scene: &Scene) -> (f64, Vec3) {
    let mount = scene.model.driven[0].mount.expect("mounted");
    let (q, w) = (scene.state.orientation[0], scene.state.angular_velocity[0]);
    let d = q * mount.centre;
    let own = q * (q.inverse() * w).component_mul(&mount.inertia);
    let momentum = own + d.cross(&w.cross(&d)) * mount.mass;
    (0.5 * w.dot(&momentum), momentum)
}

#[test]
fn a_body_that_tumbles_in_its_place_keeps_energy_and_angular_momentum() {
    for (angular_velocity, step_ns) in
        [(5.0, 1_000_000), (50.0, 1_000_000), (200.0, 1_000_000), (50.0, 200_000)]
    {
        let freedoms = [3, 4, 5].map(|k| (k, DofMode::Free));
        let centre = Vec3::new(0.05, 0.02, 0.1);
        let mut scene = alone(Mount { centre, ..mount(held_but(&freedoms)) });
        scene.model.gravity = Vec3::zeros();
        scene.model.stepping.step_ns = step_ns;
        scene.state.angular_velocity[0] = Vec3::new(0.42, -0.71, 0.57) * angular_velocity;
        let (energy, momentum) = about_its_place(&scene);
        for _ in 0..4000 {
            scene.step();
            let (e, l) = about_its_place(&scene);
            let turn = angular_velocity * scene.h();
            assert!(
                (l - momentum).norm() < 1e-10 * momentum.norm(),
                "{angular_velocity}: {l} {momentum}"
            );
            assert!(
                (e - energy).abs() < 0.5 * turn * turn * energy,
                "{angular_velocity}: {e} {energy}"
            );
            assert_eq!(scene.state.position[0], Vec3::zeros());
        }
    }
}

#[test]
fn a_body_with_one_free_rotation_stays_where_it_is_left() {
    for rest in [0.5, 1.8, 2.2, 3.0] {
        let mut scene = alone(mount(held_but(&[(5, DofMode::Free)])));
        let left = Quat::from_scaled_axis(Vec3::z() * rest);
        scene.state.orientation[0] = Quat::from_scaled_axis(Vec3::x() * 1e-9) * left;
        scene.run(0.1);
        let away = scene.state.orientation[0].angle_to(&left);
        assert!(away < 1e-8, "left at {rest} rad, {away} rad away");
    }
}

/// A machine turns held rotations of a body that is turned by its free ones: contacts know of all of its turn.
#[test]
fn a_body_turns_as_its_spin_says_whatever_is_held() {
    let (free, held) = (DofMode::Free, DofMode::Prescribed);
    for (rotations, is_turned) in [
        ([held, held, free], true),
        ([free, held, free], true),
        ([free, held, free], false),
        ([free, free, held], true),
    ] {
        let [a, b, c] = rotations;
        let mut scene = alone(mount([free, free, free, a, b, c]));
        scene.model.gravity = Vec3::zeros();
        let axes = rotations.map(|m| f64::from(u8::from(!m.is_prescribed())));
        let turn = Vec3::new(0.4 * axes[0], 0.3 * axes[1], 0.6 * axes[2]);
        scene.state.orientation[0] = Quat::from_scaled_axis(turn);
        scene.state.angular_velocity[0] = Vec3::new(2.0 * axes[0], -1.5 * axes[1], 1.0 * axes[2]);
        let mut before = scene.state.angular_velocity[0];
        for k in 1..=2000 {
            let angle = if is_turned { 0.5 * (f64::from(k) * 3e-4).sin() } else { 0.0 };
            let held = Vec3::from_fn(|i, _| (1.0 - axes[i]) * angle);
            scene.targets[0].orientation = Quat::from_scaled_axis(held);
            let start = scene.state.orientation[0];
            scene.step();
            let way = (scene.state.orientation[0] * start.inverse()).scaled_axis();
            let told = 0.5 * (before + scene.state.angular_velocity[0]);
            before = scene.state.angular_velocity[0];
            // It begins to turn at once.
            let seen = (way / scene.h() - told).norm();
            assert!(k == 1 || seen < 2e-3, "{rotations:?}, step {k}: {seen} rad/s");
        }
    }
}
