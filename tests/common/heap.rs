//! A heap of random stones in an open box: enough contacts to exercise every path of the solver.

use super::scene::{Random, Scene};
use ballast::geometry::convex_hull;
use ballast::math::{Pose, Vec3};

/// Edge of the box, m.
pub const SIZE: f64 = 0.2;

/// `layers` of 3 × 3 stones of about 4 cm, hung above each other in the box, falling.
pub fn falling(layers: usize, step_ns: u64) -> Scene {
    let mut random = Random(7);
    let mut scene = Scene::new(step_ns, 0.6);
    for _ in 0..4 {
        let points: Vec<Vec3> = (0..14)
            .map(|_| random.direction().component_mul(&Vec3::new(0.028, 0.024, 0.02)))
            .collect();
        let (stone, _) = convex_hull(&points).expect("points around a centre");
        scene.shape(stone);
    }
    for layer in 0..layers {
        for cell in 0..9 {
            let place = Vec3::new(
                SIZE * (0.5 + (cell % 3) as f64) / 3.0 + 2e-3 * (random.next() - 0.5),
                SIZE * (0.5 + (cell / 3) as f64) / 3.0 + 2e-3 * (random.next() - 0.5),
                0.04 + 0.06 * layer as f64,
            );
            let pose = Pose { position: place, orientation: random.orientation() };
            scene.grain((cell as u32 + layer as u32) % 4, pose);
        }
    }
    scene.container(SIZE, 0.6);
    scene
}
