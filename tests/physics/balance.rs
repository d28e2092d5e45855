//! Balances of a heap in a shaken box: momentum to rounding, energy to the scheme's order.

use crate::common::heap;
use crate::common::scene::{SCHEDULES, Scene};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Quat, Vec3};
use std::f64::consts::TAU;

/// Moves the floor up and down (2 mm, 20 Hz).
fn shake(scene: &mut Scene) {
    let t = scene.state.time() + scene.h();
    scene.targets[0].position.z = 2e-3 * (TAU * 20.0 * t).sin();
}

/// Sum of `m v` over the grains, N s.
fn momentum(scene: &Scene) -> Vec3 {
    scene.model.grains.mass.iter().zip(&scene.state.velocity).map(|(m, v)| v * *m).sum()
}

#[test]
fn impulses_of_driven_bodies_and_weight_change_the_momentum() {
    for schedule in SCHEDULES {
        let mut scene = heap::falling(3, 1_000_000).scheduled(schedule, [2, 1, 2]);
        // Momentum is exact however badly a step is solved.
        scene.model.solver.max_iterations = 7;
        let mut touched = 0;
        for step in 0..300 {
            let before = momentum(&scene);
            shake(&mut scene);
            let report = scene.step();
            let mass: f64 = scene.model.grains.mass.iter().sum();
            let weight = scene.model.gravity * (mass * scene.h());
            let on_bodies: Vec3 = report.reactions.iter().map(|r| r.impulse).sum();
            let missing = momentum(&scene) - before - weight + on_bodies;
            let scale = momentum(&scene).norm() + on_bodies.norm() + weight.norm();
            touched += report.reactions.iter().map(|r| r.contacts).sum::<u32>();
            assert!(missing.norm() < 1e-12 * scale, "{schedule:?}, step {step}: {missing:?} N s");
        }
        assert!(touched > 300, "{schedule:?}: the heap hardly touched the box");
    }
}

/// Angular momentum of the grains about the world's origin, N m s.
fn angular_momentum(scene: &Scene) -> Vec3 {
    let (grains, state) = (&scene.model.grains, &scene.state);
    let of = |i: usize| {
        let q = state.orientation[i];
        let own = q * (q.inverse() * state.angular_velocity[i]).component_mul(&grains.inertia[i]);
        state.position[i].cross(&state.velocity[i]) * grains.mass[i] + own
    };
    (0..grains.len()).map(of).sum()
}

#[test]
fn moments_change_the_angular_momentum() {
    for schedule in SCHEDULES {
        let mut scene = heap::falling(3, 1_000_000).scheduled(schedule, [2, 1, 2]);
        for k in 0..scene.model.grains.len() {
            let angle = k as f64;
            scene.state.angular_velocity[k] = Vec3::new(angle.sin(), angle.cos(), 0.5) * 50.0;
        }
        for step in 0..300 {
            let before = angular_momentum(&scene);
            shake(&mut scene);
            let report = scene.step();
            let (motion, grains) = (&scene.workspace.motion, &scene.model.grains);
            let mut gained = angular_momentum(&scene) - before;
            let mut scale = 0.0;
            for i in 0..grains.len() {
                let weight = scene.model.gravity * (grains.mass[i] * scene.h());
                let push = (scene.state.velocity[i] - motion.velocity[i]) * grains.mass[i];
                gained -= motion.position[i].cross(&weight);
                scale += motion.position[i].norm()
                    * (push.norm() + 1e-6 * grains.mass[i] * motion.velocity[i].norm());
            }
            for (d, reaction) in report.reactions.iter().enumerate() {
                let origin = motion.position[grains.len() + d];
                gained += reaction.angular_impulse + origin.cross(&reaction.impulse);
                scale += origin.norm() * reaction.impulse.norm();
            }
            // Levers are rounded to single precision, separately on each side of a contact.
            assert!(gained.norm() <= 1e-6 * scale, "{schedule:?}, step {step}: {gained:?} N m s");
        }
    }
}

#[test]
fn the_energy_ledger_closes() {
    for schedule in SCHEDULES {
        let mut scene = heap::falling(2, 500_000).scheduled(schedule, [2, 1, 1]);
        while scene.state.time() < 0.3 {
            shake(&mut scene);
            scene.step();
        }
        let ledger = scene.state.energy;
        let missing = ledger.balance_error().abs();
        // What is left is the gyroscopic term of tumbling stones.
        assert!(ledger.dissipated > 0.5, "{schedule:?}: {ledger:?}");
        assert!(missing < 1e-3 * ledger.dissipated, "{schedule:?}: {missing} J of {ledger:?}");
    }
}

/// Spinning stones strike each other, one pair at a time: what the ledger misses, over what the blows have taken.
fn missed_by_the_ledger(step_ns: u64) -> f64 {
    let (mut missed, mut taken) = (0.0, 0.0);
    for k in 0..20 {
        let angle = |n: i32| f64::from(k + n) * 2.4;
        let mut scene = Scene::new(step_ns, 0.5);
        scene.model.gravity = Vec3::zeros();
        let shape = scene.shape(cuboid(Vec3::new(0.025, 0.018, 0.012)));
        for side in [-1.0, 1.0] {
            let beside = Vec3::new(0.0, angle(1).sin(), angle(2).sin()) * 4e-3;
            let position = (Vec3::x() * 0.035 + beside) * side;
            let turn = Vec3::new(angle(3).sin(), angle(4).sin(), angle(5).sin()) * 2.0 * side;
            let at = Pose { position, orientation: Quat::from_scaled_axis(turn) };
            let grain = scene.grain(shape, at) as usize;
            scene.state.velocity[grain] = Vec3::x() * (-2.0 * side);
            let angular_velocity = Vec3::new(angle(6).sin(), angle(7).sin(), angle(8).sin() * side);
            scene.state.angular_velocity[grain] = angular_velocity.normalize() * 100.0;
        }
        scene.run(0.03);
        missed += scene.state.energy.balance_error().abs();
        taken += scene.state.energy.dissipated;
    }
    assert!(taken > 0.1, "they hardly touch: {taken} J");
    missed / taken
}

#[test]
fn the_energy_error_of_rotating_grains_falls_with_the_square_of_the_step() {
    let missed = [400_000, 200_000, 100_000].map(missed_by_the_ledger);
    for pair in missed.windows(2) {
        assert!(pair[1] < 0.4 * pair[0], "{missed:?}");
    }
    assert!(missed[0] < 2e-3, "{missed:?}");
}
