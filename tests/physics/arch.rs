//! A semicircular arch of voussoirs stands iff it is thick enough (Milankovitch: 0.1075 of the mean
//! radius, for friction that excludes sliding).

use crate::common::scene::{SCHEDULES, Scene};
use ballast::geometry::convex_hull;
use ballast::math::{Pose, Vec3};
use ballast::model::Schedule;
use std::f64::consts::PI;

const VOUSSOIRS: usize = 16;

/// An arch in the x-z plane of mean radius 1 m, springing from the floor.
fn arch(thickness: f64, schedule: Schedule) -> Scene {
    let mut scene = Scene::new(2_000_000, 1.0).scheduled(schedule, [3, 1, 1]);
    scene.model.solver.tolerance = Some(1e-6);
    // The same for both arches: what stands must not fall for want of sweeps.
    scene.model.solver.max_iterations = 500;
    for k in 0..VOUSSOIRS {
        let mut points = vec![];
        for joint in [k, k + 1] {
            let angle = PI * joint as f64 / VOUSSOIRS as f64;
            for radius in [1.0 - 0.5 * thickness, 1.0 + 0.5 * thickness] {
                for y in [-0.15, 0.15] {
                    points.push(Vec3::new(radius * angle.cos(), y, radius * angle.sin()));
                }
            }
        }
        let (stone, pose) = convex_hull(&points).expect("a voussoir");
        let shape = scene.shape(stone);
        scene.grain(shape, pose);
    }
    scene.plane("floor", Pose::identity(), 1.0);
    scene
}

/// Returns how far the crown sinks in `seconds`, m.
fn sinking(thickness: f64, schedule: Schedule, seconds: f64) -> f64 {
    let mut scene = arch(thickness, schedule);
    let crown = VOUSSOIRS / 2;
    let start = scene.state.position[crown].z;
    scene.run(seconds);
    start - scene.state.position[crown].z
}

#[test]
fn a_thick_arch_stands() {
    for schedule in SCHEDULES {
        let sunk = sinking(0.12, schedule, 1.0);
        assert!(sunk.abs() < 1e-4, "{schedule:?}: sank by {sunk} m");
    }
}

#[test]
fn a_thin_arch_falls() {
    for schedule in SCHEDULES {
        let sunk = sinking(0.095, schedule, 1.0);
        assert!(sunk > 0.1, "{schedule:?}: sank by {sunk} m only");
    }
}
