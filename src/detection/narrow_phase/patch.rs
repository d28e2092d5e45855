//! Where two bodies are near each other along an axis: all corners of the gap between them.
//!
//! Seen along the axis, the gap between the facing surfaces of two convex bodies is a convex
//! function, linear over pieces whose corners are vertices of A, vertices of B, and crossings of an
//! edge of A with an edge of B. Corners with a gap up to the alert distance are all that can touch
//! next. A body that rolls over a vertex or rocks over an edge is held by the neighbouring corner
//! before it gets there; the closest features alone would let it in.

use super::cloud::Cloud;
use super::edges::NearEdge;
use super::feature;
use super::reduce::Candidate;
use crate::geometry::Polyhedron;
use crate::math::Vec3;

/// The axis and the bounds of the search, in the frame of A.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    /// From A to B.
    pub normal: Vec3,
    /// Largest gap of interest, m.
    pub alert: f64,
    /// How far beside a face a vertex may be and still count as over it, m.
    pub tolerance: f64,
}

impl Axis {
    /// Appends vertex `v` of the body at `point` if the other body's surface is near above it.
    ///
    /// `local` and `direction` are the vertex and the axis towards the other body, in the frame of
    /// that body; `side` is the axis's sign for the body of the vertex.
    pub fn vertex(
        &self,
        (feature, point, side): (u64, Vec3, f64),
        other: &Polyhedron,
        (local, direction): (&Vec3, &Vec3),
        out: &mut Vec<Candidate>,
    ) {
        let Some(gap) = distance_along(other, local, direction, self.tolerance) else { return };
        if gap <= self.alert {
            out.push(Candidate { point: point + self.normal * (0.5 * side * gap), gap, feature });
        }
    }

    /// Appends the crossings of edges that face each other and come within `reach` of each other.
    pub fn crossings(
        &self,
        (a, near_a): (&Polyhedron, &[NearEdge]),
        (b, near_b): (&Polyhedron, &[NearEdge]),
        reach: f64,
        out: &mut Vec<Candidate>,
    ) {
        let n = &self.normal;
        for ea in near_a.iter().filter(|e| e.looks_along(n)) {
            // n × edge: its product with a vector is that vector's distance beside the edge.
            let beside = n.cross(&ea.along);
            for eb in near_b.iter().filter(|e| e.looks_along(&-n)) {
                if !ea.may_reach(eb, reach) {
                    continue;
                }
                let between = eb.start - ea.start;
                // Ends of eb on one side of ea: most pairs.
                let (p, q) = (beside.dot(&between), beside.dot(&(between + eb.along)));
                if p * q >= 0.0 {
                    continue;
                }
                let t = p / (p - q);
                let over = between + eb.along * t;
                let flat = ea.along - n * n.dot(&ea.along);
                let s = flat.dot(&over) / flat.norm_squared();
                if !(s > 0.0 && s < 1.0) {
                    continue;
                }
                let gap = n.dot(&(over - ea.along * s));
                if gap <= self.alert {
                    let feature = feature::edges(
                        (ea.index, a.edges[ea.index as usize].vertices, s),
                        (eb.index, b.edges[eb.index as usize].vertices, t),
                    );
                    let point = ea.start + ea.along * s + n * (0.5 * gap);
                    out.push(Candidate { point, gap, feature });
                }
            }
        }
    }
}

/// Distance from `x` along the unit vector `n` to where the line enters the body, negative behind
/// `x`; `None` if the line passes by more than `tolerance` beside it.
fn distance_along(body: &Polyhedron, x: &Vec3, n: &Vec3, tolerance: f64) -> Option<f64> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    for (normal, offset) in body.face_normals.iter().zip(&body.face_offsets) {
        let slope = normal.x * n.x + normal.y * n.y + normal.z * n.z;
        let depth = offset - (normal.x * x.x + normal.y * x.y + normal.z * x.z);
        if slope < -STEEP {
            enter = enter.max(depth / slope);
        } else if slope > STEEP {
            leave = leave.min((depth + tolerance) / slope);
        } else if depth < -tolerance {
            return None;
        }
    }
    (enter <= leave + tolerance).then_some(enter)
}

/// Faces steeper than this along the axis count as its sides.
const STEEP: f64 = 1e-9;

/// Vertices of a cloud at most `slab` above its lowest along `n`.
pub fn near_lowest(
    cloud: &Cloud,
    count: usize,
    n: &Vec3,
    slab: f64,
) -> impl Iterator<Item = usize> {
    let limit = cloud.lowest(n) + slab;
    (0..count).filter(move |&i| n.dot(&cloud.get(i)) <= limit)
}
