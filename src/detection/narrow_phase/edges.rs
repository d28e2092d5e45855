//! Axes perpendicular to an edge of each body, and closest points of edges.
//!
//! Relevant edges: let `n0` (A to B) be an axis of separation `s0 = min_B n0·x - max_A n0·x`.
//!
//! * Overlapping bodies, least depth δ along `n`: the Minkowski difference contains the origin, and the foot of the
//!   origin on its nearest facet lies in that facet. So there are p on the edge of A and q on the edge of B with p -
//!   q = δ n, and δ <= -s0. As q is in B, n0·q >= max_A + s0, hence n0·p >= max_A + s0 - δ >= max_A - 2 |s0|: the
//!   edge of A has an end at most 2 |s0| below A's support plane along n0. The same applies to B.
//! * Separated bodies, closest points p and q at a distance D <= reach: n0·p >= n0·q - D >= max_A + s0 - D, so the
//!   edges (or the edges of the vertices) that contain p and q have an end at most D - s0 off the support planes.
//!
//! Hence all edges with an end in a slab of `max(2 |s0|, reach - s0)` decide, usually a handful.

use super::pair::{BodyPair, smaller};
use crate::math::Vec3;

/// Edge in the frame of A, with the outward normals of its two faces.
#[derive(Debug, Clone, Copy)]
pub struct NearEdge {
    pub index: usize,
    pub start: Vec3,
    pub along: Vec3,
    /// Outward normal of the first face; `along` is parallel to `left × right`.
    left: Vec3,
    right: Vec3,
    /// Centre of a sphere around the part of the edge in the slab.
    centre: Vec3,
    radius: f64,
    /// Length of `along`, m.
    length: f64,
}

impl NearEdge {
    /// Returns the edge with a sphere around its part at heights up to 0; `h0`, `h1` are the heights of its ends.
    pub fn below(edge: EdgeSegment, normals: [Vec3; 2], [h0, h1]: [f64; 2]) -> Self {
        let EdgeSegment { index, start, along } = edge;
        let [left, right] = normals;
        let from = if h0 <= 0.0 { 0.0 } else { h0 / (h0 - h1) };
        let to = if h1 <= 0.0 { 1.0 } else { h0 / (h0 - h1) };
        let centre = start + along * (0.5 * (from + to));
        let length = along.norm();
        let radius = 0.5 * (to - from) * length;
        Self { index, start, along, left, right, centre, radius, length }
    }

    /// Returns the edge without its faces.
    pub fn segment(&self) -> EdgeSegment {
        EdgeSegment { index: self.index, start: self.start, along: self.along }
    }

    /// True if the parts of both edges may be closer than `reach` (m).
    #[inline]
    pub fn may_reach(&self, other: &NearEdge, reach: f64) -> bool {
        let r = self.radius + other.radius + reach;
        (self.centre - other.centre).norm_squared() <= r * r
    }

    /// True if the arc of this edge's normals may cross that of `other`'s reversed normals.
    ///
    /// Holds for all relative rotations of the bodies by up to `turn` (rad).
    #[inline]
    pub fn may_cross(&self, other: &NearEdge, turn: f64) -> bool {
        let (motion_bound, other_slack) = (turn * self.length, turn * other.length);
        let left = -other.left.dot(&self.along);
        let right = -other.right.dot(&self.along);
        let own_left = self.left.dot(&other.along);
        let own_right = self.right.dot(&other.along);
        let one_way = (left < motion_bound)
            & (right > -motion_bound)
            & (own_left > -other_slack)
            & (own_right < other_slack);
        let other_way = (left > -motion_bound)
            & (right < motion_bound)
            & (own_left < other_slack)
            & (own_right > -other_slack);
        one_way | other_way
    }
}

/// Edge in the frame of A.
#[derive(Debug, Clone, Copy)]
pub struct EdgeSegment {
    pub index: usize,
    pub start: Vec3,
    pub along: Vec3,
}

/// Axis perpendicular to an edge of A and an edge of B.
#[derive(Debug, Clone, Copy)]
pub struct EdgeAxis {
    /// Numbers of the edges.
    pub edges: [usize; 2],
    /// Edges of A and of B.
    pub on: [EdgeSegment; 2],
    /// Unit vector from A to B.
    pub normal: Vec3,
    pub separation: f64,
}

impl EdgeAxis {
    /// Returns the closest points of the edges.
    pub fn closest(&self) -> ClosestPoints {
        let [a, b] = &self.on;
        closest_on_segments(a, b)
    }

    /// True if this axis has the larger separation, or the lower numbers among equals.
    fn beats(&self, other: &EdgeAxis) -> bool {
        self.separation > other.separation
            || (self.separation == other.separation && self.edges < other.edges)
    }
}

/// Returns the axis of largest separation above `floor` over the given pairs of edges, that of the lowest numbers
/// among equals.
///
/// `known` is one of the axes. Each pair comes with an upper bound for itself and all later pairs. The other
/// arguments are those of [`axis_of`].
///
/// A pair makes a facet of the Minkowski difference if the arcs of its faces' normals cross on the sphere (those of B
/// reversed). Edges that are parallel to 1e-10 are left out: their facet is a strip of that relative width, so a
/// neighbouring facet is as good. The winner's separation is measured with both supports, so it is true for its
/// direction whatever the rounding.
pub fn best_edge_axis(
    pair: &BodyPair,
    pairs: impl Iterator<Item = ([usize; 2], f64)>,
    known: Option<EdgeAxis>,
    floor: f64,
    crossing: bool,
    separation: impl Fn(&Vec3) -> f64,
) -> Option<EdgeAxis> {
    let mut best = known;
    for (edges, most) in pairs {
        let limit = best.map_or(floor, |b| b.separation);
        if most < limit {
            break;
        }
        if best.is_some_and(|b| b.edges == edges) {
            continue;
        }
        if let Some(axis) = axis_of(pair, edges, limit, crossing, &separation)
            && axis.separation > floor
            && best.is_none_or(|b| axis.beats(&b))
        {
            best = Some(axis);
        }
    }
    best
}

