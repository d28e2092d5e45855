//! Free flight: the scheme alone (T-1) to (T-3).

use crate::common::scene::{GRAVITY, SCHEDULES, Scene};
use ballast::geometry::hull::cuboid;
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

/// Relative error of the kinetic energy, and of the angular momentum, of a tumbling block after 0.2 s.
fn tumbling_error(step_ns: u64) -> (f64, f64) {
    let mut scene = Scene::new(step_ns, 0.5);
    scene.model.gravity = Vec3::zeros();
    let block = scene.shape(cuboid(Vec3::new(0.05, 0.035, 0.02)));
    scene.grain(block, Pose::identity());
    scene.state.spin[0] = Vec3::new(4.0, 20.0, 7.0);
    let inertia = scene.model.grains.inertia[0];
    let momentum = |scene: &Scene| {
        let q = scene.state.orientation[0];
        q * inertia.component_mul(&(q.inverse() * scene.state.spin[0]))
    };
    let before = momentum(&scene);
    scene.run(0.2);
    let ledger = scene.state.energy;
    let energy = (ledger.kinetic - ledger.initial_kinetic) / ledger.initial_kinetic;
    (energy.abs(), (momentum(&scene) - before).norm() / before.norm())
}

#[test]
fn errors_of_tumbling_shrink_with_the_step() {
    let errors = [1_000_000, 500_000, 250_000].map(tumbling_error);
    for (coarse, fine) in errors.iter().zip(&errors[1..]) {
        for (coarse, fine) in [(coarse.0, fine.0), (coarse.1, fine.1)] {
            // First order: halves; a second order would quarter.
            assert!((1.7..5.0).contains(&(coarse / fine)), "{errors:?}");
        }
    }
    assert!(errors[2].0 < 0.01 && errors[2].1 < 0.01, "{errors:?}");
}
