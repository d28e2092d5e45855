//! Exact mass properties of a closed polyhedral surface, as a sum of signed tetrahedra.
//!
//! Reads: corners and faces. Writes: nothing. Cost: O(corners of all faces).
//! Contract: faces run counter-clockwise seen from outside; the origin is near the body, since
//! the cancellation of signed volumes grows with its distance.

use crate::math::{Mat3, Vec3};

/// Volume integrals of a solid of unit density.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MassProperties {
    /// Volume, m³.
    pub volume: f64,
    /// Centre of mass, m.
    pub centre: Vec3,
    /// Inertia tensor about the centre of mass, axes of the points, m⁵.
    pub inertia: Mat3,
}

/// Integrates 1, x and x xᵀ over the solid inside `faces`.
///
/// `None` if the signed volume is not above zero. Over the tetrahedron of the origin and a triangle
/// `(a, b, c)` of signed volume `V`, `∫ x = V s/4` and `∫ x xᵀ = V/20 (a aᵀ + b bᵀ + c cᵀ + s sᵀ)`
/// with `s = a + b + c`.
pub fn mass_properties<'a, F>(points: &[Vec3], faces: F) -> Option<MassProperties>
where
    F: Iterator<Item = &'a [u16]> + Clone,
{
    let mut volume = 0.0;
    let mut first = Vec3::zeros();
    for_each_triangle(points, faces.clone(), |v, [a, b, c]| {
        volume += v;
        first += (a + b + c) * (v / 4.0);
    });
    if !(volume > 0.0 && volume.is_finite()) {
        return None;
    }
    let centre = first / volume;
    // Second pass about the centre: shifting the tensor instead would cancel digits.
    let mut second = Mat3::zeros();
    for_each_triangle(points, faces, |_, [a, b, c]| {
        let (a, b, c) = (a - centre, b - centre, c - centre);
        let v = a.dot(&b.cross(&c)) / 6.0;
        let s = a + b + c;
        let sum = a * a.transpose() + b * b.transpose() + c * c.transpose() + s * s.transpose();
        second += sum * (v / 20.0);
    });
    let inertia = Mat3::identity() * second.trace() - second;
    Some(MassProperties { volume, centre, inertia })
}

/// Calls `visit` with the signed volume and the corners of each triangle of each face's fan.
fn for_each_triangle<'a>(
    points: &[Vec3],
    faces: impl Iterator<Item = &'a [u16]>,
    mut visit: impl FnMut(f64, [Vec3; 3]),
) {
    for face in faces {
        let a = points[face[0] as usize];
        for pair in face[1..].windows(2) {
            let (b, c) = (points[pair[0] as usize], points[pair[1] as usize]);
            visit(a.dot(&b.cross(&c)) / 6.0, [a, b, c]);
        }
    }
}

/// Returns moments and axes (columns, a rotation) of a symmetric inertia tensor.
///
/// A tensor that is diagonal to rounding keeps its axes, so that boxes and cubes stay aligned with their given axes.
/// Otherwise moments ascend, and the largest component of the first two axes is positive.
pub fn principal_axes(inertia: &Mat3) -> (Vec3, Mat3) {
    let off = inertia[(0, 1)].abs().max(inertia[(0, 2)].abs()).max(inertia[(1, 2)].abs());
    if off <= 1e-12 * inertia.diagonal().amax() {
        return (inertia.diagonal(), Mat3::identity());
    }
    let eigen = inertia.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let axis = |k: usize| -> Vec3 {
        let v: Vec3 = eigen.eigenvectors.column(k).into();
        if v[v.iamax()] < 0.0 { -v } else { v }
    };
    let (x, y) = (axis(order[0]), axis(order[1]));
    (order.map(|k| eigen.eigenvalues[k]).into(), Mat3::from_columns(&[x, y, x.cross(&y)]))
}