/// Returns the axis perpendicular to two edges, if they make a facet of the Minkowski difference.
///
/// May return `None` if the axis separates by less than `limit`. `crossing` says that the edges are known to make a
/// facet, `separation` returns the separation of the bodies along an axis.
pub fn axis_of(
    pair: &BodyPair,
    edges: [usize; 2],
    limit: f64,
    crossing: bool,
    separation: impl Fn(&Vec3) -> f64,
) -> Option<EdgeAxis> {
    let [a, b] = [edge_of_a(pair, edges[0]), edge_of_b(pair, edges[1])];
    if !crossing && !arcs_cross(pair, edges, [&a.along, &b.along], 0.0) {
        return None;
    }
    let normal = common_perpendicular(&a, &b)?;
    // A corner on either body bounds the separation from above, but for rounding.
    if normal.dot(&(b.start - a.start)) < limit - 1e-12 * pair.size {
        return None;
    }
    let separation = separation(&normal);
    Some(EdgeAxis { edges, on: [a, b], normal, separation })
}

/// Returns edge `index` of A.
pub fn edge_of_a(pair: &BodyPair, index: usize) -> EdgeSegment {
    let [start, end] = pair.a.edges[index].vertices;
    let (start, end) = (pair.a.vertices[start as usize], pair.a.vertices[end as usize]);
    EdgeSegment { index, start, along: end - start }
}

/// Returns edge `index` of B, in the frame of A.
pub fn edge_of_b(pair: &BodyPair, index: usize) -> EdgeSegment {
    let [start, end] = pair.b.edges[index].vertices;
    let (start, end) = (pair.corner_of_b(start as usize), pair.corner_of_b(end as usize));
    EdgeSegment { index, start, along: end - start }
}

/// True if the sine between two edges is below 1e-4.
pub fn are_nearly_parallel(a: &EdgeSegment, b: &EdgeSegment) -> bool {
    let c = a.along.cross(&b.along).norm_squared();
    c <= 1e-8 * a.along.norm_squared() * b.along.norm_squared()
}

/// True if the arc of the normals of A's edge crosses that of the reversed normals of B's edge.
///
/// Holds for all relative rotations of the bodies by up to `turn` (rad). `along` are the edges' directions in the
/// frame of A.
pub fn arcs_cross(pair: &BodyPair, edges: [usize; 2], [a, b]: [&Vec3; 2], turn: f64) -> bool {
    let along_b = |f: u16| pair.a.face_normals[usize::from(f)].dot(b);
    let [a_left, a_right] = pair.a.edges[edges[0]].faces.map(along_b);
    if a_left * a_right >= 0.0 {
        return false;
    }
    // Ends of the arc of b on different sides of the great circle of a, and the other way round.
    let in_b = pair.in_b(a);
    let along_a = |f: u16| -pair.b.face_normals[usize::from(f)].dot(&in_b);
    let [left, right] = pair.b.edges[edges[1]].faces.map(along_a);
    // Both on the same hemisphere: otherwise one arc crosses the other's antipode.
    let cross = left * right < 0.0 && right * a_left > 0.0;
    let clear = |x: f64, y: f64, l: &Vec3| smaller(x.abs(), y.abs()) > turn * l.norm();
    cross && (turn == 0.0 || (clear(a_left, a_right, b) && clear(left, right, a)))
}

/// Returns the unit vector perpendicular to both edges, out of A.
fn common_perpendicular(a: &EdgeSegment, b: &EdgeSegment) -> Option<Vec3> {
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

/// Closest points of two segments, and their parameters: 0 at the start, 1 at the end.
#[derive(Debug, Clone, Copy)]
pub struct ClosestPoints {
    /// Numbers of the edges.
    pub edges: [usize; 2],
    pub parameter: [f64; 2],
    pub on_a: Vec3,
    pub on_b: Vec3,
    pub distance_squared: f64,
}

/// Returns the closest points over all pairs of near edges, if any are within `reach` (m); the first pair among
/// equals.
pub fn closest_points(
    near_a: &[NearEdge],
    near_b: &[NearEdge],
    reach: f64,
) -> Option<ClosestPoints> {
    let mut best: Option<ClosestPoints> = None;
    let mut reach = reach;
    for a in near_a {
        for b in near_b {
            if !a.may_reach(b, reach) {
                continue;
            }
            let found = closest_on_segments(&a.segment(), &b.segment());
            if best.is_none_or(|c| found.distance_squared < c.distance_squared) {
                // A little more than the distance: equal ones stay in, whatever rounding does.
                reach = reach.min(found.distance_squared.sqrt() * (1.0 + 1e-6));
                best = Some(found);
            }
        }
    }
    best
}

/// Returns the closest points of two segments, by clamping the solution for lines.
///
/// Source: Ericson, *Real-time collision detection*, 2005, section 5.1.9.
pub fn closest_on_segments(a: &EdgeSegment, b: &EdgeSegment) -> ClosestPoints {
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
    ClosestPoints { edges: [a.index, b.index], parameter: [s, t], on_a, on_b, distance_squared }
}
