//! Bodies as polygons that are constant over the frames.
//!
//! Reads: model; the first frame's poses, which determine the drawn size of half-spaces.

use super::frame_data::single;
use ballast::geometry::{AxisBox, Polyhedron};
use ballast::math::{Pose, Vec3, frame};
use ballast::model::{DrivenBody, Model, Part, Role};

/// Group of bodies that viewers show or hide together.
#[derive(Debug, Clone)]
pub(crate) struct SurfaceMesh {
    pub name: &'static str,
    pub pieces: Vec<SurfacePiece>,
}

/// Polygons fixed to one body, in its frame.
#[derive(Debug, Clone)]
pub(crate) struct SurfacePiece {
    pub body: usize,
    /// Vertices of the polygons.
    pub corners: PolygonCorners,
}

#[derive(Debug, Clone)]
pub(crate) enum PolygonCorners {
    Shape {
        shape: usize,
        pose: Pose,
    },
    /// Vertices of one rectangle, m.
    Rectangle([Vec3; 4]),
}

/// Lower and upper corner of the box around all bodies of finite size, m.
pub(crate) type Extent = [Vec3; 2];

/// Names of the surfaces, in the order of the file.
const NAMES: [(&str, Option<Role>); 5] = [
    ("grains", None),
    ("sleepers", Some(Role::Sleeper)),
    ("tines", Some(Role::Tine)),
    ("plates", Some(Role::Plate)),
    ("boundary", Some(Role::Boundary)),
];

/// Returns true if results may have a surface with this name.
pub(crate) fn is_named(name: &str) -> bool {
    NAMES.iter().any(|(known, _)| *known == name)
}

/// Returns the surfaces of a model that are not empty.
pub(crate) fn all(model: &Model, poses: &[Pose], extent: &Extent) -> Vec<SurfaceMesh> {
    let ng = model.grains.len();
    let grain = |body: usize| SurfacePiece {
        body,
        corners: PolygonCorners::Shape {
            shape: model.grains.shape[body] as usize,
            pose: Pose::identity(),
        },
    };
    let surface = |(name, role): (&'static str, Option<Role>)| {
        let pieces = match role {
            None => (0..ng).map(grain).collect(),
            Some(role) => {
                let of_role = model.driven.iter().enumerate().filter(|(_, d)| d.role == role);
                of_role.flat_map(|(d, body)| driven(ng + d, body, &poses[ng + d], extent)).collect()
            }
        };
        SurfaceMesh { name, pieces }
    };
    NAMES.into_iter().map(surface).filter(|s| !s.pieces.is_empty()).collect()
}

fn driven(body: usize, driven: &DrivenBody, pose: &Pose, extent: &Extent) -> Vec<SurfacePiece> {
    let piece = |part: &Part| {
        let corners = match part {
            Part::Convex { shape, pose } => {
                PolygonCorners::Shape { shape: *shape as usize, pose: *pose }
            }
            Part::HalfSpace { normal, offset } => {
                PolygonCorners::Rectangle(rectangle(normal, *offset, pose, extent))
            }
        };
        SurfacePiece { body, corners }
    };
    driven.parts.iter().map(piece).collect()
}

/// Returns the part of a half-space's face next to the scene, in the body's frame.
fn rectangle(normal: &Vec3, offset: f64, pose: &Pose, extent: &Extent) -> [Vec3; 4] {
    let (t, s) = frame::tangents(normal);
    let mut low = [f64::INFINITY; 2];
    let mut high = [f64::NEG_INFINITY; 2];
    for corner in 0..8 {
        let pick = |k: usize| extent[corner >> k & 1][k];
        let local = pose.inverse_point(&Vec3::new(pick(0), pick(1), pick(2)));
        for (k, along) in [local.dot(&t), local.dot(&s)].into_iter().enumerate() {
            low[k] = low[k].min(along);
            high[k] = high[k].max(along);
        }
    }
    let at = |a: f64, b: f64| normal * offset + t * a + s * b;
    [at(low[0], low[1]), at(high[0], low[1]), at(high[0], high[1]), at(low[0], high[1])]
}

/// Returns the box around all grains, or around the origins of all bodies without grains.
pub(crate) fn extent(model: &Model, poses: &[Pose]) -> Extent {
    let ng = model.grains.len();
    let radius = |b: usize| match model.grains.shape.get(b) {
        Some(&shape) => model.shapes[shape as usize].radius,
        None => 0.0,
    };
    let bodies = if ng > 0 { 0..ng } else { 0..poses.len() };
    let AxisBox { low, high } = AxisBox::around(bodies.flat_map(|b| {
        let reach = Vec3::repeat(radius(b));
        [poses[b].position - reach, poses[b].position + reach]
    }));
    if poses.is_empty() { [Vec3::zeros(); 2] } else { [low, high] }
}

impl SurfaceMesh {
    /// Returns the starts of the polygons `[nf + 1]`, their corners, and the body of each `[nf]`.
    pub fn topology(&self, shapes: &[Polyhedron]) -> (Vec<i64>, Vec<i64>, Vec<i32>) {
        let (mut starts, mut corners, mut bodies) = (vec![0], vec![], vec![]);
        let mut first = 0;
        let mut polygon = |body: usize, polygon: &mut dyn Iterator<Item = i64>| {
            corners.extend(polygon);
            starts.push(corners.len() as i64);
            bodies.push(body as i32);
        };
        for piece in &self.pieces {
            match &piece.corners {
                PolygonCorners::Shape { shape, .. } => {
                    let shape = &shapes[*shape];
                    for f in 0..shape.face_count() {
                        let face = shape.face(f).iter().map(|&v| first + i64::from(v));
                        polygon(piece.body, &mut { face });
                    }
                    first += shape.vertices.len() as i64;
                }
                PolygonCorners::Rectangle(_) => {
                    polygon(piece.body, &mut (first..first + 4));
                    first += 4;
                }
            }
        }
        (starts, corners, bodies)
    }

    /// Returns the number of polygons of each piece, with its body.
    pub fn faces<'a>(
        &'a self,
        shapes: &'a [Polyhedron],
    ) -> impl Iterator<Item = (usize, usize)> + 'a {
        self.pieces.iter().map(|piece| match &piece.corners {
            PolygonCorners::Shape { shape, .. } => (piece.body, shapes[*shape].face_count()),
            PolygonCorners::Rectangle(_) => (piece.body, 1),
        })
    }

    /// Returns all corners in world axes, m.
    pub fn points(&self, shapes: &[Polyhedron], poses: &[Pose]) -> Vec<[f32; 3]> {
        let mut points = vec![];
        for piece in &self.pieces {
            let body = &poses[piece.body];
            match &piece.corners {
                PolygonCorners::Shape { shape, pose } => {
                    let pose = body.then(pose);
                    let corners = &shapes[*shape].vertices;
                    points.extend(corners.iter().map(|v| single(&pose.point(v))));
                }
                PolygonCorners::Rectangle(corners) => {
                    points.extend(corners.iter().map(|v| single(&body.point(v))));
                }
            }
        }
        points
    }
}
