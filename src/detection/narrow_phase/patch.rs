//! Where two bodies are near each other along an axis: all corners of the gap between them.
//!
//! Seen along the axis, the gap between the facing surfaces of two convex bodies is a convex
//! function, linear over pieces whose corners are vertices of A, vertices of B, and crossings of an
//! edge of A with an edge of B. Corners with a gap up to the alert distance are all that can touch
//! next. A body that rolls over a vertex or rocks over an edge is held by the neighbouring corner
//! before it gets there; the closest features alone would let it in.
//!
//! A corner with gap g <= alert has its feet on A and B at most `alert - s` off the support planes,
//! s being the separation along the axis. So the edges with an end in that slab decide, and of
//! them the parts in the slab: where they do not overlap, seen along the axis, there is no corner.

use super::cloud::Cloud;
use super::feature;
use super::reduce::Candidate;
use crate::geometry::Polyhedron;
use crate::math::{Vec3, frame};

/// Faces steeper than this along the axis count as its sides.
const STEEP: f64 = 1e-9;

/// Both bodies, each also in the frame of the other.
pub struct Bodies<'a> {
    pub a: &'a Polyhedron,
    pub b: &'a Polyhedron,
    pub a_in_b: &'a Cloud,
    pub b_in_a: &'a Cloud,
}

/// The axis and the bounds of the search.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    /// From A to B, in the frame of A.
    pub normal: Vec3,
    /// The same in the frame of B.
    pub in_b: Vec3,
    /// Largest gap of interest, m.
    pub alert: f64,
    /// How far off the support planes the feet of a corner may be, m.
    pub slab: f64,
    /// How far beside a face a vertex may be and still count as over it, m.
    pub tolerance: f64,
}

/// Buffers of the search.
#[derive(Debug, Default)]
pub struct Sides {
    a: Side,
    b: Side,
}

impl Axis {
    /// Fills `out` with the corners of gaps up to the alert distance, in the frame of A.
    pub fn corners(&self, bodies: &Bodies, sides: &mut Sides, out: &mut Vec<Candidate>) {
        out.clear();
        let Bodies { a, b, a_in_b, b_in_a } = *bodies;
        let (t, s) = frame::tangents(&self.normal);
        let place = |x: &Vec3| [t.dot(x), s.dot(x), self.normal.dot(x)];
        let Sides { a: side_a, b: side_b } = sides;
        a_in_b.heights(&-self.in_b, self.slab, &mut side_a.heights);
        side_a.gather(a, &self.normal, |v| place(&a.vertices[v]));
        b_in_a.heights(&self.normal, self.slab, &mut side_b.heights);
        side_b.gather(b, &-self.in_b, |v| place(&b_in_a.get(v)));
        let common = side_a.area.common(&side_b.area).widened(self.tolerance);
        side_a.trim(a, &common);
        side_b.trim(b, &common);
        for &v in &side_a.vertices {
            let gap = distance_along(b, &a_in_b.get(v), &self.in_b, self.tolerance);
            self.vertex(feature::vertex(v), &a.vertices[v], gap, 1.0, out);
        }
        for &v in &side_b.vertices {
            let point = b_in_a.get(v);
            let gap = distance_along(a, &point, &-self.normal, self.tolerance);
            self.vertex(feature::vertex_of_b(v), &point, gap, -1.0, out);
        }
        self.crossings(side_a, side_b, &[t, s, self.normal], out);
    }

    /// Appends the vertex at `point` if the other body is near; `side` is the axis's sign towards it.
    fn vertex(
        &self,
        feature: u64,
        point: &Vec3,
        gap: Option<f64>,
        side: f64,
        out: &mut Vec<Candidate>,
    ) {
        if let Some(gap) = gap.filter(|g| *g <= self.alert) {
            out.push(Candidate { point: point + self.normal * (0.5 * side * gap), gap, feature });
        }
    }

