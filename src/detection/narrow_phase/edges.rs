//! Axes perpendicular to an edge of each body, and closest points of edges.
//!
//! Which edges matter. Let `n0` (A to B) be an axis of separation `s0 = min_B n0·x - max_A n0·x`.
//!
//! * Bodies that overlap, least depth δ along `n`: the Minkowski difference holds the origin, and the
//!   foot of the origin on its nearest facet lies in that facet. So there are p on the edge of A
//!   and q on the edge of B with p - q = δ n, and δ <= -s0. As q is in B, n0·q >= max_A + s0, hence
//!   n0·p >= max_A + s0 - δ >= max_A - 2 |s0|: the edge of A has an end at most 2 |s0| below A's
//!   support plane along n0. Likewise for B.
//! * Bodies apart, closest points p and q at a distance D <= reach: n0·p >= n0·q - D >= max_A + s0 - D,
//!   so the edges (or the edges of the vertices) that hold p and q have an end at most D - s0 off
//!   the support planes.
//!
//! So all edges with an end in a slab of `max(2 |s0|, reach - s0)` decide, usually a handful.

use super::cloud::{Cloud, highest};
use crate::geometry::Polyhedron;
use crate::math::{Mat3, Vec3};

/// An edge in the frame of A, with the outward normals of its two faces.
#[derive(Debug, Clone, Copy)]
pub struct NearEdge {
    pub index: u32,
    pub start: Vec3,
    pub along: Vec3,
    /// `along` is parallel to `left × right`.
    left: Vec3,
    right: Vec3,
    /// A sphere around the part of the edge that is in the slab.
    centre: Vec3,
    radius: f64,
}

impl NearEdge {
    fn new(index: usize, start: Vec3, end: Vec3, left: Vec3, right: Vec3) -> Self {
        let along = end - start;
        Self { index: index as u32, start, along, left, right, centre: start, radius: 0.0 }
    }

    /// Shrinks the sphere to the part of the edge with heights up to 0, those of its ends given.
    fn below(mut self, [h0, h1]: [f64; 2]) -> Self {
        let from = if h0 <= 0.0 { 0.0 } else { h0 / (h0 - h1) };
        let to = if h1 <= 0.0 { 1.0 } else { h0 / (h0 - h1) };
        self.centre = self.start + self.along * (0.5 * (from + to));
        self.radius = 0.5 * (to - from) * self.along.norm();
        self
    }

    /// Whether the parts of both edges may be closer than `reach`.
    pub fn may_reach(&self, other: &NearEdge, reach: f64) -> bool {
        let r = self.radius + other.radius + reach;
        (self.centre - other.centre).norm_squared() <= r * r
    }
}

/// An axis perpendicular to an edge of A and an edge of B.
#[derive(Debug, Clone, Copy)]
pub struct EdgeAxis {
    /// Position in the two lists of near edges.
    pub edges: [usize; 2],
    /// Unit vector from A to B.
    pub normal: Vec3,
    pub separation: f64,
}

/// Fills `out` with the edges that have an end where `heights <= 0`; `load` makes one of its number.
pub fn near_edges(
    shape: &Polyhedron,
    heights: &[f64],
    out: &mut Vec<NearEdge>,
    load: impl Fn(usize) -> NearEdge,
) {
    out.clear();
    for (index, edge) in shape.edges.iter().enumerate() {
        let ends = edge.vertices.map(|v| heights[v as usize]);
        if ends[0] <= 0.0 || ends[1] <= 0.0 {
            out.push(load(index).below(ends));
        }
    }
}

/// Edge `index` of A.
pub fn edge_of_a(shape: &Polyhedron, index: usize) -> NearEdge {
    let edge = &shape.edges[index];
    let start = shape.vertices[edge.vertices[0] as usize];
    let end = shape.vertices[edge.vertices[1] as usize];
    let left = shape.face_normals[edge.faces[0] as usize];
    let right = shape.face_normals[edge.faces[1] as usize];
    NearEdge::new(index, start, end, left, right)
}

/// Edge `index` of B, in the frame of A.
pub fn edge_of_b(shape: &Polyhedron, b_in_a: &Cloud, rotation: &Mat3, index: usize) -> NearEdge {
    let edge = &shape.edges[index];
    let start = b_in_a.get(edge.vertices[0] as usize);
    let end = b_in_a.get(edge.vertices[1] as usize);
    let left = rotation * shape.face_normals[edge.faces[0] as usize];
    let right = rotation * shape.face_normals[edge.faces[1] as usize];
    NearEdge::new(index, start, end, left, right)
}

/// The axis of largest separation above `floor` over pairs of near edges whose parts in the slab come
/// within `reach` of each other: the points p and q above do.
///
/// A pair makes a facet of the Minkowski difference when the arcs of its faces' normals cross on
/// the sphere (those of B reversed). Edges that are parallel to 1e-10 are left out: their facet
/// is a strip of that relative width, so a neighbouring facet is as good. The winner's separation
/// is measured with both supports, so it is true for its direction whatever the rounding.
pub fn best_edge_axis(
    a: &Polyhedron,
    b_in_a: &Cloud,
    near_a: &[NearEdge],
    near_b: &[NearEdge],
    floor: f64,
    reach: f64,
) -> Option<EdgeAxis> {
    let mut best: Option<EdgeAxis> = None;
    let mut limit = floor;
    for (ia, ea) in near_a.iter().enumerate() {
        for (ib, eb) in near_b.iter().enumerate() {
            if !ea.may_reach(eb, reach) {
                continue;
            }
            if let Some(axis) = axis_of(a, b_in_a, ea, eb, [ia, ib], limit) {
                limit = axis.separation;
                best = Some(axis);
            }
        }
    }
    best
}

