//! Floor, ends and sides of the box that holds the bed; the top is free.
//!
//! Reads: the plan's box. Writes: driven bodies of one half-space each, at the world's origin.

use crate::math::Vec3;
use crate::model::{ContactStiffness, DrivenBody, Part, Role};

/// Names of the floor and the walls, in the order of all their quantities.
pub const BOUNDARY_NAMES: [&str; 5] =
    ["floor", "wall_x_min", "wall_x_max", "wall_y_min", "wall_y_max"];

/// The five boundaries of a box `[0, size.x] × [0, size.y]` above z = 0, m, each with its friction coefficient.
///
/// Seen along +x, the way the machine travels, y = 0 is the right side.
pub fn boundaries(size: &Vec3, friction: [f64; 5]) -> Vec<DrivenBody> {
    let wall = |k: usize, normal: Vec3, offset: f64| DrivenBody {
        name: BOUNDARY_NAMES[k].into(),
        role: Role::Boundary,
        friction: friction[k],
        stiffness: ContactStiffness::RIGID,
        parts: vec![Part::HalfSpace { normal, offset }],
        mount: None,
    };
    vec![
        wall(0, Vec3::z(), 0.0),
        wall(1, Vec3::x(), 0.0),
        wall(2, -Vec3::x(), -size.x),
        wall(3, Vec3::y(), 0.0),
        wall(4, -Vec3::y(), -size.y),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inside_of_the_box_is_outside_of_every_wall() {
        let size = Vec3::new(0.6, 0.7, 0.45);
        let walls = boundaries(&size, [0.8; 5]);
        assert_eq!(walls.len(), 5);
        let depth = |p: Vec3| -> Vec<f64> {
            walls
                .iter()
                .map(|w| match w.parts[0] {
                    Part::HalfSpace { normal, offset } => normal.dot(&p) - offset,
                    Part::Convex { .. } => panic!("a wall is a half-space"),
                })
                .collect()
        };
        let inside = depth(Vec3::new(0.1, 0.2, 0.3));
        for (found, expected) in inside.iter().zip([0.3, 0.1, 0.5, 0.2, 0.5]) {
            assert!((found - expected).abs() < 1e-15, "{inside:?}");
        }
        assert!(depth(Vec3::new(0.61, 0.2, 0.3))[2] < 0.0);
        assert!(depth(Vec3::new(0.1, 0.71, 0.3))[4] < 0.0);
    }
}
