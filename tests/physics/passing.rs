//! Bodies that pass each other without touching leave each other alone (T-40).

use crate::common::scene::Scene;
use ballast::geometry::{GrainShape, convex_hull, random_grain, random_rotation};
use ballast::math::{Pose, Vec3};
use ballast::model::Part;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn cube(half: f64) -> Vec<Vec3> {
    (0..8).map(|i| Vec3::from_fn(|axis, _| if i >> axis & 1 == 0 { -half } else { half })).collect()
}

#[test]
fn a_stone_that_passes_a_block_keeps_its_velocity() {
    for clearance in [1e-4, 3e-4, 1e-3, 5e-3] {
        for speed in [0.5, 1.0, 3.0, 5.0] {
            for step_ns in [200_000, 500_000, 800_000, 1_000_000] {
                for tilt in [0.0, 0.3] {
                    let mut scene = Scene::new(step_ns, 0.5);
                    scene.model.gravity = Vec3::zeros();
                    scene.model.stepping.detection_distance = 4e-4;
                    let stone = scene.shape(convex_hull(&cube(0.01)).expect("a cube").0);
                    let orientation = ballast::math::rotation::exp(&Vec3::new(0.0, tilt, 0.0));
                    let width = cube(0.01).iter().map(|v| (orientation * v).x).fold(0.0, f64::max);
                    let position = Vec3::new(-width - clearance, 0.001, 0.03);
                    scene.grain(stone, Pose { position, orientation });
                    let block = scene.shape(convex_hull(&cube(0.05)).expect("a cube").0);
                    let part = Part::Convex { shape: block, pose: Pose::identity() };
                    let at = Pose { position: Vec3::new(0.05, 0.0, -0.05), ..Pose::identity() };
                    scene.driven("block", part, at, 0.5);
                    let velocity = Vec3::new(0.0, 0.0, -speed);
                    scene.state.velocity[0] = velocity;
                    scene.run(0.06 / speed);
                    let change = (scene.state.velocity[0] - velocity).norm() / speed;
                    let spin = scene.state.angular_velocity[0].norm();
                    assert!(
                        change < 1e-12 && spin < 1e-9,
                        "clearance {clearance}, {speed} m/s, {step_ns} ns, tilt {tilt}: {change}, {spin} rad/s"
                    );
                }
            }
        }
    }
}

#[test]
fn stones_that_pass_each_other_keep_their_velocities() {
    let mut rng = Pcg64::seed_from_u64(11);
    for i in 0..60 {
        let mut scene = Scene::new(800_000, 0.5);
        scene.model.gravity = Vec3::zeros();
        scene.model.stepping.detection_distance = 4e-4;
        let clearance = rng.random_range(1e-4..5e-3);
        let speed = rng.random_range(0.5..5.0);
        let mut widths = [0.0; 2];
        let mut poses = [Pose::identity(); 2];
        let mut shapes = [0; 2];
        for k in 0..2 {
            let stone = random_grain(&mut rng, &GrainShape::default(), 0.03).expect("a stone");
            poses[k].orientation = random_rotation(&mut rng);
            let along = |v: &Vec3| (poses[k].orientation * v).x * if k == 0 { 1.0 } else { -1.0 };
            widths[k] = stone.vertices.iter().map(along).fold(0.0, f64::max);
            shapes[k] = scene.shape(stone);
        }
        poses[1].position = Vec3::new(widths[0] + widths[1] + clearance, 0.0, 0.05);
        for k in 0..2 {
            scene.grain(shapes[k], poses[k]);
        }
        let velocity = [Vec3::new(0.0, 0.0, 0.5 * speed), Vec3::new(0.0, 0.0, -0.5 * speed)];
        scene.state.velocity.copy_from_slice(&velocity);
        scene.run(0.1 / speed);
        for k in 0..2 {
            let change = (scene.state.velocity[k] - velocity[k]).norm() / speed;
            assert!(change < 1e-12, "pair {i}: clearance {clearance}, {speed} m/s: {change}");
        }
    }
}
