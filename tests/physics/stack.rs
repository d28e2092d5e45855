//! Boxes on top of each other: weight at the base, no drift, sweeps that grow with the square.

use crate::common::scene::{GRAVITY, SCHEDULES, Scene, tight};
use ballast::geometry::hull::cuboid;
use ballast::math::{Pose, Vec3};
use ballast::model::{Norm, PartitionRule, Schedule, Solver};

const EDGE: f64 = 0.1;

fn stack(count: usize, step_ns: u64, schedule: Schedule) -> Scene {
    let mut scene = Scene::new(step_ns, 0.5).scheduled(schedule, [1, 1, 3]);
    let cube = scene.shape(cuboid(Vec3::repeat(0.5 * EDGE)));
    for k in 0..count {
        scene.grain(cube, Pose::at(Vec3::new(0.0, 0.0, EDGE * (k as f64 + 0.5))));
    }
    scene.plane("floor", Pose::identity(), 0.5);
    scene
}

#[test]
fn the_base_carries_the_weight_and_nothing_drifts_in_ten_seconds() {
    let count = 6;
    for schedule in SCHEDULES {
        let mut scene = stack(count, 2_000_000, schedule);
        let start = scene.state.position.clone();
        let weight = scene.model.grains.mass.iter().sum::<f64>() * GRAVITY * scene.h();
        for step in 0..5000 {
            let report = scene.step();
            // The floor is pushed down.
            let pushed = -report.reactions[0].impulse.z;
            assert!(
                (pushed - weight).abs() < 1e-6 * weight,
                "{schedule:?}, step {step}: {pushed} N s, weight {weight} N s"
            );
        }
        for (k, from) in start.iter().enumerate().take(count) {
            let drift = (scene.state.position[k] - from).norm();
            assert!(drift < 1e-6, "{schedule:?}: box {k} drifted by {drift} m");
            let turn = scene.state.orientation[k].angle();
            assert!(turn < 1e-5, "{schedule:?}: box {k} turned by {turn} rad");
        }
    }
}

#[test]
fn sweeps_grow_with_the_square_of_the_height() {
    let sweeps = [4, 8, 16].map(|count| {
        let mut scene = stack(count, 1_000_000, Schedule::Sequential);
        scene.model.solver = Solver {
            tolerance: Some(1e-4),
            norm: Norm::NaturalMap,
            check_every: 1,
            iterations: 100_000,
            ..tight(Schedule::Sequential, PartitionRule::Balanced(1))
        };
        let report = scene.step();
        assert!(report.converged);
        f64::from(report.iterations)
    });
    for pair in sweeps.windows(2) {
        assert!((2.5..6.0).contains(&(pair[1] / pair[0])), "{sweeps:?}");
    }
}
