//! Facing surfaces of two bodies in a slab along an axis: vertices and edges that may meet.
//!
//! Contract: with a motion bound, all features that may meet after a relative motion by `displacement` at the
//! [middle](FacingFeatures::middle) and a rotation by `rotation`, with the axis rotated by `rotation` in A, provided that
//! their feet were in the slab. Parts in the slab that do not overlap, seen along the axis, make no corner.

use super::edge_cache::TransformedVertices;
use super::frame::{AxisFrame, ContactAxis, DecidingFaces, MIN_SLOPE, MotionBound, ProjectedEdge};
use super::pair::{BodyPair, larger, smaller};
use crate::geometry::Polyhedron;
use crate::math::Vec3;

/// Features that may meet, and buffers of their search.
#[derive(Debug, Default)]
pub struct FacingFeatures {
    surfaces: [FacingSurface; 2],
    /// Pairs of edges of A and B.
    pub pairs: Vec<[usize; 2]>,
    /// Vertices of A and of B.
    pub vertices: [Vec<VertexOverFace>; 2],
    /// True if the rotation decides whether some listed feature faces the other body.
    pub may_turn_away: bool,
    /// Centre of the facing region, in the frame of A, m.
    pub middle: Vec3,
    /// Maximum distance of listed features from the middle, m.
    pub lever: f64,
    /// Transformed vertices of the listed edges of A and of B.
    pub edge_caches: [TransformedVertices; 2],
}

impl FacingFeatures {
    /// Lists the features that may meet.
    pub fn list(
        &mut self,
        pair: &BodyPair,
        axis: &ContactAxis,
        slab: f64,
        motion_bound: MotionBound,
    ) {
        let [frame_a, frame_b] = axis.frames(pair);
        let Self { surfaces: [a, b], pairs, vertices: [on_a, on_b], may_turn_away, .. } = self;
        a.gather(pair.a, &frame_a, slab, 2.0 * motion_bound.rotation);
        b.gather(pair.b, &frame_b, slab, 2.0 * motion_bound.rotation);
        // Features that may meet are near both bodies, so they are not far from the middle between them.
        let feet = axis.slab.max(axis.alert);
        let max_motion =
            motion_bound.displacement + motion_bound.rotation * 3.0 * (pair.size + slab + feet);
        let near = a.area.common(&b.area.widened(max_motion)).widened(max_motion);
        let [x, y] = near.centre();
        let [t, s, n] = &frame_a.axes;
        self.middle = t * x + s * y + n * (b.limit - 0.5 * slab);
        // A foot moves by the rotation times its distance from the middle; seen along the rotated axis,
        // the other foot is displaced by the rotation times their distance.
        let lever = 0.5 * near.diagonal() + slab + feet;
        self.lever = lever;
        let motion_bound = MotionBound {
            displacement: motion_bound.displacement + motion_bound.rotation * lever,
            ..motion_bound
        };
        let common = a.area.common(&b.area.widened(motion_bound.displacement));
        let common = common.widened(motion_bound.displacement);
        *may_turn_away = a.trim(&common) | b.trim(&common);
        let (slopes_a, slopes_b) = (a.slopes_of(pair.a), b.slopes_of(pair.b));
        on_a.clear();
        on_a.extend(a.over(|v| pair.point_in_b(&pair.a.vertices[v]), slopes_b, axis, motion_bound));
        on_b.clear();
        on_b.extend(b.over(|v| pair.corner_of_b(v), slopes_a, axis, motion_bound));
        pairs.clear();
        for ea in &a.edges {
            let area = ea.area.widened(motion_bound.displacement);
            for eb in &b.edges {
                if area.meets(&eb.area) && ea.is_near_edge(eb, motion_bound.displacement) {
                    pairs.push([ea.index, eb.index]);
                }
            }
        }
    }
}

/// Vertex that may lie over the other body.
#[derive(Debug, Clone, Copy)]
pub struct VertexOverFace {
    pub vertex: usize,
    /// Faces of the other body that decide whether it does.
    pub below: DecidingFaces,
}

/// Faces of a body, their slopes along the axis into the body, and the inverse slopes.
#[derive(Clone, Copy)]
struct FaceSlopes<'a> {
    shape: &'a Polyhedron,
    slopes: &'a [f64],
    inverse: &'a [f64],
}

impl FaceSlopes<'_> {
    /// Iterates over the depth of `x` below each face's plane, the slope and the inverse slope.
    #[inline]
    fn depths(self, x: &Vec3) -> impl Iterator<Item = (f64, f64, f64)> {
        let Self { shape, slopes, inverse } = self;
        let planes = shape.face_normals.iter().zip(&shape.face_offsets);
        let depths = planes.map(|(n, d)| d - (n.x * x.x + n.y * x.y + n.z * x.z));
        depths.zip(slopes).zip(inverse).map(|((depth, slope), inverse)| (depth, *slope, *inverse))
    }
}

