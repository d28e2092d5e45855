//! The facing surfaces of two bodies in a slab along an axis: which corners and edges may meet.
//!
//! Contract: with a slack, all that may meet after the bodies have moved against each other by `path`
//! and the axis has turned by `turn` in either body, for a slab that is thinner by what turns
//! change heights. Where parts in the slab do not overlap, seen along the axis, there is no corner.
//! A point of the slab outside a body is outside one of the faces that reach into the slab.

use super::pair::Pair;
use super::patch::{Axis, STEEP};
use crate::geometry::Polyhedron;
use crate::math::Vec3;

/// How far bodies may move, m, and how much the axis may turn in either of them.
#[derive(Debug, Clone, Copy)]
pub struct Slack {
    pub path: f64,
    pub turn: f64,
}

/// Buffers of the search, and what may meet.
#[derive(Debug, Default)]
pub struct Sides {
    sides: [Side; 2],
    /// Pairs of edges of A and B.
    pub pairs: Vec<[usize; 2]>,
    /// Corners of A and of B.
    pub vertices: [Vec<usize>; 2],
    /// Whether it depends on the turn if something listed faces the other body.
    pub unsure: bool,
    pub planes: Vec<Plane>,
}

impl Sides {
    /// Lists what may meet.
    pub fn list(&mut self, pair: &Pair, axis: &Axis, slab: f64, slack: Slack) {
        let [frame_a, frame_b] = axis.frames(pair);
        let Self { sides: [a, b], pairs, vertices: [on_a, on_b], unsure, planes } = self;
        a.gather(pair.a, &frame_a, slab, slack.turn);
        b.gather(pair.b, &frame_b, slab, slack.turn);
        let common = a.area.common(&b.area.widened(slack.path));
        let common = common.widened(slack.path);
        *unsure = a.trim(&common) | b.trim(&common);
        frame_b.planes(pair.b, 0..pair.b.face_count(), planes);
        on_a.clear();
        on_a.extend(a.over(|v| pair.point_in_b(&pair.a.vertices[v]), planes, axis, slack));
        frame_a.planes(pair.a, 0..pair.a.face_count(), planes);
        on_b.clear();
        on_b.extend(b.over(|v| pair.corner_of_b(v), planes, axis, slack));
        pairs.clear();
        for ea in &a.edges {
            for eb in &b.edges {
                if ea.area.meets(&eb.area.widened(slack.path)) && ea.comes_near(eb, slack.path) {
                    pairs.push([ea.index, eb.index]);
                }
            }
        }
    }

    /// Faces of A (0) or B (1) that reach into the slab.
    pub fn faces(&self, side: usize) -> impl Iterator<Item = usize> {
        self.sides[side].reaches.iter().enumerate().filter(|(_, r)| **r).map(|(f, _)| f)
    }

    /// A point of A or of B where they are near, in the frame of A.
    pub fn middle(&self, pair: &Pair) -> Option<Vec3> {
        let of_a = self.sides[0].edges.first().map(|e| pair.a.edges[e.index].vertices);
        let ends = of_a?.map(|v| pair.a.vertices[v as usize]);
        let low = self.sides[0].edges.first()?.low;
        Some(ends[usize::from(low)])
    }
}

/// Coordinates across and along the axis, for points of one body's frame.
pub struct Frame {
    /// Two across the axis, and the axis.
    pub axes: [Vec3; 3],
    /// Coordinates of the body's origin.
    pub origin: [f64; 3],
    /// Sign of the axis into the body, from the other one.
    pub into: f64,
}

impl Frame {
    fn place(&self, x: &Vec3) -> [f64; 3] {
        [0, 1, 2].map(|k| self.axes[k].dot(x) + self.origin[k])
    }

    /// Edge `index` in these coordinates.
    pub fn segment(&self, shape: &Polyhedron, index: usize) -> Segment {
        let [start, end] =
            shape.edges[index].vertices.map(|v| self.place(&shape.vertices[v as usize]));
        Segment { start, along: [0, 1, 2].map(|k| end[k] - start[k]) }
    }

