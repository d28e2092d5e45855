//! Contact points of two convex polyhedra.
//!
//! Reads: two shapes and their poses. Writes: at most four points. Cost: under a microsecond per
//! touching pair of ballast grains, a tenth of it for a pair that was apart before.
//!
//! 1. An axis that separated the pair before rejects it, if it still does.
//! 2. Face normals of both bodies ([`faces`]), then axes perpendicular to two edges ([`edges`]):
//!    the axis of largest separation over all of them. For bodies that overlap this is
//!    the axis of least depth.
//! 3. Along a face's axis, the overlap of the two faces ([`clip`]), at most four points
//!    ([`reduce`]). Otherwise the closest points of two edges.
//! 4. Bodies apart whose closest points are at vertices have one contact along the line between them.
//!
//! Contract: the result depends on shapes and poses alone, not on [`PairMemory`]. Two bodies at a
//! distance of at most `alert` have a contact, others have none.

mod clip;
mod cloud;
mod edges;
mod faces;
mod feature;
mod half_space;
mod placing;
mod reduce;

use crate::geometry::Polyhedron;
use crate::math::{Mat3, Pose, Quat, Vec3};
use clip::ClipVertex;
use cloud::Cloud;
use edges::{ClosestPoints, EdgeAxis, NearEdge};
use faces::FaceAxis;
use placing::Span;
use reduce::Candidate;

pub use feature::on_part;
pub use half_space::touch_half_space;

/// Separations closer than this fraction of the bodies' radii count as equal: then faces of A are
/// preferred to those of B, and faces to edges.
const TIE: f64 = 2.5e-10;
/// How far, over the radii, a point may be out of a body and still count as inside.
const INSIDE: f64 = 1e-12;
/// What is added to the slab of near edges, over the radii: faces are flat to 1e-7 only.
const SLAB: f64 = 1e-6;

/// A convex body of the configuration.
#[derive(Debug, Clone, Copy)]
pub struct Solid<'a> {
    pub shape: &'a Polyhedron,
    pub pose: Pose,
}

/// What one step's search tells the next one about a pair; it changes the cost, never the result.
#[derive(Debug, Clone, Copy, Default)]
pub struct PairMemory {
    /// An axis from A to B, in the frame of A, that separated the pair; zero if none.
    axis: [f32; 3],
    /// One above the best face of A and of B; zero if none.
    faces: [u16; 2],
}

/// A contact point in world coordinates; the normal points from B to A.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    pub feature: u64,
    pub point: Vec3,
    pub normal: Vec3,
    pub gap: f64,
}

/// Buffers of the search, and its result in `points`, sorted by feature.
#[derive(Debug, Default)]
pub struct Scratch {
    pub points: Vec<Point>,
    a_in_b: Cloud,
    b_in_a: Cloud,
    near_a: Vec<NearEdge>,
    near_b: Vec<NearEdge>,
    polygon: [Vec<ClipVertex>; 2],
    candidates: Vec<Candidate>,
}

/// Finds the contact points of A and B with gaps up to `alert` (m) and leaves them in
/// `scratch.points`.
pub fn touch(a: Solid, b: Solid, alert: f64, memory: &mut PairMemory, scratch: &mut Scratch) {
    scratch.points.clear();
    let offset = a.pose.orientation.inverse() * (b.pose.position - a.pose.position);
    let size = a.shape.radius + b.shape.radius;
    let reach = size * (1.0 + TIE) + alert;
    if offset.norm_squared() > reach * reach {
        return;
    }
    let turn = a.pose.orientation.inverse() * b.pose.orientation;
    let rotation = turn.to_rotation_matrix().into_inner();
    let pair = Pair { a, b, turn, rotation, offset, size, alert };
    if pair.still_apart(&memory.axis) {
        return;
    }
    pair.load(scratch);
    let apart = match pair.best_axis(memory, scratch) {
        Ok(axis) => pair.points_along(&axis, scratch).err(),
        Err(direction) => Some(direction),
    };
    memory.axis = apart.map_or([0.0; 3], |n| [n.x as f32, n.y as f32, n.z as f32]);
    scratch.points.sort_unstable_by_key(|p| p.feature);
}

/// Two bodies, seen from the frame of A.
struct Pair<'a> {
    a: Solid<'a>,
    b: Solid<'a>,
    /// From the frame of B to that of A; the same as a matrix.
    turn: Quat,
    rotation: Mat3,
    /// Origin of B.
    offset: Vec3,
    /// Sum of the radii: the length that tolerances refer to.
    size: f64,
    alert: f64,
}

/// The best face of either body.
#[derive(Debug, Clone, Copy)]
struct BestFace {
    of_b: bool,
    face: usize,
    /// From A to B, in the frame of A.
    normal: Vec3,
    separation: f64,
}

