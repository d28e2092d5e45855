//! Sliding turns into rolling: 5/7 of the speed for a sphere.

use crate::common::scene::{GRAVITY, SCHEDULES, Scene};
use ballast::geometry::convex_hull;
use ballast::math::{Pose, Vec3};
use std::f64::consts::TAU;

const RADIUS: f64 = 0.1;
const SIDES: usize = 512;

/// A sphere of rings of points about y. The two rings next to the equator have enough points that
/// the body rolls smoothly, on both of them; the others only shape its mass.
fn ball() -> Vec<Vec3> {
    let mut points = vec![];
    for (latitude, sides) in [(0.05, SIDES), (0.35, 48), (0.7, 40), (1.05, 28), (1.35, 16)] {
        for side in 0..sides {
            let angle = TAU * side as f64 / sides as f64;
            let ring = RADIUS * f64::cos(latitude);
            for y in [RADIUS * latitude.sin(), -RADIUS * latitude.sin()] {
                points.push(Vec3::new(ring * angle.cos(), y, ring * angle.sin()));
            }
        }
    }
    points
}

#[test]
fn a_sliding_ball_rolls_with_five_sevenths_of_its_speed() {
    let (friction, speed) = (0.5, 1.0);
    for schedule in SCHEDULES {
        let mut scene = Scene::new(100_000, friction).scheduled(schedule, [1, 1, 1]);
        let (polyhedron, local) = convex_hull(&ball()).expect("points of a sphere");
        let shape = scene.shape(polyhedron);
        let lowest = RADIUS * 0.05_f64.cos() * (TAU / 2.0 / SIDES as f64).cos();
        let pose = Pose { position: Vec3::new(0.0, 0.0, lowest), ..local };
        scene.grain(shape, pose);
        scene.plane("floor", Pose::identity(), friction);
        scene.state.velocity[0].x = speed;
        let slides_until = 2.0 * speed / (7.0 * friction * GRAVITY);

        scene.run(0.5 * slides_until);
        let half_way = scene.state.velocity[0].x;
        let expected = speed - 0.5 * friction * GRAVITY * slides_until;
        // Facets of δ = 2π/512 rock the normal force by δ/2 of the radius: below 1 %.
        assert!((half_way - expected).abs() < 0.01, "{schedule:?}: {half_way}, not {expected}");

        scene.run(0.6 * slides_until);
        let (v, w) = (scene.state.velocity[0].x, scene.state.angular_velocity[0].y);
        let slip = (v - RADIUS * w) / speed;
        assert!(slip.abs() < 0.02, "{schedule:?}: still slips by {slip}");
        // The rings' inertia is within 1 % of the sphere's; each facet that lands takes 0.36 δ²
        // of the spin, 0.4 % per radian.
        assert!((v / speed - 5.0 / 7.0).abs() < 0.01, "{schedule:?}: {v} m/s");
    }
}