    /// Fills `out` with planes of the body.
    pub fn planes(
        &self,
        shape: &Polyhedron,
        faces: impl Iterator<Item = usize>,
        out: &mut Vec<Plane>,
    ) {
        let into = self.axes[2] * self.into;
        out.clear();
        out.extend(faces.map(|f| {
            let normal = shape.face_normals[f];
            Plane { normal, offset: shape.face_offsets[f], slope: normal.dot(&into) }
        }));
    }
}

/// A face's plane, and its slope along the axis into the body.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    pub normal: Vec3,
    pub offset: f64,
    pub slope: f64,
}

impl Plane {
    /// Of a point below the plane.
    pub fn depth(&self, x: &Vec3) -> f64 {
        let n = &self.normal;
        self.offset - (n.x * x.x + n.y * x.y + n.z * x.z)
    }
}

/// Whether the line from `x` along the axis may come within `slack` of the body at a gap up to
/// `alert`: all planes moved out by so much.
fn may_be_over(planes: &[Plane], x: &Vec3, alert: f64, slack: f64) -> bool {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    for plane in planes {
        let depth = plane.depth(x) + slack;
        if plane.slope < -STEEP {
            enter = enter.max(depth / plane.slope);
        } else if plane.slope > STEEP {
            leave = leave.min(depth / plane.slope);
        } else if depth < 0.0 {
            return false;
        }
    }
    enter <= leave && enter <= alert
}

/// An edge; coordinates are two across the axis and one along it.
#[derive(Debug, Clone, Copy)]
pub struct Segment {
    pub start: [f64; 3],
    pub along: [f64; 3],
}

impl Segment {
    pub fn at(&self, parameter: f64) -> [f64; 3] {
        [0, 1, 2].map(|k| self.start[k] + self.along[k] * parameter)
    }
}

/// A rectangle across the axis.
#[derive(Debug, Clone, Copy)]
struct Area {
    low: [f64; 2],
    high: [f64; 2],
}

impl Default for Area {
    /// Nothing.
    fn default() -> Self {
        Self { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] }
    }
}

impl Area {
    fn around(p: &[f64; 3], q: &[f64; 3]) -> Self {
        Self { low: [p[0].min(q[0]), p[1].min(q[1])], high: [p[0].max(q[0]), p[1].max(q[1])] }
    }

    fn with(&self, other: &Area) -> Self {
        Self {
            low: [0, 1].map(|k| self.low[k].min(other.low[k])),
            high: [0, 1].map(|k| self.high[k].max(other.high[k])),
        }
    }

    fn common(&self, other: &Area) -> Self {
        Self {
            low: [0, 1].map(|k| self.low[k].max(other.low[k])),
            high: [0, 1].map(|k| self.high[k].min(other.high[k])),
        }
    }

    fn widened(&self, margin: f64) -> Self {
        Self { low: self.low.map(|x| x - margin), high: self.high.map(|x| x + margin) }
    }

    fn meets(&self, other: &Area) -> bool {
        (self.low[0] <= other.high[0])
            & (other.low[0] <= self.high[0])
            & (self.low[1] <= other.high[1])
            & (other.low[1] <= self.high[1])
    }

    fn holds(&self, p: &[f64; 3]) -> bool {
        self.meets(&Area::around(p, p))
    }
}

/// An edge of the facing surface: its part in the slab.
#[derive(Debug, Clone, Copy)]
struct Edge {
    index: usize,
    vertices: [u16; 2],
    from: [f64; 3],
    to: [f64; 3],
    area: Area,
    /// Whether the end that is surely in the slab is the second one.
    low: bool,
    unsure: bool,
}

