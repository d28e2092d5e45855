//! Cached axes that may separate a pair best, valid while the bodies move little against each other.
//!
//! Reads: pairs. Writes: lists of feature numbers, and bounds on all features that are not listed. Cost: bytes per
//! pair; two square roots per validity check. Contract: where the best listed axis exceeds the bounds, the full
//! search finds the same axis, to the bit. Otherwise the full search runs.
//!
//! Let the reference point be displaced by Δ and unit vectors by φ at most ([`ReferencePose`]); lists are valid while
//! Δ <= P and φ <= Φ, which is [`MAX_ROTATION`]. A vertex w of B bounds the separation along a face of A from above,
//! and moves by at most Δ + φ l, l being its distance from the reference point. So with a common lever λ no
//! separation that was bounded by s exceeds s + Δ + φ λ, if Φ (l - λ) is added to s where l > λ. Faces of B and
//! vertices of A are treated alike.
//!
//! For two edges at an angle θ let d join their closest points. Their axis n turns by an angle with a sine of at most
//! x = Φ / sin θ, which takes at most x² |n · d| from n · d and adds at most x times the part of d across n. Motion
//! of the edges adds Δ + φ l. Only pairs of edges that may contain the deepest points must be bounded
//! ([`super::edges`]).

use super::cache::{IndexList, RankedList, ReferencePose, RelativeMotion};
use super::edges::{self, EdgeSegment};
use super::frame::MotionBound;
use super::pair::{self, BodyPair, FaceAxes, SLAB, TIE, larger, smaller};
use crate::math::{Vec3, round, widen};

/// Maximum displacement P of the reference point, over the sum of the radii.
const MAX_DISPLACEMENT: f64 = 4e-3;
/// Common lever λ, over the sum of the radii.
const LEVER: f64 = 0.2;
/// Margin below the best separation within which axes are listed, over the sum of the radii.
const LISTING_MARGIN: f64 = 1e-3;

/// Listed axes of a pair, and the configuration for which they were listed.
#[derive(Debug, Clone, Copy, Default)]
pub struct CandidateAxes {
    reference: ReferencePose,
    /// Alert distance for which the pairs of edges were listed, m.
    alert: f64,
    /// Maximum separations along unlisted faces and along unlisted pairs of edges, m.
    bounds: [f32; 2],
    /// Distance of the bodies up to which the best pair of edges is among the listed, m.
    pub max_distance: f64,
    /// Body (0 or 1) and face, with an upper bound of the separation, m.
    pub faces: RankedList<10>,
    /// Edges of A and of B, with an upper bound of the separation, m.
    pub edges: RankedList<6>,
    /// True if all listed pairs of edges make an axis while the lists are valid.
    pub crossing: bool,
    /// Support vertices for axes near the best one.
    pub supports: SupportCache,
}

/// Pairs of edges that may contain the deepest points.
#[derive(Debug, Default)]
pub struct EdgePairs {
    pub list: Vec<[usize; 2]>,
    /// Distance of the bodies up to which the best of all pairs is in the list while it is valid, m; `None` if
    /// unknown.
    pub max_distance: Option<f64>,
}

/// Upper bounds on the separation along unlisted axes in the present configuration, m; ties are included.
#[derive(Debug, Clone, Copy)]
pub struct UnlistedBounds {
    pub faces: f64,
    /// Bound over pairs of edges; infinite if unknown.
    pub edges: f64,
    /// Amount by which listed axes may exceed their bounds, m.
    pub more: f64,
}

impl CandidateAxes {
    /// Returns bounds on unlisted axes, or `None` if the lists are not valid for `pair`.
    pub fn bounds(&self, pair: &BodyPair) -> Option<UnlistedBounds> {
        let RelativeMotion { at_point, rotation: turn } = self.reference.moved(pair)?;
        if at_point > MAX_DISPLACEMENT * pair.size || turn > MAX_ROTATION || pair.alert > self.alert
        {
            return None;
        }
        let more = at_point + (LEVER * turn + SLAB + TIE) * pair.size;
        let [faces, edges] = self.bounds.map(|b| f64::from(b) + more);
        Some(UnlistedBounds { faces, edges, more })
    }

    /// Invalidates the lists.
    pub fn clear(&mut self) {
        self.reference = ReferencePose::default();
    }

