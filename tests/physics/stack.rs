//! Boxes on top of each other: weight at the base, no drift, sweeps that grow with the square.

use crate::common::scene::{GRAVITY, SCHEDULES, Scene};
use ballast::geometry::cuboid;
use ballast::math::{Pose, Vec3};
use ballast::model::{Norm, Schedule};

const EDGE: f64 = 0.1;

fn stack(count: usize, friction: f64, step_ns: u64, schedule: Schedule) -> Scene {
    let mut scene = Scene::new(step_ns, friction).scheduled(schedule, [1, 1, 3]);
    let cube = scene.shape(cuboid(Vec3::repeat(0.5 * EDGE)));
    for k in 0..count {
        scene.grain(cube, Pose::at(Vec3::new(0.0, 0.0, EDGE * (k as f64 + 0.5))));
    }
    scene.plane("floor", Pose::identity(), friction);
    scene
}

#[test]
fn the_base_carries_the_weight_and_nothing_drifts_in_ten_seconds() {
    let count = 4;
    for schedule in SCHEDULES {
        let mut scene = stack(count, 0.5, 2_000_000, schedule);
        let start = scene.state.position.clone();
        let weight = scene.model.grains.mass.iter().sum::<f64>() * GRAVITY * scene.h();
        for step in 0..5000 {
            let report = scene.step();
            // The floor is pushed down.
            let pushed = -report.reactions[0].impulse.z;
            assert!(
                (pushed - weight).abs() < 1e-5 * weight,
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
fn a_stack_without_friction_is_solved_by_the_natural_map() {
    for schedule in SCHEDULES {
        let mut scene = stack(4, 0.0, 1_000_000, schedule);
        scene.model.solver.norm = Norm::NaturalMap;
        scene.model.solver.tolerance = Some(1e-6);
        scene.model.solver.max_iterations = 1000;
        for step in 0..50 {
            let report = scene.step();
            let residual = report.residuals.natural_map;
            assert!(report.converged, "{schedule:?}, step {step}: {residual}");
        }
    }
}

/// Returns the part of the weight that the floor does not carry after `sweeps` sweeps from zero impulses.
fn lacking(count: usize, sweeps: u32) -> f64 {
    // Without friction only the weight has to travel down: with it, the stack bends as well, which
    // settles with the fourth power of the height.
    let mut scene = stack(count, 0.0, 1_000_000, Schedule::Sequential);
    scene.model.solver.tolerance = None;
    scene.model.solver.max_iterations = sweeps;
    let weight = scene.model.grains.mass.iter().sum::<f64>() * GRAVITY * scene.h();
    let report = scene.step();
    1.0 + report.reactions[0].impulse.z / weight
}

#[test]
fn sweeps_grow_with_the_square_of_the_height() {
    // The weight diffuses: after a number of sweeps in proportion to N², as much is lacking
    // whatever N.
    let lacking = [4, 8, 16].map(|n| lacking(n, (n * n) as u32));
    for pair in lacking.windows(2) {
        assert!((0.5..2.0).contains(&(pair[0] / pair[1])), "{lacking:?}");
    }
    assert!(lacking.iter().all(|l| (1e-3..0.7).contains(l)), "{lacking:?}");
}