impl Edge {
    /// Whether the parts come within `reach` of each other, seen along the axis.
    fn comes_near(&self, other: &Edge, reach: f64) -> bool {
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

/// Whether `x` is within `reach` of the segment from `p` to `q`, seen along the axis.
fn near(p: &[f64; 3], q: &[f64; 3], x: &[f64; 3], reach: f64) -> bool {
    let along = [q[0] - p[0], q[1] - p[1]];
    let to = [x[0] - p[0], x[1] - p[1]];
    let length_squared = along[0] * along[0] + along[1] * along[1];
    let t = ((to[0] * along[0] + to[1] * along[1]) / length_squared.max(f64::MIN_POSITIVE))
        .clamp(0.0, 1.0);
    let off = [to[0] - t * along[0], to[1] - t * along[1]];
    off[0] * off[0] + off[1] * off[1] <= reach * reach
}

/// The facing surface of one body in the slab.
#[derive(Debug, Default)]
struct Side {
    /// Corners in the coordinates of the axis.
    places: Vec<[f64; 3]>,
    slopes: Vec<f64>,
    /// Whether a face reaches into the slab.
    reaches: Vec<bool>,
    edges: Vec<Edge>,
    /// Around all edges' parts in the slab.
    area: Area,
    /// Corners in the slab, beside no listed edge and listed already.
    seen: Vec<bool>,
    vertices: Vec<usize>,
    /// Up to where a coordinate along the axis into the body is in the slab.
    limit: f64,
    into: f64,
}

impl Side {
    /// Finds the edges in the slab that have a face towards the other body. An edge of the far side
    /// is never a corner: the body's own surface is between it and the other one.
    fn gather(&mut self, shape: &Polyhedron, frame: &Frame, slab: f64, turn: f64) {
        self.into = frame.into;
        self.places.clear();
        self.places.extend(shape.vertices.iter().map(|v| frame.place(v)));
        let lowest = self.places.iter().fold(f64::INFINITY, |l, p| l.min(frame.into * p[2]));
        self.limit = lowest + slab;
        let into = frame.axes[2] * frame.into;
        self.slopes.clear();
        self.slopes.extend(shape.face_normals.iter().map(|n| n.dot(&into)));
        self.reaches.clear();
        self.reaches.resize(shape.face_count(), false);
        self.edges.clear();
        self.area = Area::default();
        for (index, edge) in shape.edges.iter().enumerate() {
            let [start, end] = edge.vertices.map(|v| self.places[v as usize]);
            let [h0, h1] = [start, end].map(|p| frame.into * p[2] - self.limit);
            if h0 > 0.0 && h1 > 0.0 {
                continue;
            }
            edge.faces.iter().for_each(|f| self.reaches[*f as usize] = true);
            let [left, right] = edge.faces.map(|f| self.slopes[f as usize]);
            let slope = left.min(right);
            if slope >= -STEEP + turn {
                continue;
            }
            let segment = Segment { start, along: [0, 1, 2].map(|k| end[k] - start[k]) };
            let from = if h0 <= 0.0 { start } else { segment.at(h0 / (h0 - h1)) };
            let to = if h1 <= 0.0 { end } else { segment.at(h0 / (h0 - h1)) };
            let area = Area::around(&from, &to);
            self.area = self.area.with(&area);
            let (vertices, low, unsure) = (edge.vertices, h0 > 0.0, slope >= -STEEP - turn);
            self.edges.push(Edge { index, vertices, from, to, area, low, unsure });
        }
    }

    /// Drops edges beside `area`, and lists the vertices in it; whether any edge is unsure.
    fn trim(&mut self, area: &Area) -> bool {
        let Self { places, edges, vertices, seen, limit, into, .. } = self;
        edges.retain(|e| e.area.meets(area));
        vertices.clear();
        seen.clear();
        seen.resize(places.len(), false);
        for v in edges.iter().flat_map(|e| e.vertices) {
            let v = v as usize;
            let place = &places[v];
            if !seen[v] && *into * place[2] <= *limit && area.holds(place) {
                seen[v] = true;
                vertices.push(v);
            }
        }
        edges.iter().any(|e| e.unsure)
    }

    /// Those of the vertices that may be over the other body, its planes given.
    fn over(
        &self,
        point: impl Fn(usize) -> Vec3,
        planes: &[Plane],
        axis: &Axis,
        slack: Slack,
    ) -> impl Iterator<Item = usize> {
        let over =
            move |v: &usize| may_be_over(planes, &point(*v), axis.alert + slack.path, slack.path);
        self.vertices.iter().copied().filter(over)
    }
}