    /// Appends the crossings of edges of both sides.
    fn crossings(&self, a: &Side, b: &Side, frame: &[Vec3; 3], out: &mut Vec<Candidate>) {
        for ea in &a.edges {
            for eb in b.edges.iter().filter(|eb| ea.area.meets(&eb.area)) {
                let Some([s, t]) = crossing(ea, eb) else { continue };
                let (x, y) = (ea.at(s), eb.at(t));
                let gap = y[2] - x[2];
                if gap <= self.alert {
                    let feature =
                        feature::edges((ea.index, ea.vertices, s), (eb.index, eb.vertices, t));
                    let height = x[2] + 0.5 * gap;
                    let point = frame[0] * x[0] + frame[1] * x[1] + frame[2] * height;
                    out.push(Candidate { point, gap, feature });
                }
            }
        }
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

/// An edge of the facing surface; coordinates are two across the axis and one along it.
#[derive(Debug, Clone, Copy)]
struct Edge {
    index: u32,
    vertices: [u16; 2],
    start: [f64; 3],
    along: [f64; 3],
    /// Around its part in the slab.
    area: Area,
}

impl Edge {
    fn at(&self, parameter: f64) -> [f64; 3] {
        [0, 1, 2].map(|k| self.start[k] + self.along[k] * parameter)
    }
}

/// The facing surface of one body in the slab.
#[derive(Debug, Default)]
struct Side {
    /// Of the body's vertices over the slab.
    heights: Vec<f64>,
    edges: Vec<Edge>,
    /// Around all edges' parts in the slab.
    area: Area,
    vertices: Vec<usize>,
    seen: Vec<bool>,
}

impl Side {
    /// Finds the edges in the slab that have a face towards the other body. An edge of the far side
    /// is never a corner: the body's own surface is between it and the other one.
    fn gather(&mut self, shape: &Polyhedron, towards: &Vec3, place: impl Fn(usize) -> [f64; 3]) {
        self.edges.clear();
        self.area = Area::default();
        for (index, edge) in shape.edges.iter().enumerate() {
            let [h0, h1] = edge.vertices.map(|v| self.heights[v as usize]);
            let near = h0 <= 0.0 || h1 <= 0.0;
            let faces = |f: &u16| shape.face_normals[*f as usize].dot(towards) > STEEP;
            if !near || !edge.faces.iter().any(faces) {
                continue;
            }
            let [start, end] = edge.vertices.map(|v| place(v as usize));
            let along = [0, 1, 2].map(|k| end[k] - start[k]);
            let mut edge = Edge {
                index: index as u32,
                vertices: edge.vertices,
                start,
                along,
                area: self.area,
            };
            let from = if h0 <= 0.0 { start } else { edge.at(h0 / (h0 - h1)) };
            let to = if h1 <= 0.0 { end } else { edge.at(h0 / (h0 - h1)) };
            edge.area = Area::around(&from, &to);
            self.area = self.area.with(&edge.area);
            self.edges.push(edge);
        }
    }

    /// Drops edges beside `area`, and lists the vertices in it.
    fn trim(&mut self, shape: &Polyhedron, area: &Area) {
        let Self { heights, edges, vertices, seen, .. } = self;
        edges.retain(|e| e.area.meets(area));
        vertices.clear();
        seen.clear();
        seen.resize(shape.vertices.len(), false);
        for e in edges.iter() {
            let end = [0, 1, 2].map(|k| e.start[k] + e.along[k]);
            for (v, p) in e.vertices.iter().zip([e.start, end]) {
                let v = *v as usize;
                if !seen[v] && heights[v] <= 0.0 && area.holds(&p) {
                    seen[v] = true;
                    vertices.push(v);
                }
            }
        }
    }
}

/// Where two edges cross, seen along the axis: positions on both, strictly between their ends.
fn crossing(a: &Edge, b: &Edge) -> Option<[f64; 2]> {
    let beside = |d: &[f64; 3], x: [f64; 2]| d[0] * x[1] - d[1] * x[0];
    let between = [b.start[0] - a.start[0], b.start[1] - a.start[1]];
    let far = [between[0] + b.along[0], between[1] + b.along[1]];
    let (p, q) = (beside(&a.along, between), beside(&a.along, far));
    if p * q >= 0.0 {
        return None;
    }
    let t = p / (p - q);
    let over = [between[0] + b.along[0] * t, between[1] + b.along[1] * t];
    let length_squared = a.along[0] * a.along[0] + a.along[1] * a.along[1];
    let s = (a.along[0] * over[0] + a.along[1] * over[1]) / length_squared;
    (s > 0.0 && s < 1.0).then_some([s, t])
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
