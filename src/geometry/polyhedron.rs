//! A convex polyhedron in its principal frame.

use crate::math::Vec3;

/// An edge: its two vertices and the two faces that share it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Edge {
    /// `vertices[0] < vertices[1]`.
    pub vertices: [u16; 2],
    /// `faces[0]` runs through the edge from `vertices[0]` to `vertices[1]`, counter-clockwise seen
    /// from outside; `faces[1]` runs back.
    pub faces: [u16; 2],
}

/// A convex polyhedron, origin at its centre of mass, axes along its principal axes of inertia.
///
/// Coplanar triangles are merged: a face is a whole convex polygon. Lengths in m.
#[derive(Debug, Clone, PartialEq)]
pub struct Polyhedron {
    /// Corners `[nv]`, m.
    pub vertices: Vec<Vec3>,
    /// Outward unit normals `[nf]`.
    pub face_normals: Vec<Vec3>,
    /// `normal · x` on each face `[nf]`, m; positive.
    pub face_offsets: Vec<f64>,
    /// Where each face starts in `face_vertices` `[nf + 1]`.
    pub face_starts: Vec<u32>,
    /// Corners of the faces, counter-clockwise seen from outside.
    pub face_vertices: Vec<u16>,
    /// Edges `[ne]`, sorted by their vertices.
    pub edges: Vec<Edge>,
    /// m³.
    pub volume: f64,
    /// Principal moments of inertia for unit density, kg m² per kg/m³ = m⁵.
    pub unit_inertia: Vec3,
    /// Largest distance of a vertex from the origin, m.
    pub radius: f64,
}

impl Polyhedron {
    /// Nominal diameter, m: that of the sphere of the same volume.
    pub fn nominal_diameter(&self) -> f64 {
        libm::cbrt(6.0 / std::f64::consts::PI * self.volume)
    }

    /// Number of faces.
    pub fn face_count(&self) -> usize {
        self.face_normals.len()
    }

    /// Corners of face `f`, counter-clockwise seen from outside.
    pub fn face(&self, f: usize) -> &[u16] {
        &self.face_vertices[self.face_starts[f] as usize..self.face_starts[f + 1] as usize]
    }
}
