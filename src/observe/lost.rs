//! Grains that have left the bed.

use crate::geometry::{AxisBox, HalfSpace};
use crate::math::Vec3;
use crate::model::{Model, Part, Role};
use crate::state::State;

/// Counts the grains that have left the bed.
///
/// Their centre is inside a boundary half-space, or outside and below all convex parts of the boundary.
pub fn lost_grains(model: &Model, state: &State) -> usize {
    let grains = model.grains.len();
    let (mut planes, mut corners) = (Vec::new(), Vec::new());
    let bodies = model.driven.iter().enumerate();
    for (d, driven) in bodies.filter(|(_, driven)| driven.role == Role::Boundary) {
        let body = state.pose(grains + d);
        for part in &driven.parts {
            match part {
                Part::HalfSpace { normal, offset } => {
                    planes.push(HalfSpace { normal: *normal, offset: *offset }.at(&body));
                }
                Part::Convex { shape, pose } => {
                    let pose = body.then(pose);
                    let vertices = &model.shapes[*shape as usize].vertices;
                    corners.extend(vertices.iter().map(|v| pose.point(v)));
                }
            }
        }
    }
    let AxisBox { low, high } = AxisBox::around(corners);
    let has_box = low.x <= high.x;
    let is_outside = |p: &Vec3| {
        has_box && (p.x < low.x || p.x > high.x || p.y < low.y || p.y > high.y || p.z < low.z)
    };
    let is_behind = |p: &Vec3| planes.iter().any(|wall| wall.normal.dot(p) < wall.offset);
    state.position[..grains].iter().filter(|p| is_outside(p) || is_behind(p)).count()
}

#[cfg(test)]
mod tests {
    use super::super::scene;
    use super::*;
    use crate::math::Pose;

    #[test]
    fn grains_behind_a_wall_or_beside_the_box_are_lost() {
        let mut model = scene::cubes(3);
        let places = [[0.0, 0.0, 1.0], [5.0, 0.0, 1.0], [0.0, 0.0, -3.0], [0.0, 0.0, 0.0]];
        let state = scene::at(&places);
        assert_eq!(lost_grains(&model, &state), 0, "nothing bounds them");
        let floor = Part::HalfSpace { normal: Vec3::z(), offset: -1.0 };
        model.driven.push(scene::driven("floor", Role::Boundary, vec![floor]));
        assert_eq!(lost_grains(&model, &state), 1);
        let slab = Part::Convex { shape: 0, pose: Pose::at(Vec3::zeros()) };
        model.driven[0].parts = vec![slab];
        assert_eq!(lost_grains(&model, &state), 2);
        model.driven[0].role = Role::Tine;
        assert_eq!(lost_grains(&model, &state), 0, "a tine holds nothing in");
    }
}