/// The axis of largest separation.
#[derive(Debug, Clone, Copy)]
struct BestAxis {
    face: BestFace,
    /// Set if two edges separate better than any face.
    edges: Option<EdgeAxis>,
}

/// `Err` holds a direction (A to B, frame of A) along which the bodies are more than `alert` apart.
type Found<T> = Result<T, Vec3>;

impl Pair<'_> {
    /// Whether an old axis still separates by more than the alert distance, beyond all rounding.
    fn still_apart(&self, axis: &[f32; 3]) -> bool {
        if *axis == [0.0; 3] {
            return false;
        }
        let n = Vec3::new(f64::from(axis[0]), f64::from(axis[1]), f64::from(axis[2]));
        let in_b = self.rotation.tr_mul(&n);
        let low = cloud::lowest(self.b.shape, &in_b) + n.dot(&self.offset);
        // The axis is of length 1 to the precision of f32 only.
        low - cloud::highest(self.a.shape, &n) > 1.000_001 * (self.alert + 1e-9 * self.size)
    }

    fn load(&self, scratch: &mut Scratch) {
        scratch.b_in_a.load(self.b.shape, &self.rotation, &self.offset);
        let back = self.rotation.transpose();
        scratch.a_in_b.load(self.a.shape, &back, &-(back * self.offset));
    }

    fn best_axis(&self, memory: &mut PairMemory, scratch: &mut Scratch) -> Found<BestAxis> {
        let face = self.best_face(memory, scratch)?;
        if face.separation > 0.0 {
            // The bodies are apart; if two edges are closest, `points_along` finds them.
            return Ok(BestAxis { face, edges: None });
        }
        let floor = face.separation + TIE * self.size;
        let certain = self.corner_inside(&face, scratch);
        let depth = -face.separation;
        let slab = depth + if certain { depth } else { depth.max(self.alert) };
        self.gather(&face.normal, slab, scratch);
        let mut edges = self.best_edges(floor, scratch);
        if !certain && !self.overlap_is_certain(&face, edges.as_ref(), scratch) {
            // No face separates and no common point is at hand: ask all edges.
            self.gather(&face.normal, f64::INFINITY, scratch);
            edges = self.best_edges(floor, scratch);
        }
        match edges {
            Some(e) if e.separation > self.alert => Err(e.normal),
            _ => Ok(BestAxis { face, edges }),
        }
    }

    fn best_face(&self, memory: &mut PairMemory, scratch: &Scratch) -> Found<BestFace> {
        let (a, b) = (self.a.shape, self.b.shape);
        let in_b = |n: &Vec3| self.rotation.tr_mul(n);
        let start_a = match usize::from(memory.faces[0]) {
            f if f > 0 && f <= a.face_count() => f - 1,
            _ => faces::most_aligned(a, &self.offset),
        };
        let on_a = faces::best_face(a, &scratch.b_in_a, start_a, f64::NEG_INFINITY, self.alert)
            .map_err(|f| a.face_normals[f])?;
        let normal_a = a.face_normals[on_a.face];
        let start_b = match usize::from(memory.faces[1]) {
            f if f > 0 && f <= b.face_count() => f - 1,
            _ => faces::most_aligned(b, &-in_b(&normal_a)),
        };
        let floor = on_a.separation + TIE * self.size;
        let on_b: FaceAxis = faces::best_face(b, &scratch.a_in_b, start_b, floor, self.alert)
            .map_err(|f| -(self.rotation * b.face_normals[f]))?;
        memory.faces = [on_a.face, on_b.face].map(|f| f as u16 + 1);
        Ok(if on_b.separation > floor {
            let normal = -(self.rotation * b.face_normals[on_b.face]);
            BestFace { of_b: true, face: on_b.face, normal, separation: on_b.separation }
        } else {
            let separation = on_a.separation;
            BestFace { of_b: false, face: on_a.face, normal: normal_a, separation }
        })
    }

    /// Whether the corner that is deepest under the best face is inside the face's body: then the
    /// bodies certainly overlap.
    fn corner_inside(&self, face: &BestFace, scratch: &Scratch) -> bool {
        let (shape, other) = if face.of_b {
            (self.b.shape, &scratch.a_in_b)
        } else {
            (self.a.shape, &scratch.b_in_a)
        };
        let n = &shape.face_normals[face.face];
        let deepest = other.get(other.first_at(n, other.lowest(n)));
        faces::contains(shape, &deepest, INSIDE * self.size)
    }

    /// Fills the lists of edges with an end at most `slab` off the support planes along `n`.
    fn gather(&self, n: &Vec3, slab: f64, scratch: &mut Scratch) {
        let (a, b) = (self.a.shape, self.b.shape);
        let slab = slab + SLAB * self.size;
        let from = cloud::highest(a, n) - slab;
        let to = scratch.b_in_a.lowest(n) + slab;
        edges::near_edges_of_a(a, n, from, &mut scratch.near_a);
        edges::near_edges_of_b(b, &scratch.b_in_a, &self.rotation, n, to, &mut scratch.near_b);
    }

    fn best_edges(&self, floor: f64, scratch: &Scratch) -> Option<EdgeAxis> {
        let (a, b) = (&scratch.near_a, &scratch.near_b);
        edges::best_edge_axis(self.a.shape, &scratch.b_in_a, a, b, floor)
    }

    /// Whether some point is in both bodies, or two edges separate them: either way the edges
    /// near the best face decide.
    fn overlap_is_certain(
        &self,
        face: &BestFace,
        edges: Option<&EdgeAxis>,
        scratch: &mut Scratch,
    ) -> bool {
        if let Some(e) = edges {
            if e.separation > 0.0 {
                return true;
            }
            let c = self.closest_on(e, scratch);
            return self.in_both((c.on_a + c.on_b) * 0.5);
        }
        self.clip_along(face, &face.normal, scratch);
        let deepest =
            scratch.candidates.iter().copied().reduce(|d, c| if c.gap < d.gap { c } else { d });
        deepest.is_some_and(|c| {
            let p = if face.of_b { self.rotation * c.point + self.offset } else { c.point };
            self.in_both(p)
        })
    }

    fn in_both(&self, p: Vec3) -> bool {
        let tolerance = INSIDE * self.size;
        faces::contains(self.a.shape, &p, tolerance)
            && faces::contains(self.b.shape, &self.rotation.tr_mul(&(p - self.offset)), tolerance)
    }

    fn closest_on(&self, e: &EdgeAxis, scratch: &Scratch) -> ClosestPoints {
        let [ea, eb] = e.edges;
        let found = edges::closest_on_segments(&scratch.near_a[ea], &scratch.near_b[eb]);
        ClosestPoints { edges: e.edges, ..found }
    }

    /// Contact points for the best axis; `Err` if the bodies are further apart than the axis shows.
    fn points_along(&self, axis: &BestAxis, scratch: &mut Scratch) -> Found<()> {
        let tie = TIE * self.size;
        let (normal, separation) = match &axis.edges {
            Some(e) => (e.normal, e.separation),
            None => (axis.face.normal, axis.face.separation),
        };
        let mut edge_points = axis.edges.as_ref().map(|e| self.closest_on(e, scratch));
        if axis.edges.is_none() {
            self.clip_along(&axis.face, &normal, scratch);
            if lowest_gap(&scratch.candidates) <= separation + tie {
                self.push_manifold(&axis.face, &normal, scratch);
                return Ok(());
            }
        } else if let Some(c) = edge_points
            && c.distance_squared.sqrt() <= separation.abs() + tie
        {
            self.push_closest(&c, &normal, separation, scratch);
            return Ok(());
        }
        if separation > 0.0 {
            // No pair of surface points is as close as that: the closest points are elsewhere.
            self.gather(&normal, self.alert - separation, scratch);
            edge_points = edges::closest_points(&scratch.near_a, &scratch.near_b);
            if let Some(c) = edge_points {
                let distance = c.distance_squared.sqrt();
                if distance > self.alert {
                    return Err((c.on_b - c.on_a) / distance);
                }
                if distance > separation + tie {
                    self.push_closest(&c, &((c.on_b - c.on_a) / distance), distance, scratch);
                    return Ok(());
                }
            }
        }
        // Rounding alone leads here: slivers whose clipped face is empty.
        match edge_points {
            Some(c) => self.push_closest(&c, &normal, separation, scratch),
            None if !scratch.candidates.is_empty() => {
                self.push_manifold(&axis.face, &normal, scratch)
            }
            None => self.push_support(&normal, separation, scratch),
        }
        Ok(())
    }

    /// Leaves in `scratch.candidates` the overlap of the best face and the other body's face
    /// against it, in the frame of the face's body.
    fn clip_along(&self, face: &BestFace, normal: &Vec3, scratch: &mut Scratch) {
        let (reference, other, cloud, axis) = if face.of_b {
            let axis = -self.rotation.tr_mul(normal);
            (self.b.shape, self.a.shape, &scratch.a_in_b, axis)
        } else {
            (self.a.shape, self.b.shape, &scratch.b_in_a, *normal)
        };
        let corner = cloud.first_at(&axis, cloud.lowest(&axis));
        // The same axis in the other body's own frame, where its face normals are.
        let against = if face.of_b { -*normal } else { self.rotation.tr_mul(normal) };
        let corner = &other.vertices[corner];
        let incident = faces::incident_face(other, corner, &against, SLAB * other.radius);
        let incident = (other, cloud, incident);
        let [polygon, spare] = &mut scratch.polygon;
        let tolerance = TIE * self.size;
        clip::clip_faces(reference, face.face, &axis, incident, tolerance, [polygon, spare]);
        let offset = reference.face_offsets[face.face];
        scratch.candidates.clear();
        for v in polygon.iter() {
            let gap = axis.dot(&v.point) - offset;
            if gap <= self.alert {
                scratch.candidates.push(Candidate {
                    point: v.point - axis * (0.5 * gap),
                    gap,
                    feature: feature::face(face.of_b, face.face, v.corner),
                });
            }
        }
    }

    /// Reports `scratch.candidates`, four at most.
    fn push_manifold(&self, face: &BestFace, normal: &Vec3, scratch: &mut Scratch) {
        if face.of_b {
            reduce::keep_four(&mut scratch.candidates, &self.rotation.tr_mul(normal));
            for c in &mut scratch.candidates {
                c.point = self.rotation * c.point + self.offset;
            }
        } else {
            reduce::keep_four(&mut scratch.candidates, normal);
        }
        self.report(normal, scratch);
    }

    fn push_closest(&self, c: &ClosestPoints, normal: &Vec3, gap: f64, scratch: &mut Scratch) {
        let (ea, eb) = (scratch.near_a[c.edges[0]].index, scratch.near_b[c.edges[1]].index);
        let feature = feature::edges(
            (ea, self.a.shape.edges[ea as usize].vertices, c.parameter[0]),
            (eb, self.b.shape.edges[eb as usize].vertices, c.parameter[1]),
        );
        scratch.candidates.clear();
        scratch.candidates.push(Candidate { point: (c.on_a + c.on_b) * 0.5, gap, feature });
        self.report(normal, scratch);
    }

    /// Reports the support of A alone.
    fn push_support(&self, normal: &Vec3, gap: f64, scratch: &mut Scratch) {
        let back = -self.rotation.tr_mul(normal);
        let v = scratch.a_in_b.first_at(&back, scratch.a_in_b.lowest(&back));
        let point = self.a.shape.vertices[v] + normal * (0.5 * gap);
        scratch.candidates.clear();
        scratch.candidates.push(Candidate { point, gap, feature: feature::vertex(v) });
        self.report(normal, scratch);
    }

    /// Turns the candidates, at most four and in the frame of A, into contact points of the world.
    fn report(&self, normal: &Vec3, scratch: &mut Scratch) {
        let candidates = &mut scratch.candidates;
        let deepest = lowest_gap(candidates);
        if deepest < -TIE * self.size {
            self.place(normal, deepest, candidates);
        }
        let pose = &self.a.pose;
        let normal = -(pose.orientation * normal);
        scratch.points.extend(candidates.iter().map(|c| Point {
            feature: c.feature,
            point: pose.point(&c.point),
            normal,
            gap: c.gap,
        }));
    }

    /// Moves points of overlapping bodies into the overlap; drops those that are further from it than
    /// deep, save the deepest.
    fn place(&self, normal: &Vec3, deepest: f64, candidates: &mut Vec<Candidate>) {
        let count = candidates.len().min(reduce::MAX_POINTS);
        let mut spans = [Span::between_surfaces(&candidates[0]); reduce::MAX_POINTS];
        let mut points = [Vec3::zeros(); reduce::MAX_POINTS];
        for (k, c) in candidates.iter().take(count).enumerate() {
            spans[k] = Span::between_surfaces(c);
            points[k] = c.point;
        }
        placing::cut(self.a.shape, &points[..count], normal, &mut spans[..count]);
        for p in &mut points[..count] {
            *p = self.rotation.tr_mul(&(*p - self.offset));
        }
        let in_b = self.rotation.tr_mul(normal);
        placing::cut(self.b.shape, &points[..count], &in_b, &mut spans[..count]);
        let mut spans = spans.iter();
        candidates.retain_mut(|c| {
            let Some(span) = spans.next() else { return false };
            if c.gap >= 0.0 {
                return true;
            }
            if !span.is_empty() {
                c.point += normal * span.middle();
                return true;
            }
            let in_a = Pose { position: self.offset, orientation: self.turn };
            let solids = [(self.a.shape, &Pose::identity()), (self.b.shape, &in_a)];
            let pulled = placing::pull_in(solids, &c.point, INSIDE * self.size);
            // Where bodies of equal outline lean on each other, lines through their corners pass just
            // beside one of them: a manifold without its corners would carry no moment.
            let keeps = c.gap == deepest || (pulled - c.point).norm() <= -c.gap;
            c.point = pulled;
            keeps
        });
    }
}

fn lowest_gap(candidates: &[Candidate]) -> f64 {
    candidates.iter().fold(f64::INFINITY, |g, c| if c.gap < g { c.gap } else { g })
}
