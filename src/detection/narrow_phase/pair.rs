//! Two bodies in the frame of the first: poses, supports, and separations along faces.

use crate::geometry::Polyhedron;
use crate::math::{Mat3, Pose, Quat, Vec3};

/// Relative tolerance of separations, as a fraction of the sum of radii.
///
/// Within it faces of A are preferred to those of B, and faces to edges.
pub const TIE: f64 = 2.5e-10;

/// Margin of slabs and distances that only select features, as a fraction of the sum of radii.
///
/// Faces are flat to 1e-7 only.
pub const SLAB: f64 = 1e-6;

/// Convex body at its pose.
#[derive(Debug, Clone, Copy)]
pub struct ConvexBody<'a> {
    pub shape: &'a Polyhedron,
    pub pose: Pose,
}

/// Two bodies whose bounding spheres come within the alert distance of each other.
pub struct BodyPair<'a> {
    pub a: &'a Polyhedron,
    pub b: &'a Polyhedron,
    /// Pose of A in the world.
    pub pose: Pose,
    /// Rotation from the frame of B to that of A.
    pub orientation: Quat,
    /// Rotation matrix from the frame of B to that of A.
    pub rotation: Mat3,
    /// Origin of B in the frame of A, m.
    pub offset: Vec3,
    /// Origin of A in the frame of B, m.
    pub back: Vec3,
    /// Sum of the radii, m; tolerances are fractions of it.
    pub size: f64,
    pub alert: f64,
}

impl<'a> BodyPair<'a> {
    /// Returns the pair, or by how much the distance of the spheres exceeds the alert distance (`Err`, m).
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
        let orientation = to_a * b.pose.orientation;
        let rotation = orientation.to_rotation_matrix().into_inner();
        let back = -rotation.tr_mul(&offset);
        let (a, b, pose) = (a.shape, b.shape, a.pose);
        Ok(Self { a, b, pose, orientation, rotation, offset, back, size, alert })
    }

    /// Transforms a direction from the frame of A to that of B.
    pub fn in_b(&self, n: &Vec3) -> Vec3 {
        self.rotation.tr_mul(n)
    }

    /// Returns vertex `v` of B in the frame of A.
    pub fn corner_of_b(&self, v: usize) -> Vec3 {
        self.rotation * self.b.vertices[v] + self.offset
    }

    /// Transforms a point from the frame of A to that of B.
    pub fn point_in_b(&self, x: &Vec3) -> Vec3 {
        self.rotation.tr_mul(x) + self.back
    }

    /// Returns the separation of the bodies along `n`, from A to B, m; negative if they overlap along it.
    pub fn separation(&self, n: &Vec3) -> f64 {
        lowest(&self.b.vertices, &self.in_b(n)) + n.dot(&self.offset) - highest(&self.a.vertices, n)
    }

    /// Returns by how much `n` certainly separates beyond the alert distance, m, after all rounding.
    ///
    /// `n` has unit length to single precision.
    pub fn separation_beyond_alert(&self, n: &Vec3) -> Option<f64> {
        let beyond = self.separation(n) / 1.000_001 - (self.alert + 1e-9 * self.size);
        (beyond > 0.0).then_some(beyond)
    }

    /// Returns the faces of A against the vertices of B.
    pub fn faces_of_a(&self) -> FaceAxes<'a> {
        let to_own = self.rotation;
        FaceAxes { own: self.a, other: self.b, to_own, offset: self.offset }
    }

    /// Returns the faces of B against the vertices of A.
    pub fn faces_of_b(&self) -> FaceAxes<'a> {
        let to_own = self.rotation.transpose();
        FaceAxes { own: self.b, other: self.a, to_own, offset: self.back }
    }
}

/// Faces of one body as separating axes from the other.
pub struct FaceAxes<'a> {
    pub own: &'a Polyhedron,
    other: &'a Polyhedron,
    /// Rotation from the other body's frame.
    to_own: Mat3,
    /// Origin of the other body, m.
    offset: Vec3,
}

impl FaceAxes<'_> {
    /// Returns the distance of the other body's lowest vertex above face `f`, m; negative below.
    pub fn separation(&self, f: usize) -> f64 {
        self.separation_by(f, lowest)
    }

    /// Returns [`FaceAxes::separation`] with a faster search `lowest` for the smallest `n · v`.
    #[inline]
    pub fn separation_by(&self, f: usize, lowest: impl Fn(&[Vec3], &Vec3) -> f64) -> f64 {
        let n = &self.own.face_normals[f];
        let low = lowest(&self.other.vertices, &self.to_own.tr_mul(n));
        low + n.dot(&self.offset) - self.own.face_offsets[f]
    }

    /// Returns the other body's lowest vertex above face `f`.
    pub fn lowest_corner(&self, f: usize) -> Vec3 {
        self.lowest_corner_along(&self.own.face_normals[f])
    }

    /// Returns the other body's lowest vertex along `n`, in the frame of the faces.
    pub fn lowest_corner_along(&self, n: &Vec3) -> Vec3 {
        let n = self.to_own.tr_mul(n);
        self.to_own * self.other.vertices[first_lowest(&self.other.vertices, &n)] + self.offset
    }

    /// Returns the face whose normal points most towards the other body.
    pub fn most_aligned(&self) -> usize {
        first_lowest(&self.own.face_normals, &-self.offset)
    }
}

/// Returns the largest `n · v`.
pub fn highest(points: &[Vec3], n: &Vec3) -> f64 {
    -lowest(points, &-n)
}

/// Returns the smallest `n · v`.
///
/// The minimum does not depend on the order, so four points are processed at a time.
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

/// Returns `n · v`.
#[inline]
pub fn height(n: &Vec3, v: &Vec3) -> f64 {
    n.x * v.x + n.y * v.y + n.z * v.z
}

/// Returns the number of the first point with the smallest `n · v`.
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

/// Returns the smaller number as one instruction; positions are finite here, `f64::min` also handles NaN.
#[inline]
pub fn smaller(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// Returns the larger number as one instruction; see [`smaller`].
#[inline]
pub fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// Margin by which the bound of a face must lie below the best separation to discard it, over the sum of radii.
///
/// It is well above rounding, so the result does not depend on the start of the search.
const BOUND_TOLERANCE: f64 = 1e-6;

/// Face normal as separating axis.
#[derive(Debug, Clone, Copy)]
pub struct FaceAxis {
    pub face: usize,
    /// Distance of the other body's nearest vertex above the face's plane, m; negative below.
    pub separation: f64,
}

impl FaceAxis {
    /// True if this axis has the larger separation, or the lower number among equals.
    pub fn beats(&self, other: &FaceAxis) -> bool {
        self.separation > other.separation
            || (self.separation == other.separation && self.face < other.face)
    }
}

/// Returns the face of largest separation, the lowest number among equals.
///
/// `Err(face)` if a face separates by more than `alert`. If no face reaches `floor`, the result is some face below
/// it.
///
/// For any vertex w of the other body, `n · w - d` bounds the separation of a face from above, because the separation
/// is the minimum of that expression over all vertices. If w lies deep in the body, one product discards a face.
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
        if bound < best.separation.max(floor) - BOUND_TOLERANCE * size || face == start {
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
