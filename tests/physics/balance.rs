//! Balances of a heap in a shaken box: momentum to rounding, energy to the scheme's order.

use crate::common::heap;
use crate::common::scene::{SCHEDULES, Scene};
use ballast::math::Vec3;
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
        scene.model.solver.iterations = 7;
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

#[test]
fn moments_change_the_angular_momentum() {
    for schedule in SCHEDULES {
        let mut scene = heap::falling(3, 1_000_000).scheduled(schedule, [2, 1, 2]);
        for step in 0..300 {
            shake(&mut scene);
            let report = scene.step();
            let (motion, grains) = (&scene.workspace.motion, &scene.model.grains);
            let mut gained = Vec3::zeros();
            let mut scale = 0.0;
            for i in 0..grains.len() {
                let push = (scene.state.velocity[i] - motion.velocity[i]) * grains.mass[i];
                let q = motion.orientation[i];
                let turn = q.inverse() * (scene.state.spin[i] - motion.spin[i]);
                gained +=
                    motion.position[i].cross(&push) + q * turn.component_mul(&grains.inertia[i]);
                scale += motion.position[i].norm()
                    * (push.norm() + 1e-6 * grains.mass[i] * motion.velocity[i].norm());
            }
            for (d, reaction) in report.reactions.iter().enumerate() {
                let origin = motion.position[grains.len() + d];
                gained += reaction.angular_impulse + origin.cross(&reaction.impulse);
                scale += origin.norm() * reaction.impulse.norm();
            }
            // Levers are rounded to single precision, each side of a contact by itself.
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
