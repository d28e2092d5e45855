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

use super::cap::{Cap, Marks};
use super::feature;
use super::pair::Pair;
use super::reduce::Candidate;
use crate::geometry::Polyhedron;
use crate::math::{Vec3, frame};

/// Faces steeper than this along the axis count as its sides.
const STEEP: f64 = 1e-9;

/// The axis and the bounds of the search.
#[derive(Debug, Clone, Copy)]
pub struct Axis {
    /// From A to B, in the frame of A.
    pub normal: Vec3,
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
    marks: Marks,
}

impl Axis {
    /// Fills `out` with the corners of gaps up to the alert distance, in the frame of A.
    pub fn corners(
        &self,
        pair: &Pair,
        caps: &mut [Cap; 2],
        sides: &mut Sides,
        out: &mut Vec<Candidate>,
    ) {
        out.clear();
        let (t, s) = frame::tangents(&self.normal);
        let axes = [t, s, self.normal];
        let axes_in_b = axes.map(|n| pair.in_b(&n));
        let origin_of_b = axes.map(|n| n.dot(&pair.offset));
        let Sides { a, b, marks } = sides;
        let frame_a = Frame { axes, origin: [0.0; 3], into: -1.0 };
        let frame_b = Frame { axes: axes_in_b, origin: origin_of_b, into: 1.0 };
        a.gather(pair.a, &frame_a, self.slab, &mut caps[0], marks);
        b.gather(pair.b, &frame_b, self.slab, &mut caps[1], marks);
        let common = a.area.common(&b.area).widened(self.tolerance);
        a.trim(&common);
        b.trim(&common);
        for &v in &a.vertices {
            let point = &pair.a.vertices[v];
            let gap = b.distance_along(&pair.point_in_b(point), self.tolerance);
            self.vertex(feature::vertex(v), point, gap, 1.0, out);
        }
        for &v in &b.vertices {
            let point = pair.corner_of_b(v);
            let gap = a.distance_along(&point, self.tolerance);
            self.vertex(feature::vertex_of_b(v), &point, gap, -1.0, out);
        }
        self.crossings(a, b, &axes, out);
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

/// Coordinates across and along the axis, for points of one body's frame.
struct Frame {
    /// Two across the axis, and the axis.
    axes: [Vec3; 3],
    /// Coordinates of the body's origin.
    origin: [f64; 3],
    /// Sign of the axis into the body, from the other one.
    into: f64,
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
    /// Corners in the coordinates of the axis, by number; those not listed are of old.
    places: Vec<[f64; 3]>,
    /// Slopes of faces, by number.
    slopes: Vec<f64>,
    planes: Vec<Plane>,
    edges: Vec<Edge>,
    /// Around all edges' parts in the slab.
    area: Area,
    /// Thickness coordinate up to which a corner is in the slab.
    limit: f64,
    into: f64,
    vertices: Vec<usize>,
    seen: Vec<bool>,
}

/// A face's plane, and its slope along the axis into the body.
#[derive(Debug, Clone, Copy)]
struct Plane {
    normal: Vec3,
    offset: f64,
    slope: f64,
}

impl Side {
    /// Finds the edges in the slab that have a face towards the other body. An edge of the far side
    /// is never a corner: the body's own surface is between it and the other one.
    fn gather(
        &mut self,
        shape: &Polyhedron,
        frame: &Frame,
        slab: f64,
        cap: &mut Cap,
        marks: &mut Marks,
    ) {
        let outward = frame.axes[2] * -frame.into;
        if !cap.holds(shape, &outward, slab) {
            cap.make(shape, &outward, slab, marks);
        }
        self.places.resize(shape.vertices.len().max(self.places.len()), [0.0; 3]);
        self.slopes.resize(shape.face_count().max(self.slopes.len()), 0.0);
        self.seen.resize(self.places.len(), false);
        self.into = frame.into;
        if cap.holds(shape, &outward, slab) {
            self.place(shape, frame, slab, cap.corners.iter(), cap.faces.iter());
            self.facing(shape, cap.edges.iter());
        } else {
            self.place(shape, frame, slab, 0..shape.vertices.len(), 0..shape.face_count());
            self.facing(shape, 0..shape.edges.len());
        }
    }

    fn place(
        &mut self,
        shape: &Polyhedron,
        frame: &Frame,
        slab: f64,
        corners: impl Iterator<Item = usize>,
        faces: impl Iterator<Item = usize>,
    ) {
        let [t, s, n] = &frame.axes;
        let [x, y, z] = frame.origin;
        let mut lowest = f64::INFINITY;
        for v in corners {
            let corner = &shape.vertices[v];
            let place = [t.dot(corner) + x, s.dot(corner) + y, n.dot(corner) + z];
            lowest = lowest.min(frame.into * place[2]);
            self.places[v] = place;
            self.seen[v] = false;
        }
        self.limit = lowest + slab;
        let into = n * frame.into;
        self.planes.clear();
        for f in faces {
            let normal = shape.face_normals[f];
            let slope = normal.dot(&into);
            self.slopes[f] = slope;
            self.planes.push(Plane { normal, offset: shape.face_offsets[f], slope });
        }
    }

    /// Lists those of the given edges that face the other body, placed before.
    fn facing(&mut self, shape: &Polyhedron, edges: impl Iterator<Item = usize>) {
        self.edges.clear();
        self.area = Area::default();
        for index in edges {
            let edge = &shape.edges[index];
            let [start, end] = edge.vertices.map(|v| self.places[v as usize]);
            let [h0, h1] = [start, end].map(|p| self.into * p[2] - self.limit);
            let near = h0 <= 0.0 || h1 <= 0.0;
            if !near || !edge.faces.iter().any(|f| self.slopes[*f as usize] < -STEEP) {
                continue;
            }
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
    fn trim(&mut self, area: &Area) {
        let Self { places, edges, vertices, seen, limit, into, .. } = self;
        edges.retain(|e| e.area.meets(area));
        vertices.clear();
        for v in edges.iter().flat_map(|e| e.vertices) {
            let v = v as usize;
            let place = &places[v];
            if !seen[v] && *into * place[2] <= *limit && area.holds(place) {
                seen[v] = true;
                vertices.push(v);
            }
        }
    }

    /// Distance from `x` along the axis to where the line enters the body, negative behind `x`;
    /// `None` if the line passes by more than `tolerance` beside it, in the slab.
    fn distance_along(&self, x: &Vec3, tolerance: f64) -> Option<f64> {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for Plane { normal, offset, slope } in &self.planes {
            let depth = offset - (normal.x * x.x + normal.y * x.y + normal.z * x.z);
            if *slope < -STEEP {
                enter = enter.max(depth / slope);
            } else if *slope > STEEP {
                leave = leave.min((depth + tolerance) / slope);
            } else if depth < -tolerance {
                return None;
            }
        }
        (enter <= leave + tolerance).then_some(enter)
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
