//! Contact points of two convex polyhedra.
//!
//! Reads: two shapes and their poses. Writes: at most four points. Cost: some microseconds per
//! touching pair of ballast grains, a tenth of a microsecond for a pair that was apart before.
//!
//! 1. An axis that separated the pair before rejects it, if it still does.
//! 2. Face normals of both bodies ([`faces`]), then axes perpendicular to two edges ([`edges`]):
//!    the axis of largest separation over all of them. For bodies that overlap this is
//!    the axis of least depth.
//! 3. Bodies apart whose closest points are at vertices have as axis the line between them.
//! 4. Along the axis, the patch: all corners of the gap up to the alert distance ([`patch`]), of
//!    which the four that best stand for it are reported ([`reduce`]). The patch of a face's axis
//!    also tells where the bodies are closest or overlap, and so which edges step 2 has to ask.
//!
//! Contract: the result depends on shapes and poses alone, not on [`PairMemory`]. Two bodies at a
//! distance of at most `alert` have a contact, others have none; the lowest gap is that distance or,
//! for bodies that overlap, minus the least depth. The points' feet, half a gap to either side along
//! the common normal, are on the surfaces that face each other; feet of wide gaps may be a
//! little beside the overlap.

mod cloud;
mod edges;
mod faces;
mod feature;
mod half_space;
mod patch;
mod reduce;

use crate::geometry::Polyhedron;
use crate::math::{Mat3, Pose, Vec3};
use cloud::Cloud;
use edges::{ClosestPoints, EdgeAxis, NearEdge};
use faces::FaceAxis;
use patch::Sides;
use reduce::Candidate;

pub use feature::on_part;
pub use half_space::touch_half_space;

/// Separations closer than this fraction of the bodies' radii count as equal: then faces of A are
/// preferred to those of B, and faces to edges.
const TIE: f64 = 2.5e-10;
/// How far, over the radii, a point may be out of a body and still count as inside.
const INSIDE: f64 = 1e-12;
/// How far from both ends of its edges, over their lengths, a closest point is safely unique.
const INTERIOR: f64 = 1e-6;
/// Points of a patch closer than this, over the radii, count as one.
const LOOSE: f64 = 1e-7;
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
    /// One above the edges of A and of B that were closest; zero if none.
    edges: [u32; 2],
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
    /// Heights of vertices over the slab.
    heights: Vec<f64>,
    sides: Sides,
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
    let pair = Pair { a, b, rotation, offset, size, alert };
    if pair.still_apart(&memory.axis) {
        return;
    }
    pair.load(scratch);
    let apart = pair.search(memory, scratch).err();
    memory.axis = apart.map_or([0.0; 3], |n| [n.x as f32, n.y as f32, n.z as f32]);
    scratch.points.sort_unstable_by_key(|p| p.feature);
}

