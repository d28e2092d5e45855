//! Contact points of a polyhedron and a half-space.

use super::reduce::{self, Candidate};
use super::{Point, Scratch, Solid, feature};
use crate::math::Vec3;

/// Appends to `scratch.points` the vertices of `a` at most `alert` (m) above the plane
/// `normal · x = offset` of the world: four at most, spanning the largest area, the deepest among
/// them, sorted by feature.
pub fn touch_half_space(a: Solid, normal: &Vec3, offset: f64, alert: f64, scratch: &mut Scratch) {
    let centre = normal.dot(&a.pose.position) - offset;
    if centre > a.shape.radius * (1.0 + 1e-9) + alert {
        return;
    }
    let n = a.pose.orientation.inverse() * normal;
    let Scratch { candidates, hull, .. } = scratch;
    candidates.clear();
    for (v, vertex) in a.shape.vertices.iter().enumerate() {
        let gap = n.dot(vertex) + centre;
        if gap <= alert {
            candidates.push(Candidate { point: *vertex, gap, feature: feature::vertex(v) });
        }
    }
    reduce::keep_four(candidates, &n, alert, a.shape.radius, hull);
    scratch.points.extend(scratch.candidates.iter().map(|c| Point {
        feature: c.feature,
        point: a.pose.point(&c.point) - normal * (0.5 * c.gap),
        normal: *normal,
        gap: c.gap,
    }));
}