    /// Returns the bound on the relative motion of all points of the bodies within which lists are valid.
    pub fn motion_bound(pair: &BodyPair) -> MotionBound {
        // The reference point is less than the alert distance outside both bodies.
        let lever = 2.0 * pair.a.radius.max(pair.b.radius) + pair.alert;
        MotionBound {
            displacement: (MAX_DISPLACEMENT + SLAB) * pair.size + MAX_ROTATION * lever,
            rotation: MAX_ROTATION,
        }
    }

    /// Lists the axes near the best one, of separation `best` along `normal`.
    ///
    /// `c` is near both bodies, `known` are the edges of the best axis.
    pub fn rebuild(
        &mut self,
        pair: &BodyPair,
        normal: &Vec3,
        best: f64,
        c: &Vec3,
        known: Option<[usize; 2]>,
        pairs: &EdgePairs,
    ) {
        let limit = best - LISTING_MARGIN * pair.size;
        let excess = MAX_ROTATION * LEVER * pair.size;
        let excess = |x: &Vec3| larger(MAX_ROTATION * (x - c).norm() - excess, 0.0);
        self.faces.clear();
        let excess_in_b = |x: &Vec3| excess(&(pair.rotation * x + pair.offset));
        let list = &mut |f, bound| self.faces.push([0, f], bound);
        let of_a = list_faces(&pair.faces_of_a(), normal, limit, excess, list);
        let list = &mut |f, bound| self.faces.push([1, f], bound);
        let of_b = list_faces(&pair.faces_of_b(), &-pair.in_b(normal), limit, excess_in_b, list);
        let faces = larger(of_a, of_b);
        self.edges.clear();
        let mut bound = f64::INFINITY;
        self.max_distance = pair.alert;
        if let Some(max_distance) = pairs.max_distance {
            bound = f64::NEG_INFINITY;
            self.max_distance = max_distance;
            for edges in &pairs.list {
                let [a, b] = [edges::edge_of_a(pair, edges[0]), edges::edge_of_b(pair, edges[1])];
                let most = edges_bound(&a, &b, excess).unwrap_or(f64::INFINITY);
                if most < limit && known != Some(*edges) {
                    bound = larger(bound, most);
                } else {
                    self.edges.push(*edges, most);
                }
            }
        } else if let Some(edges) = known {
            self.edges.push(edges, f64::INFINITY);
        }
        self.bounds = [faces, bound].map(|b| b as f32);
        let whole = self.faces.is_complete() && self.edges.is_complete();
        let crossing = self.edges.iter().all(|(edges, _)| {
            let [a, b] = [edges::edge_of_a(pair, edges[0]), edges::edge_of_b(pair, edges[1])];
            edges::arcs_cross(pair, edges, [&a.along, &b.along], 1.001 * MAX_ROTATION)
        });
        self.crossing = crossing;
        self.supports = SupportCache::new(pair, normal);
        self.alert = pair.alert;
        self.reference = if whole { ReferencePose::new(pair, c) } else { ReferencePose::default() };
    }
}

/// Lists the faces that may separate by `limit`, with upper bounds; returns the largest bound of the others.
///
/// `normal` is the best axis, from `faces.own` to the other body; `excess` applies to vertices of the other body.
fn list_faces(
    faces: &FaceAxes,
    normal: &Vec3,
    limit: f64,
    excess: impl Fn(&Vec3) -> f64,
    list: &mut impl FnMut(usize, f64),
) -> f64 {
    let lowest = |n: &Vec3| {
        let corner = faces.lowest_corner_along(n);
        (corner, excess(&corner))
    };
    // A corner deep below one face is often below its neighbours, too.
    let first = lowest(normal);
    let mut last = first;
    let mut bound = f64::NEG_INFINITY;
    for (f, (n, d)) in faces.own.face_normals.iter().zip(&faces.own.face_offsets).enumerate() {
        let above = |(x, more): &(Vec3, f64)| pair::height(n, x) - d + more;
        let mut least = smaller(above(&first), above(&last));
        if least >= limit {
            last = lowest(n);
            least = above(&last);
        }
        if least < limit {
            bound = larger(least, bound);
        } else {
            list(f, least);
        }
    }
    bound
}

