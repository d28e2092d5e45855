//! Coordinates along a contact axis: frames, planes and edges of both bodies in them.

use super::cache::IndexList;
use super::pair::{BodyPair, SLAB, larger, smaller};
use crate::geometry::Polyhedron;
use crate::math::{Vec3, frame};

/// Maximum slope along the axis of a face that counts as a side of the body.
pub const MIN_SLOPE: f64 = 1e-9;

/// Axis and bounds of a search for corners of the gap.
#[derive(Debug, Clone, Copy)]
pub struct ContactAxis {
    /// Unit vector from A to B, in the frame of A.
    pub normal: Vec3,
    /// Largest gap of interest, m.
    pub alert: f64,
    /// Separation along the axis minus rounding, m; no corner's gap is below it.
    pub lowest: f64,
    /// Maximum distance of the feet of a corner from the support planes, m.
    pub slab: f64,
    /// Maximum distance beside a face at which a vertex still counts as over it, m.
    pub tolerance: f64,
}

impl ContactAxis {
    /// Returns the largest distance between the feet of a corner, m.
    pub fn max_foot_distance(&self) -> f64 {
        self.alert.max(self.slab - self.alert)
    }

    /// Returns the coordinates of the axis for points of A and of B.
    pub fn frames(&self, pair: &BodyPair) -> [AxisFrame; 2] {
        let (t, s) = frame::tangents(&self.normal);
        let axes = [t, s, self.normal];
        let of_b = AxisFrame {
            axes: [pair.in_b(&t), pair.in_b(&s), pair.in_b(&self.normal)],
            origin: [t.dot(&pair.offset), s.dot(&pair.offset), self.normal.dot(&pair.offset)],
            into: 1.0,
        };
        [AxisFrame { axes, origin: [0.0; 3], into: -1.0 }, of_b]
    }
}

/// Bound on the relative motion of two bodies: displacement where they face each other (m) and rotation (rad).
///
/// The rotation bounds both that of the bodies and that of the axis in A.
#[derive(Debug, Clone, Copy)]
pub struct MotionBound {
    pub displacement: f64,
    pub rotation: f64,
}

impl MotionBound {
    /// Returns the bound for the present configuration alone, which covers rounding.
    pub fn none(pair: &BodyPair) -> Self {
        Self { displacement: SLAB * pair.size, rotation: 1e-9 }
    }
}

/// Coordinates across and along the axis, for points of one body's frame.
pub struct AxisFrame {
    /// Two directions across the axis, and the axis.
    pub axes: [Vec3; 3],
    /// Coordinates of the body's origin, m.
    pub origin: [f64; 3],
    /// Sign of the axis direction that leads from the other body into this one.
    pub into: f64,
}

impl AxisFrame {
    #[inline]
    pub fn place(&self, x: &Vec3) -> [f64; 3] {
        let ([t, s, n], [o, p, q]) = (&self.axes, &self.origin);
        [t.dot(x) + o, s.dot(x) + p, n.dot(x) + q]
    }

    /// Returns edge `index` in these coordinates.
    #[inline]
    pub fn segment(&self, shape: &Polyhedron, index: usize) -> ProjectedEdge {
        let [start, end] = shape.edges[index].vertices;
        ProjectedEdge::between(
            self.place(&shape.vertices[start as usize]),
            self.place(&shape.vertices[end as usize]),
        )
    }

    /// True if a face of edge `index` is towards the other body.
    ///
    /// An edge of the far side is never a corner: the body's own surface is between it and the other one.
    pub fn is_facing(&self, shape: &Polyhedron, index: usize) -> bool {
        let into = self.axes[2] * self.into;
        let [left, right] = shape.edges[index].faces;
        let slope = |f: u16| shape.face_normals[usize::from(f)].dot(&into);
        smaller(slope(left), slope(right)) < -MIN_SLOPE
    }

    /// True if an edge of vertex `v` faces the other body.
    pub fn has_facing_edge(&self, shape: &Polyhedron, v: usize) -> bool {
        let mut edges = shape.edges.iter().enumerate();
        edges.any(|(e, edge)| {
            edge.vertices.iter().any(|w| usize::from(*w) == v) && self.is_facing(shape, e)
        })
    }

    /// Returns the distance from `x` along the axis to the point where the line enters the body, negative behind `x`.
    ///
    /// `None` if the line passes by more than `tolerance` beside the body. The faces `below` decide.
    #[inline]
    pub fn distance(
        &self,
        shape: &Polyhedron,
        below: &DecidingFaces,
        x: &Vec3,
        tolerance: f64,
    ) -> Option<f64> {
        if below.is_complete() {
            distance_along(self.planes(shape, below.iter()), x, tolerance)
        } else {
            distance_along(self.planes(shape, 0..shape.face_count()), x, tolerance)
        }
    }

    /// Iterates over planes of the body.
    #[inline]
    pub fn planes(
        &self,
        shape: &Polyhedron,
        faces: impl Iterator<Item = usize>,
    ) -> impl Iterator<Item = FacePlane> {
        let into = self.axes[2] * self.into;
        faces.map(move |f| {
            let normal = shape.face_normals[f];
            FacePlane { normal, offset: shape.face_offsets[f], slope: normal.dot(&into) }
        })
    }
}

/// Plane of a face, and its slope along the axis into the body.
#[derive(Debug, Clone, Copy)]
pub struct FacePlane {
    pub normal: Vec3,
    pub offset: f64,
    pub slope: f64,
}

impl FacePlane {
    /// Returns the depth of a point below the plane, m.
    #[inline]
    pub fn depth(&self, x: &Vec3) -> f64 {
        let n = &self.normal;
        self.offset - (n.x * x.x + n.y * x.y + n.z * x.z)
    }
}

/// Returns the distance from `x` along the axis to the point where the line enters the body, negative behind `x`.
///
/// `None` if the line passes by more than `tolerance` beside the body.
#[inline]
fn distance_along(
    planes: impl Iterator<Item = FacePlane>,
    x: &Vec3,
    tolerance: f64,
) -> Option<f64> {
    let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
    for plane in planes {
        let depth = plane.depth(x);
        if plane.slope < -MIN_SLOPE {
            enter = larger(depth / plane.slope, enter);
        } else if plane.slope > MIN_SLOPE {
            leave = smaller((depth + tolerance) / plane.slope, leave);
        } else if depth < -tolerance {
            return None;
        }
    }
    (enter <= leave + tolerance).then_some(enter)
}

/// Faces that decide where a line along the axis enters the body, or a mark that they were too many.
pub type DecidingFaces = IndexList<5>;

/// Edge with two coordinates across the axis and one along it.
#[derive(Debug, Clone, Copy, Default)]
pub struct ProjectedEdge {
    pub start: [f64; 3],
    pub along: [f64; 3],
}

impl ProjectedEdge {
    #[inline]
    pub fn between(start: [f64; 3], end: [f64; 3]) -> Self {
        Self { start, along: [end[0] - start[0], end[1] - start[1], end[2] - start[2]] }
    }

    #[inline]
    pub fn at(&self, parameter: f64) -> [f64; 3] {
        let Self { start: [x, y, z], along: [u, v, w] } = self;
        [x + u * parameter, y + v * parameter, z + w * parameter]
    }
}
