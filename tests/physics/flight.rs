//! Free flight: the scheme alone (T-1) to (T-3).

use crate::common::scene::{GRAVITY, SCHEDULES, Scene};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Vec3};

#[test]
fn a_thrown_block_follows_its_parabola_exactly() {
    for schedule in SCHEDULES {
        let mut scene = Scene::new(1_000_000, 0.5).scheduled(schedule, [1, 1, 1]);
        let block = scene.shape(cuboid(Vec3::new(0.05, 0.04, 0.03)));
        scene.grain(block, Pose::identity());
        scene.state.velocity[0] = Vec3::new(1.0, -2.0, 3.0);
        scene.run(0.5);
        let expected = Vec3::new(0.5, -1.0, 1.5 - 0.125 * GRAVITY);
        let missed = (scene.state.position[0] - expected).norm();
        assert!(missed < 1e-12, "{schedule:?}: missed by {missed} m");
    }
}

/// A tumbling block without weight, and its angular momentum.
fn tumbling(step_ns: u64, angular_velocity: Vec3) -> Scene {
    let mut scene = Scene::new(step_ns, 0.5);
    scene.model.gravity = Vec3::zeros();
    let block = scene.shape(cuboid(Vec3::new(0.05, 0.035, 0.02)));
    scene.grain(block, Pose::identity());
    scene.state.angular_velocity[0] = angular_velocity;
    scene
}

/// Angular momentum of the first grain, kg m²/s.
fn momentum(scene: &Scene) -> Vec3 {
    let q = scene.state.orientation[0];
    q * scene.model.grains.inertia[0]
        .component_mul(&(q.inverse() * scene.state.angular_velocity[0]))
}

#[test]
fn a_tumbling_block_keeps_its_angular_momentum() {
    let mut scene = tumbling(1_000_000, Vec3::new(4.0, 20.0, 7.0));
    let before = momentum(&scene);
    scene.run(0.2);
    let missed = (momentum(&scene) - before).norm();
    assert!(missed < 1e-13 * before.norm(), "{missed} of {before}");
}

/// Largest relative error of the kinetic energy of a tumbling block within 0.2 s.
fn energy_error(step_ns: u64) -> f64 {
    let mut scene = tumbling(step_ns, Vec3::new(4.0, 20.0, 7.0));
    let mut worst = 0.0_f64;
    while scene.state.time() < 0.2 {
        scene.step();
        let ledger = scene.state.energy;
        let change = ledger.kinetic - ledger.initial_kinetic;
        worst = worst.max(change.abs() / ledger.initial_kinetic);
    }
    worst
}

#[test]
fn the_energy_of_tumbling_errs_with_the_square_of_the_step() {
    let errors = [1_000_000, 500_000, 250_000].map(energy_error);
    for (coarse, fine) in errors.iter().zip(&errors[1..]) {
        assert!((3.5..4.5).contains(&(coarse / fine)), "{errors:?}");
    }
    assert!(errors[2] < 1e-3, "{errors:?}");
}

#[test]
fn a_spin_never_grows_by_itself_however_long_the_step() {
    // A stone flicked away by a tine: 2 ms, up to four turns per step.
    for speed in [100.0, 600.0, 3000.0, 12000.0] {
        let mut scene = tumbling(2_000_000, Vec3::new(0.2, 0.9, 0.4) * speed);
        let (before, inertia) = (momentum(&scene).norm(), scene.model.grains.inertia[0]);
        for step in 0..2000 {
            scene.step();
            let kept = momentum(&scene).norm() / before - 1.0;
            assert!(kept.abs() < 1e-9, "{speed} rad/s, step {step}: momentum changed by {kept:e}");
        }
        let energy = scene.state.energy.kinetic * 2.0 / (before * before);
        let (least, most) = (1.0 / inertia.max(), 1.0 / inertia.min());
        assert!((0.999 * least..1.001 * most).contains(&energy), "{speed} rad/s: {energy}");
    }
}