/// Returns the faces that decide about `x`, or `None` if the line along the axis passes beside the body.
///
/// The line may move by up to `motion_bound` where it meets the body at a gap up to `alert`. All planes moved out by the
/// slack bound a piece of the line. A point deeper than the slack below a plane on all of this piece stays below it.
fn deciding_faces(
    slopes_of: FaceSlopes,
    x: &Vec3,
    alert: f64,
    motion_bound: f64,
) -> Option<DecidingFaces> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, alert);
    for (depth, slope, inverse) in slopes_of.depths(x) {
        let depth = depth + motion_bound;
        if slope < -MIN_SLOPE {
            enter = larger(depth * inverse, enter);
        } else if slope > MIN_SLOPE {
            leave = smaller(depth * inverse, leave);
        } else if depth < 0.0 {
            return None;
        }
    }
    if enter > leave {
        return None;
    }
    let mut below = DecidingFaces::default();
    for (f, (depth, slope, _)) in slopes_of.depths(x).enumerate() {
        let lowest = depth - slope * if slope < 0.0 { enter } else { leave };
        if lowest <= motion_bound {
            below.push(f);
        }
    }
    Some(below)
}

/// Rectangle across the axis.
#[derive(Debug, Clone, Copy)]
struct Rectangle {
    low: [f64; 2],
    high: [f64; 2],
}

impl Default for Rectangle {
    /// Returns the empty rectangle.
    fn default() -> Self {
        Self { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] }
    }
}

impl Rectangle {
    fn around(p: &[f64; 3], q: &[f64; 3]) -> Self {
        Self {
            low: [smaller(p[0], q[0]), smaller(p[1], q[1])],
            high: [larger(p[0], q[0]), larger(p[1], q[1])],
        }
    }

    fn with(&self, other: &Rectangle) -> Self {
        Self {
            low: [smaller(self.low[0], other.low[0]), smaller(self.low[1], other.low[1])],
            high: [larger(self.high[0], other.high[0]), larger(self.high[1], other.high[1])],
        }
    }

    fn common(&self, other: &Rectangle) -> Self {
        Self {
            low: [larger(self.low[0], other.low[0]), larger(self.low[1], other.low[1])],
            high: [smaller(self.high[0], other.high[0]), smaller(self.high[1], other.high[1])],
        }
    }

    fn widened(&self, margin: f64) -> Self {
        let ([a, b], [c, d]) = (self.low, self.high);
        Self { low: [a - margin, b - margin], high: [c + margin, d + margin] }
    }

    fn centre(&self) -> [f64; 2] {
        [0.5 * (self.low[0] + self.high[0]), 0.5 * (self.low[1] + self.high[1])]
    }

    fn diagonal(&self) -> f64 {
        let [wide, long] = [0, 1].map(|k| self.high[k] - self.low[k]);
        (wide * wide + long * long).sqrt()
    }

    fn meets(&self, other: &Rectangle) -> bool {
        (self.low[0] <= other.high[0])
            & (other.low[0] <= self.high[0])
            & (self.low[1] <= other.high[1])
            & (other.low[1] <= self.high[1])
    }

    fn holds(&self, p: &[f64; 3]) -> bool {
        self.meets(&Rectangle::around(p, p))
    }
}

/// Edge of the facing surface, cut to the slab.
#[derive(Debug, Clone, Copy)]
struct SlabEdge {
    index: usize,
    vertices: [u16; 2],
    from: [f64; 3],
    to: [f64; 3],
    area: Rectangle,
    may_turn_away: bool,
}

