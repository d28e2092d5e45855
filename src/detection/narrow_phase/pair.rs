//! Two bodies seen from the frame of the first: places, directions, supports, separations.

use crate::geometry::Polyhedron;
use crate::math::{Mat3, Pose, Quat, Vec3};

/// Separations closer than this fraction of the bodies' radii count as equal: then faces of A are
/// preferred to those of B, and faces to edges.
pub const TIE: f64 = 2.5e-10;

/// What is added to slabs and distances that only choose features, over the radii: faces are flat to
/// 1e-7 only.
pub const SLAB: f64 = 1e-6;

/// A convex body of the configuration.
#[derive(Debug, Clone, Copy)]
pub struct ConvexBody<'a> {
    pub shape: &'a Polyhedron,
    pub pose: Pose,
}

/// Two bodies whose spheres come within the alert distance of each other.
pub struct BodyPair<'a> {
    pub a: &'a Polyhedron,
    pub b: &'a Polyhedron,
    /// Of A.
    pub pose: Pose,
    /// From the frame of B to that of A.
    pub turn: Quat,
    /// The same.
    pub rotation: Mat3,
    /// Origin of B in the frame of A.
    pub offset: Vec3,
    /// Origin of A in the frame of B.
    pub back: Vec3,
    /// Sum of the radii: the length that tolerances refer to.
    pub size: f64,
    pub alert: f64,
}

impl<'a> BodyPair<'a> {
    /// Both bodies, or how far their spheres are beyond the alert distance.
    pub fn new(a: ConvexBody<'a>, b: ConvexBody<'a>, alert: f64) -> Result<Self, f64> {
        let apart = b.pose.position - a.pose.position;
        let size = a.shape.radius + b.shape.radius;
        let reach = size * (1.0 + TIE) + alert;
        let distance_squared = apart.norm_squared();
        if distance_squared > reach * reach {
            return Err(distance_squared.sqrt() - reach);
        }
        let to_a = a.pose.orientation.inverse();
        let offset = to_a * apart;
        let turn = to_a * b.pose.orientation;
        let rotation = turn.to_rotation_matrix().into_inner();
        let back = -rotation.tr_mul(&offset);
        let (a, b, pose) = (a.shape, b.shape, a.pose);
        Ok(Self { a, b, pose, turn, rotation, offset, back, size, alert })
    }

    /// A direction of A's frame in that of B.
    pub fn in_b(&self, n: &Vec3) -> Vec3 {
        self.rotation.tr_mul(n)
    }

    /// Corner `v` of B in the frame of A.
    pub fn corner_of_b(&self, v: usize) -> Vec3 {
        self.rotation * self.b.vertices[v] + self.offset
    }

    /// A point of A's frame in that of B.
    pub fn point_in_b(&self, x: &Vec3) -> Vec3 {
        self.rotation.tr_mul(x) + self.back
    }

    /// How far B is from A along the direction `n` from A to B; negative if they overlap along it.
    pub fn separation(&self, n: &Vec3) -> f64 {
        lowest(&self.b.vertices, &self.in_b(n)) + n.dot(&self.offset) - highest(&self.a.vertices, n)
    }

    /// How much an axis of length 1, to single precision, separates beyond the alert distance for certain, all rounding
    /// taken off.
    pub fn separation_beyond_alert(&self, n: &Vec3) -> Option<f64> {
        let beyond = self.separation(n) / 1.000_001 - (self.alert + 1e-9 * self.size);
        (beyond > 0.0).then_some(beyond)
    }

    /// The faces of A and the corners of B.
    pub fn faces_of_a(&self) -> FaceAxes<'a> {
        let to_own = self.rotation;
        FaceAxes { own: self.a, other: self.b, to_own, offset: self.offset }
    }

    /// The faces of B and the corners of A.
    pub fn faces_of_b(&self) -> FaceAxes<'a> {
        let to_own = self.rotation.transpose();
        FaceAxes { own: self.b, other: self.a, to_own, offset: self.back }
    }
}

/// The faces of one body as axes of separation from the other.
pub struct FaceAxes<'a> {
    pub own: &'a Polyhedron,
    other: &'a Polyhedron,
    /// From the other body's frame.
    to_own: Mat3,
    /// The other body's origin.
    offset: Vec3,
}