/// Returns an upper bound of the separation of two edges while lists are valid; `None` if no useful bound exists.
fn edges_bound(a: &EdgeSegment, b: &EdgeSegment, excess: impl Fn(&Vec3) -> f64) -> Option<f64> {
    let cross = a.along.cross(&b.along);
    let lengths = a.along.norm_squared() * b.along.norm_squared();
    let cross_squared = cross.norm_squared();
    // 6 degrees: then x <= 0.08.
    if cross_squared <= 1e-2 * lengths {
        return None;
    }
    let n = cross / cross_squared.sqrt();
    let out = n.dot(&a.start);
    // The axis turns by less than 0.1: the origin stays on its side.
    if out * out <= 1e-2 * a.start.norm_squared() {
        return None;
    }
    let x = MAX_ROTATION * (lengths / cross_squared).sqrt();
    let c = edges::closest_on_segments(a, b);
    let between = c.on_b - c.on_a;
    let along = n.dot(&between);
    let beside = (between - n * along).norm();
    let separation = if out < 0.0 { -along } else { along };
    Some(separation + x * x * along.abs() + x * beside + excess(&c.on_b))
}

/// Maximum rotation of the axis in A, and of B against A, rad.
pub const MAX_ROTATION: f64 = 8e-3;

/// Vertices that can be the outermost ones along an axis near a known one.
///
/// Along an axis that is near enough, the outermost listed vertices are the outermost of all. Let unit vectors turn
/// by at most φ against a body: a vertex v at a height h above the lowest one w stays above it if h > φ |v - w|.
#[derive(Debug, Clone, Copy, Default)]
pub struct SupportCache {
    /// Axis from A to B, in the frame of A.
    axis: [f32; 3],
    /// Vertices of A and of B, some repeated; `None` if there are too many.
    corners: [Option<[u8; 6]>; 2],
}

impl SupportCache {
    /// Returns the support vertices for axes near `n`.
    pub fn new(pair: &BodyPair, n: &Vec3) -> Self {
        let corners = [
            lowest_candidates(&pair.a.vertices, &-n),
            lowest_candidates(&pair.b.vertices, &pair.in_b(n)),
        ];
        Self { axis: round(n), corners }
    }

    /// Returns [`BodyPair::separation`] of bodies that have turned by at most [`MAX_ROTATION`] against each other.
    #[inline]
    pub fn separation(&self, pair: &BodyPair, n: &Vec3) -> f64 {
        if !self.is_near(n) {
            return pair.separation(n);
        }
        let low = self.lowest(1, &pair.b.vertices, &pair.in_b(n));
        low + n.dot(&pair.offset) + self.lowest(0, &pair.a.vertices, &-n)
    }

    /// Returns the smallest `n · v` of B's vertices; `axis` is n in the frame of A.
    #[inline]
    pub fn lowest_of_b(&self, axis: &Vec3, points: &[Vec3], n: &Vec3) -> f64 {
        if self.is_near(axis) { self.lowest(1, points, n) } else { pair::lowest(points, n) }
    }

    /// Returns the smallest `n · v` of A's vertices; `axis` is -n.
    #[inline]
    pub fn lowest_of_a(&self, axis: &Vec3, points: &[Vec3], n: &Vec3) -> f64 {
        if self.is_near(axis) { self.lowest(0, points, n) } else { pair::lowest(points, n) }
    }

    fn is_near(&self, n: &Vec3) -> bool {
        (widen(&self.axis) - n).norm_squared() <= MAX_ROTATION * MAX_ROTATION
    }

    #[inline]
    fn lowest(&self, side: usize, points: &[Vec3], n: &Vec3) -> f64 {
        let Some(corners) = &self.corners[side] else {
            return pair::lowest(points, n);
        };
        corners
            .iter()
            .fold(f64::INFINITY, |low, v| smaller(pair::height(n, &points[usize::from(*v)]), low))
    }
}

/// Returns the vertices that may be the lowest along an axis near `n`, padded with the first one.
///
/// A fixed number keeps the loop free of branches that a processor cannot predict.
fn lowest_candidates<const N: usize>(points: &[Vec3], n: &Vec3) -> Option<[u8; N]> {
    let mut list = IndexList::<N>::default();
    let lowest = &points[pair::first_lowest(points, n)];
    for (v, x) in points.iter().enumerate() {
        let aside = x - lowest;
        // The axis may turn by TURN, the body too; single precision takes less than a thousandth.
        let fall = larger(n.dot(&aside), 0.0) / (2.001 * MAX_ROTATION);
        if fall * fall <= aside.norm_squared() {
            list.push(v);
        }
    }
    list.is_complete().then(|| list.padded())
}