/// Two bodies, seen from the frame of A.
struct Pair<'a> {
    a: Solid<'a>,
    b: Solid<'a>,
    /// From the frame of B to that of A.
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
    /// From A to B, in the frame of A.
    normal: Vec3,
    separation: f64,
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

    /// Finds the best axis and reports the contact points along it.
    fn search(&self, memory: &mut PairMemory, scratch: &mut Scratch) -> Found<()> {
        let face = self.best_face(memory, scratch)?;
        let floor = face.separation + TIE * self.size;
        let known = self.known_edges(&memory.edges, scratch);
        memory.edges = [0; 2];
        if let Some(e) = &known {
            if e.separation > self.alert {
                return Err(e.normal);
            }
            if e.separation > floor.max(0.0) && self.are_closest(e, scratch) {
                self.push_edges(e, memory, scratch);
                return Ok(());
            }
        }
        if face.separation > 0.0 {
            return self.points_of_face_apart(&face, memory, scratch);
        }
        let known = known.filter(|e| e.separation > floor && e.separation <= 0.0);
        match self.best_edges(&face, known.as_ref(), scratch) {
            Some(e) if e.separation > self.alert => Err(e.normal),
            Some(e) if e.separation <= 0.0 || self.are_closest(&e, scratch) => {
                self.push_edges(&e, memory, scratch);
                Ok(())
            }
            Some(e) => self.closest_points(&e.normal, e.separation, memory, scratch),
            None => {
                // Without a known axis, the search began with the patch along the face's.
                if known.is_some() {
                    self.find_patch(&face.normal, face.separation, scratch);
                }
                self.push_face(&face, scratch);
                Ok(())
            }
        }
    }

    /// Contact points of bodies that a face separates by no more than the alert distance.
    fn points_of_face_apart(
        &self,
        face: &BestFace,
        memory: &mut PairMemory,
        scratch: &mut Scratch,
    ) -> Found<()> {
        self.find_patch(&face.normal, face.separation, scratch);
        // Points of both surfaces that are as close as the axis says: nothing is closer.
        if lowest_gap(&scratch.candidates) <= face.separation + TIE * self.size {
            self.push_face(face, scratch);
            return Ok(());
        }
        self.closest_points(&face.normal, face.separation, memory, scratch)
    }

    /// The contact of bodies that are further apart than the best axis shows: edges or vertices are
    /// closest. `normal` and `separation` are those of the best axis.
    fn closest_points(
        &self,
        normal: &Vec3,
        separation: f64,
        memory: &mut PairMemory,
        scratch: &mut Scratch,
    ) -> Found<()> {
        self.gather(normal, self.alert - separation, scratch);
        let (near_a, near_b) = (&scratch.near_a, &scratch.near_b);
        let Some(c) = edges::closest_points(near_a, near_b, self.alert + SLAB * self.size) else {
            // Apart. The next step asks again unless this direction happens to tell.
            let any = edges::closest_points(near_a, near_b, f64::INFINITY);
            return Err(any.map_or(*normal, |c| (c.on_b - c.on_a).normalize()));
        };
        let distance = c.distance_squared.sqrt();
        if distance > self.alert {
            return Err((c.on_b - c.on_a) / distance);
        }
        let [ea, eb] = c.edges;
        let axis = self.edge_axis(&scratch.near_a[ea], &scratch.near_b[eb], c.edges, scratch);
        match axis {
            Some(e) if e.separation > separation && self.are_closest(&e, scratch) => {
                self.push_edges(&e, memory, scratch);
            }
            _ if distance > separation + TIE * self.size => {
                self.push_closest(&c, &((c.on_b - c.on_a) / distance), distance, scratch);
            }
            // Rounding alone leads here.
            _ => self.push_closest(&c, normal, separation, scratch),
        }
        Ok(())
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
            BestFace { of_b: true, normal, separation: on_b.separation }
        } else {
            let separation = on_a.separation;
            BestFace { of_b: false, normal: normal_a, separation }
        })
    }

    /// Fills the lists of edges with an end at most `slab` off the support planes along `n`.
    fn gather(&self, n: &Vec3, slab: f64, scratch: &mut Scratch) {
        let (a, b) = (self.a.shape, self.b.shape);
        // Finite, so that heights are numbers when all edges are asked for.
        let slab = (slab + SLAB * self.size).min(10.0 * self.size);
        let heights = &mut scratch.heights;
        scratch.a_in_b.heights(&-self.rotation.tr_mul(n), slab, heights);
        edges::near_edges(a, heights, &mut scratch.near_a, |e| edges::edge_of_a(a, e));
        scratch.b_in_a.heights(n, slab, heights);
        let (b_in_a, rotation) = (&scratch.b_in_a, &self.rotation);
        edges::near_edges(b, heights, &mut scratch.near_b, |e| {
            edges::edge_of_b(b, b_in_a, rotation, e)
        });
    }

    /// The edges that were closest before, alone in the lists of near edges.
    fn known_edges(&self, edges: &[u32; 2], scratch: &mut Scratch) -> Option<EdgeAxis> {
        let (a, b) = (self.a.shape, self.b.shape);
        let [ea, eb] = edges.map(|e| e as usize);
        if ea == 0 || eb == 0 || ea > a.edges.len() || eb > b.edges.len() {
            return None;
        }
        let near_a = edges::edge_of_a(a, ea - 1);
        let near_b = edges::edge_of_b(b, &scratch.b_in_a, &self.rotation, eb - 1);
        let axis = self.edge_axis(&near_a, &near_b, [0, 0], scratch);
        scratch.near_a.clear();
        scratch.near_a.push(near_a);
        scratch.near_b.clear();
        scratch.near_b.push(near_b);
        axis
    }

    fn edge_axis(
        &self,
        ea: &NearEdge,
        eb: &NearEdge,
        edges: [usize; 2],
        scratch: &Scratch,
    ) -> Option<EdgeAxis> {
        edges::axis_of(self.a.shape, &scratch.b_in_a, ea, eb, edges, f64::NEG_INFINITY)
    }

    /// Whether the closest points of two edges are strictly inside both and as far apart as their
    /// axis says: then they are the closest points of the bodies, and there are no others.
    fn are_closest(&self, e: &EdgeAxis, scratch: &Scratch) -> bool {
        let (ea, eb) = (&scratch.near_a[e.edges[0]], &scratch.near_b[e.edges[1]]);
        let c = edges::closest_on_segments(ea, eb);
        c.parameter.iter().all(|t| *t > INTERIOR && *t < 1.0 - INTERIOR)
            && !edges::nearly_parallel(ea, eb)
            && c.distance_squared.sqrt() <= e.separation + TIE * self.size
    }

    /// The axis perpendicular to two edges that is better than the best face of bodies that no face
    /// separates. `known` is a better axis, if one is known.
    fn best_edges(
        &self,
        face: &BestFace,
        known: Option<&EdgeAxis>,
        scratch: &mut Scratch,
    ) -> Option<EdgeAxis> {
        let floor = face.separation + TIE * self.size;
        let (normal, separation, common) = if let Some(e) = known {
            let c = self.closest_on(e, scratch);
            (e.normal, e.separation, Some((c.on_a + c.on_b) * 0.5))
        } else {
            self.find_patch(&face.normal, face.separation, scratch);
            (face.normal, face.separation, deepest(&scratch.candidates).map(|c| c.point))
        };
        let certain = common.is_some_and(|p| self.in_both(p));
        let depth = -separation;
        let reach = if certain { depth } else { depth.max(self.alert) };
        self.gather(&normal, depth + reach, scratch);
        let best = self.best_near_edges(floor, reach, scratch);
        let decided = certain
            || best.as_ref().is_some_and(|e| {
                let c = self.closest_on(e, scratch);
                e.separation > 0.0 || self.in_both((c.on_a + c.on_b) * 0.5)
            });
        if decided {
            return best;
        }
        // Neither a separating axis nor a common point is at hand: ask all edges.
        self.gather(&normal, f64::INFINITY, scratch);
        self.best_near_edges(floor, f64::INFINITY, scratch)
    }

    fn best_near_edges(&self, floor: f64, reach: f64, scratch: &Scratch) -> Option<EdgeAxis> {
        let (a, b) = (&scratch.near_a, &scratch.near_b);
        let reach = reach + SLAB * self.size;
        edges::best_edge_axis(self.a.shape, &scratch.b_in_a, a, b, floor, reach)
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

    /// Reports the contact of two edges and remembers them.
    fn push_edges(&self, e: &EdgeAxis, memory: &mut PairMemory, scratch: &mut Scratch) {
        let [ea, eb] = e.edges;
        memory.edges = [scratch.near_a[ea].index + 1, scratch.near_b[eb].index + 1];
        let c = self.closest_on(e, scratch);
        self.push_closest(&c, &e.normal, e.separation, scratch);
    }

    fn push_closest(&self, c: &ClosestPoints, normal: &Vec3, gap: f64, scratch: &mut Scratch) {
        let (ea, eb) = (scratch.near_a[c.edges[0]].index, scratch.near_b[c.edges[1]].index);
        let feature = feature::edges(
            (ea, self.a.shape.edges[ea as usize].vertices, c.parameter[0]),
            (eb, self.b.shape.edges[eb as usize].vertices, c.parameter[1]),
        );
        let point = (c.on_a + c.on_b) * 0.5;
        self.find_patch(normal, gap, scratch);
        self.push_patch(normal, Candidate { point, gap, feature }, scratch);
    }

    /// Reports the contact along a face's normal, its patch in `scratch.candidates`.
    fn push_face(&self, face: &BestFace, scratch: &mut Scratch) {
        let (normal, gap) = (&face.normal, face.separation);
        let (vertex, feature, side) = if face.of_b {
            let back = -self.rotation.tr_mul(normal);
            let v = scratch.a_in_b.first_at(&back, scratch.a_in_b.lowest(&back));
            (self.a.shape.vertices[v], feature::vertex(v), 1.0)
        } else {
            let v = scratch.b_in_a.first_at(normal, scratch.b_in_a.lowest(normal));
            (scratch.b_in_a.get(v), feature::vertex_of_b(v), -1.0)
        };
        let point = vertex + normal * (0.5 * side * gap);
        self.push_patch(normal, Candidate { point, gap, feature }, scratch);
    }

    /// Reports the four of `scratch.candidates`, the patch along `normal`, that best stand for it.
    ///
    /// `closest` is where the gap is the axis's separation, which no corner's is below but for
    /// rounding; it is reported if rounding hides it from the patch.
    fn push_patch(&self, normal: &Vec3, closest: Candidate, scratch: &mut Scratch) {
        let candidates = &mut scratch.candidates;
        if lowest_gap(candidates) > closest.gap + LOOSE * self.size {
            candidates.retain(|c| c.feature != closest.feature);
            candidates.push(closest);
        }
        reduce::keep_four(candidates, normal, self.alert, self.size);
        if let Some(d) = candidates.iter_mut().min_by(|c, d| c.gap.total_cmp(&d.gap)) {
            d.gap = closest.gap;
        }
        candidates.iter_mut().for_each(|c| c.gap = c.gap.max(closest.gap));
        self.report(normal, scratch);
    }

    /// Fills `scratch.candidates` with the corners of the gap along `n`, in the frame of A.
    fn find_patch(&self, n: &Vec3, separation: f64, scratch: &mut Scratch) {
        let axis = patch::Axis {
            normal: *n,
            in_b: self.rotation.tr_mul(n),
            alert: self.alert,
            slab: (self.alert - separation).max(0.0) + SLAB * self.size,
            tolerance: TIE * self.size,
        };
        let Scratch { candidates, sides, a_in_b, b_in_a, .. } = scratch;
        let bodies = patch::Bodies { a: self.a.shape, b: self.b.shape, a_in_b, b_in_a };
        axis.corners(&bodies, sides, candidates);
    }

    /// Turns the candidates, at most four and in the frame of A, into contact points of the world.
    fn report(&self, normal: &Vec3, scratch: &mut Scratch) {
        let pose = &self.a.pose;
        let normal = -(pose.orientation * normal);
        scratch.points.extend(scratch.candidates.iter().map(|c| Point {
            feature: c.feature,
            point: pose.point(&c.point),
            normal,
            gap: c.gap,
        }));
    }
}

/// The first of the candidates of lowest gap.
fn deepest(candidates: &[Candidate]) -> Option<&Candidate> {
    candidates.iter().reduce(|d, c| if c.gap < d.gap { c } else { d })
}

fn lowest_gap(candidates: &[Candidate]) -> f64 {
    deepest(candidates).map_or(f64::INFINITY, |c| c.gap)
}
