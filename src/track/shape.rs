//! Parts of driven bodies: cuboids and convex polyhedra, and their mass.

use crate::error::{Error, Result};
use crate::geometry::{self, AxisBox, Clipper, Polyhedron};
use crate::math::{Pose, Vec3};
use crate::model::{DofMode, Mount, Part};

/// Overlap with a sleeper or plate that counts as none, of the grain's volume.
const TOUCH: f64 = 1e-9;

/// `size` if its edges are finite and positive, else an error that names the place.
pub(super) fn solid(size: &Vec3, place: impl Fn() -> String) -> Result<Vec3> {
    if size.iter().all(|s| s.is_finite() && *s > 0.0) {
        return Ok(*size);
    }
    Err(Error::Model {
        place: place(),
        expected: "edges longer than 0 m".into(),
        found: format!("{} x {} x {} m", size.x, size.y, size.z),
    })
}

/// A cuboid of the given edges (m) whose middle is `centre` in the body's frame.
pub(super) fn cuboid(shapes: &mut Vec<Polyhedron>, size: &Vec3, centre: Vec3) -> Part {
    part(shapes, geometry::cuboid(size * 0.5), Pose::at(centre))
}

/// A part of the given shape and pose in the body's frame.
///
/// Equal parts share one shape: sixteen tines are two shapes.
pub(super) fn part(shapes: &mut Vec<Polyhedron>, shape: Polyhedron, pose: Pose) -> Part {
    let index = shapes.iter().position(|s| *s == shape).unwrap_or_else(|| {
        shapes.push(shape);
        shapes.len() - 1
    });
    Part::Convex { shape: index as u32, pose }
}

/// Returns true if a polyhedron at `pose` reaches into a box.
pub(super) fn overlaps(
    clipper: &mut Clipper,
    shape: &Polyhedron,
    pose: &Pose,
    region: &AxisBox,
) -> bool {
    let p = pose.position;
    let apart =
        (0..3).any(|k| p[k] + shape.radius < region.low[k] || p[k] - shape.radius > region.high[k]);
    !apart && clipper.volume_inside(shape, pose, &region.half_spaces()) > TOUCH * shape.volume
}

/// Mount of a body of cuboids, given by their middles and sizes (m), of one density (kg/m³) or, if it is given, one mass (kg).
///
/// Moments of inertia are those about the body's axes: products of inertia are left out.
pub(super) fn cuboid_mount(
    cuboids: &[(Vec3, Vec3)],
    density: f64,
    mass: Option<f64>,
    freedoms: [DofMode; 6],
) -> Mount {
    let volume: f64 = cuboids.iter().map(|(_, size)| size.product()).sum();
    let mass = mass.unwrap_or(density * volume);
    let shares =
        || cuboids.iter().map(|(middle, size)| (mass * size.product() / volume, middle, size));
    let centre = shares().map(|(m, middle, _)| middle * m).sum::<Vec3>() / mass;
    let inertia = shares()
        .map(|(m, middle, size)| {
            let (square, arm) = (size.component_mul(size), middle - centre);
            let arm = arm.component_mul(&arm);
            (Vec3::repeat(square.sum()) - square) * (m / 12.0) + (Vec3::repeat(arm.sum()) - arm) * m
        })
        .sum();
    Mount { mass, inertia, centre, dof_modes: freedoms }
}

#[cfg(test)]
pub(super) mod test_support {
    use super::*;
    use crate::geometry::AxisBox;

    /// Bounding box of a convex part in the body's frame.
    pub fn extent(shapes: &[Polyhedron], part: &Part) -> (Vec3, Vec3) {
        let Part::Convex { shape, pose } = part else { panic!("a convex part") };
        let corners = shapes[*shape as usize].vertices.iter().map(|v| pose.point(v));
        let AxisBox { low, high } = AxisBox::around(corners);
        (low, high)
    }
}