impl SlabEdge {
    /// True if the parts come within `reach` (m) of each other, seen along the axis.
    fn is_near_edge(&self, other: &SlabEdge, reach: f64) -> bool {
        let (a, b, c, d) = (&self.from, &self.to, &other.from, &other.to);
        let side = |p: &[f64; 3], q: &[f64; 3], r: &[f64; 3]| {
            (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
        };
        (side(a, b, c) * side(a, b, d) <= 0.0 && side(c, d, a) * side(c, d, b) <= 0.0)
            || near(a, b, c, reach)
            || near(a, b, d, reach)
            || near(c, d, a, reach)
            || near(c, d, b, reach)
    }
}

/// True if `x` is within `reach` (m) of the segment from `p` to `q`, seen along the axis.
fn near(p: &[f64; 3], q: &[f64; 3], x: &[f64; 3], reach: f64) -> bool {
    let along = [q[0] - p[0], q[1] - p[1]];
    let to = [x[0] - p[0], x[1] - p[1]];
    let length_squared = along[0] * along[0] + along[1] * along[1];
    let t = ((to[0] * along[0] + to[1] * along[1]) / length_squared.max(f64::MIN_POSITIVE))
        .clamp(0.0, 1.0);
    let off = [to[0] - t * along[0], to[1] - t * along[1]];
    off[0] * off[0] + off[1] * off[1] <= reach * reach
}

/// Facing surface of one body in the slab.
#[derive(Debug, Default)]
struct FacingSurface {
    /// Vertices in the coordinates of the axis.
    places: Vec<[f64; 3]>,
    /// Slopes of the faces along the axis into the body, and the inverse slopes.
    slopes: Vec<f64>,
    inverse: Vec<f64>,
    edges: Vec<SlabEdge>,
    /// Bounding rectangle of the edges' parts in the slab.
    area: Rectangle,
    /// True for vertices on a listed edge.
    seen: Vec<bool>,
    vertices: Vec<usize>,
    /// Largest coordinate along the axis into the body that is in the slab, m.
    limit: f64,
    into: f64,
}

impl FacingSurface {
    /// Finds the edges in the slab that face the other body, or may once the axis has turned by `turn`.
    fn gather(&mut self, shape: &Polyhedron, frame: &AxisFrame, slab: f64, turn: f64) {
        self.into = frame.into;
        self.places.clear();
        self.places.extend(shape.vertices.iter().map(|v| frame.place(v)));
        let lowest = self.places.iter().fold(f64::INFINITY, |l, p| smaller(frame.into * p[2], l));
        self.limit = lowest + slab;
        let into = frame.axes[2] * frame.into;
        self.slopes.clear();
        self.slopes.extend(shape.face_normals.iter().map(|n| n.dot(&into)));
        self.inverse.clear();
        self.inverse.extend(self.slopes.iter().map(|slope| 1.0 / slope));
        self.edges.clear();
        self.area = Rectangle::default();
        for (index, edge) in shape.edges.iter().enumerate() {
            let [start, end] = edge.vertices;
            let (start, end) = (&self.places[start as usize], &self.places[end as usize]);
            let h0 = frame.into * start[2] - self.limit;
            let h1 = frame.into * end[2] - self.limit;
            if h0 > 0.0 && h1 > 0.0 {
                continue;
            }
            let [left, right] = edge.faces;
            let slope = smaller(self.slopes[left as usize], self.slopes[right as usize]);
            if slope >= -MIN_SLOPE + turn {
                continue;
            }
            let segment = ProjectedEdge::between(*start, *end);
            let from = if h0 <= 0.0 { *start } else { segment.at(h0 / (h0 - h1)) };
            let to = if h1 <= 0.0 { *end } else { segment.at(h0 / (h0 - h1)) };
            let area = Rectangle::around(&from, &to);
            self.area = self.area.with(&area);
            let (vertices, may_turn_away) = (edge.vertices, slope >= -MIN_SLOPE - turn);
            self.edges.push(SlabEdge { index, vertices, from, to, area, may_turn_away });
        }
    }

    /// Drops edges outside `area` and lists the vertices in it. Returns true if an edge may turn away.
    fn trim(&mut self, area: &Rectangle) -> bool {
        let Self { places, edges, vertices, seen, limit, into, .. } = self;
        edges.retain(|e| e.area.meets(area));
        seen.clear();
        seen.resize(places.len(), false);
        edges.iter().flat_map(|e| e.vertices).for_each(|v| seen[v as usize] = true);
        let inside = |place: &[f64; 3]| *into * place[2] <= *limit && area.holds(place);
        vertices.clear();
        vertices.extend((0..places.len()).filter(|v| seen[*v] && inside(&places[*v])));
        edges.iter().any(|e| e.may_turn_away)
    }

    /// Returns the faces of the body with their slopes.
    fn slopes_of<'a>(&'a self, shape: &'a Polyhedron) -> FaceSlopes<'a> {
        FaceSlopes { shape, slopes: &self.slopes, inverse: &self.inverse }
    }

    /// Iterates over the listed vertices that may lie over the other body.
    fn over(
        &self,
        point: impl Fn(usize) -> Vec3,
        other: FaceSlopes,
        axis: &ContactAxis,
        motion_bound: MotionBound,
    ) -> impl Iterator<Item = VertexOverFace> {
        let (alert, path) = (axis.alert + motion_bound.displacement, motion_bound.displacement);
        self.vertices.iter().filter_map(move |v| {
            let below = deciding_faces(other, &point(*v), alert, path)?;
            Some(VertexOverFace { vertex: *v, below })
        })
    }
}
