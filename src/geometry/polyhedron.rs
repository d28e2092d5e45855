//! Convex polyhedron in its principal frame.

use crate::math::Vec3;

/// Edge: its two vertices and the two faces that share it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Edge {
    /// End vertices, `vertices[0] < vertices[1]`.
    pub vertices: [u16; 2],
    /// Adjacent faces. `faces[0]` contains the edge from `vertices[0]` to `vertices[1]`, counter-clockwise seen from
    /// outside; `faces[1]` contains it in reverse.
    pub faces: [u16; 2],
}

/// Convex polyhedron, origin at its centre of mass, axes along its principal axes of inertia.
///
/// Coplanar triangles are merged: a face is a whole convex polygon. Lengths in m.
#[derive(Debug, Clone, PartialEq)]
pub struct Polyhedron {
    /// Vertices `[nv]`, m.
    pub vertices: Vec<Vec3>,
    /// Outward unit normals `[nf]`.
    pub face_normals: Vec<Vec3>,
    /// Offset `normal · x` of each face `[nf]`, m; positive.
    pub face_offsets: Vec<f64>,
    /// Start of each face in `face_vertices` `[nf + 1]`.
    pub face_starts: Vec<u32>,
    /// Vertices of the faces, counter-clockwise seen from outside.
    pub face_vertices: Vec<u16>,
    /// Edges `[ne]`, sorted by their vertices.
    pub edges: Vec<Edge>,
    /// Volume, m³.
    pub volume: f64,
    /// Principal moments of inertia for unit density, kg m² per kg/m³ = m⁵.
    pub unit_inertia: Vec3,
    /// Largest distance of a vertex from the origin, m.
    pub radius: f64,
}

impl Polyhedron {
    /// Returns the nominal diameter, m: that of the sphere of the same volume.
    pub fn nominal_diameter(&self) -> f64 {
        libm::cbrt(6.0 / std::f64::consts::PI * self.volume)
    }

    /// Returns the number of faces.
    pub fn face_count(&self) -> usize {
        self.face_normals.len()
    }

    /// Returns the vertices of face `f`, counter-clockwise seen from outside.
    pub fn face(&self, f: usize) -> &[u16] {
        &self.face_vertices[self.face_starts[f] as usize..self.face_starts[f + 1] as usize]
    }

    /// Returns the area of the surface, m².
    pub fn surface(&self) -> f64 {
        let of_face = |f: usize| {
            let face = self.face(f);
            let corner =
                |k: usize| self.vertices[face[k] as usize] - self.vertices[face[0] as usize];
            let sum: Vec3 = (1..face.len() - 1).map(|k| corner(k).cross(&corner(k + 1))).sum();
            0.5 * self.face_normals[f].dot(&sum)
        };
        (0..self.face_count()).map(of_face).sum()
    }

    /// Returns the polyhedron with all lengths multiplied by `factor`, which is above 0.
    pub fn scaled(&self, factor: f64) -> Self {
        let cube = factor * factor * factor;
        Self {
            vertices: self.vertices.iter().map(|v| v * factor).collect(),
            face_offsets: self.face_offsets.iter().map(|d| d * factor).collect(),
            volume: self.volume * cube,
            unit_inertia: self.unit_inertia * (cube * factor * factor),
            radius: self.radius * factor,
            ..self.clone()
        }
    }
}