/// The axis perpendicular to two edges, if they make a facet of the Minkowski difference and
/// separate by more than `limit`.
#[inline]
pub fn axis_of(
    a: &Polyhedron,
    b_in_a: &Cloud,
    ea: &NearEdge,
    eb: &NearEdge,
    edges: [usize; 2],
    limit: f64,
) -> Option<EdgeAxis> {
    if !arcs_cross(ea, eb) {
        return None;
    }
    let normal = common_perpendicular(ea, eb)?;
    if normal.dot(&(eb.start - ea.start)) <= limit {
        return None;
    }
    let separation = b_in_a.lowest(&normal) - highest(a, &normal);
    (separation > limit).then_some(EdgeAxis { edges, normal, separation })
}

/// Whether the sine between two edges is below 1e-4.
pub fn nearly_parallel(a: &NearEdge, b: &NearEdge) -> bool {
    let c = a.along.cross(&b.along).norm_squared();
    c <= 1e-8 * a.along.norm_squared() * b.along.norm_squared()
}

/// Whether the arc of `a`'s normals crosses that of `b`'s reversed normals.
#[inline]
fn arcs_cross(a: &NearEdge, b: &NearEdge) -> bool {
    // Ends of the arc of b on different sides of the great circle of a, and the other way round.
    let left = -b.left.dot(&a.along);
    let right = -b.right.dot(&a.along);
    if left * right >= 0.0 {
        return false;
    }
    let a_left = a.left.dot(&b.along);
    let a_right = a.right.dot(&b.along);
    // Both on the same hemisphere: otherwise one arc crosses the other's antipode.
    a_left * a_right < 0.0 && right * a_left > 0.0
}

/// Unit vector perpendicular to both edges, out of A.
fn common_perpendicular(a: &NearEdge, b: &NearEdge) -> Option<Vec3> {
    let c = a.along.cross(&b.along);
    let along_squared = a.along.norm_squared();
    if c.norm_squared() <= 1e-20 * along_squared * b.along.norm_squared() {
        return None;
    }
    // For nearly parallel edges the product loses digits; what must stay exact is the right angle
    // to the edge, along which the facet is long.
    let c = c - a.along * (c.dot(&a.along) / along_squared);
    let n = c / c.norm();
    // A's origin is inside A, so its support plane is on the outer side of it.
    Some(if n.dot(&a.start) < 0.0 { -n } else { n })
}

/// Closest points of two segments, and where on them: 0 at the start, 1 at the end.
#[derive(Debug, Clone, Copy)]
pub struct ClosestPoints {
    /// Position in the two lists of near edges.
    pub edges: [usize; 2],
    pub parameter: [f64; 2],
    pub on_a: Vec3,
    pub on_b: Vec3,
    pub distance_squared: f64,
}

/// Closest points over all pairs of near edges, if any are within `reach` of each other; the first
/// pair among equals.
pub fn closest_points(
    near_a: &[NearEdge],
    near_b: &[NearEdge],
    reach: f64,
) -> Option<ClosestPoints> {
    let mut best: Option<ClosestPoints> = None;
    let mut reach = reach;
    for (ia, a) in near_a.iter().enumerate() {
        for (ib, b) in near_b.iter().enumerate() {
            if !a.may_reach(b, reach) {
                continue;
            }
            let found = closest_on_segments(a, b);
            if best.is_none_or(|c| found.distance_squared < c.distance_squared) {
                // A little more than the distance: equal ones stay in, whatever rounding does.
                reach = reach.min(found.distance_squared.sqrt() * (1.0 + 1e-6));
                best = Some(ClosestPoints { edges: [ia, ib], ..found });
            }
        }
    }
    best
}

/// Closest points of two segments, by clamping the solution for lines.
///
/// Source: Ericson, *Real-time collision detection*, 2005, section 5.1.9.
pub fn closest_on_segments(a: &NearEdge, b: &NearEdge) -> ClosestPoints {
    let offset = a.start - b.start;
    let (aa, bb) = (a.along.norm_squared(), b.along.norm_squared());
    let ab = a.along.dot(&b.along);
    let (ao, bo) = (a.along.dot(&offset), b.along.dot(&offset));
    let determinant = aa * bb - ab * ab;
    // Parallel: any point will do, the clamping of the other one finds its partner.
    let mut s = if determinant > 1e-20 * aa * bb {
        ((ab * bo - ao * bb) / determinant).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let mut t = (ab * s + bo) / bb;
    if t < 0.0 {
        t = 0.0;
        s = (-ao / aa).clamp(0.0, 1.0);
    } else if t > 1.0 {
        t = 1.0;
        s = ((ab - ao) / aa).clamp(0.0, 1.0);
    }
    let on_a = a.start + a.along * s;
    let on_b = b.start + b.along * t;
    let distance_squared = (on_b - on_a).norm_squared();
    ClosestPoints { edges: [0, 0], parameter: [s, t], on_a, on_b, distance_squared }
}