impl FaceAxes<'_> {
    /// Distance of the other body's lowest corner above face `f`; negative below.
    pub fn separation(&self, f: usize) -> f64 {
        self.separation_by(f, lowest)
    }

    /// The same by a faster way to the smallest `n · v` of the other body's corners.
    #[inline]
    pub fn separation_by(&self, f: usize, lowest: impl Fn(&[Vec3], &Vec3) -> f64) -> f64 {
        let n = &self.own.face_normals[f];
        let low = lowest(&self.other.vertices, &self.to_own.tr_mul(n));
        low + n.dot(&self.offset) - self.own.face_offsets[f]
    }

    /// The lowest of the other body's corners above face `f`.
    pub fn lowest_corner(&self, f: usize) -> Vec3 {
        self.lowest_corner_along(&self.own.face_normals[f])
    }

    /// The lowest of the other body's corners along `n`, in the frame of the faces.
    pub fn lowest_corner_along(&self, n: &Vec3) -> Vec3 {
        let n = self.to_own.tr_mul(n);
        self.to_own * self.other.vertices[first_lowest(&self.other.vertices, &n)] + self.offset
    }

    /// The face that lies most towards the other body.
    pub fn most_aligned(&self) -> usize {
        first_lowest(&self.own.face_normals, &-self.offset)
    }
}

/// Largest `n · v`.
pub fn highest(points: &[Vec3], n: &Vec3) -> f64 {
    -lowest(points, &-n)
}

/// Smallest `n · v`.
///
/// The minimum of numbers does not depend on their order: four at a time.
pub fn lowest(points: &[Vec3], n: &Vec3) -> f64 {
    let mut low = [f64::INFINITY; 4];
    let mut blocks = points.chunks_exact(4);
    for block in &mut blocks {
        for k in 0..4 {
            low[k] = smaller(height(n, &block[k]), low[k]);
        }
    }
    for (k, v) in blocks.remainder().iter().enumerate() {
        low[k] = smaller(height(n, v), low[k]);
    }
    smaller(smaller(low[0], low[1]), smaller(low[2], low[3]))
}

/// `n · v`.
#[inline]
pub fn height(n: &Vec3, v: &Vec3) -> f64 {
    n.x * v.x + n.y * v.y + n.z * v.z
}

/// Number of the first point of smallest `n · v`.
pub fn first_lowest(points: &[Vec3], n: &Vec3) -> usize {
    let mut best = (f64::INFINITY, 0);
    for (k, v) in points.iter().enumerate() {
        let height = height(n, v);
        if height < best.0 {
            best = (height, k);
        }
    }
    best.1
}

/// `f64::min` minds NaN and does not become one instruction; positions are finite here.
#[inline]
pub fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// As [`smaller`].
#[inline]
pub fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// Faces whose bound is this far below the best one, over the sum of the radii, cannot be better: well
/// above rounding, so that the result does not depend on where the search begins.
const SURE: f64 = 1e-6;

/// A face normal as separating axis.
#[derive(Debug, Clone, Copy)]
pub struct FaceAxis {
    pub face: usize,
    /// Distance of the other body's nearest vertex above the face's plane, m; negative below.
    pub separation: f64,
}

impl FaceAxis {
    /// Whether this one is the better: of larger separation, or of lower number among equals.
    pub fn beats(&self, other: &FaceAxis) -> bool {
        self.separation > other.separation
            || (self.separation == other.separation && self.face < other.face)
    }
}

/// The face of largest separation, the lowest number among equals; `Err(face)` when a face separates
/// by more than `alert`.
///
/// If no face reaches `floor`, the result is some face below it.
///
/// For any corner w of the other body, `n · w - d` bounds the separation of a face from above,
/// because the separation is the minimum of that expression over all corners. With w deep
/// in the body one product discards a face.
pub fn best_face_axis(
    faces: &FaceAxes,
    start: usize,
    floor: f64,
    alert: f64,
    size: f64,
) -> Result<FaceAxis, usize> {
    let mut best = FaceAxis { face: start, separation: faces.separation(start) };
    if best.separation > alert {
        return Err(start);
    }
    let mut witness = faces.lowest_corner(start);
    let planes = faces.own.face_normals.iter().zip(&faces.own.face_offsets);
    for (face, (n, d)) in planes.enumerate() {
        let bound = (n.x * witness.x + n.y * witness.y + n.z * witness.z) - d;
        if bound < best.separation.max(floor) - SURE * size || face == start {
            continue;
        }
        let found = FaceAxis { face, separation: faces.separation(face) };
        if found.separation > alert {
            return Err(face);
        }
        if found.separation > best.separation {
            witness = faces.lowest_corner(face);
        }
        if found.beats(&best) {
            best = found;
        }
    }
    Ok(best)
}
