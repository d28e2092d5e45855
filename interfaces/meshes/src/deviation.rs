//! Distances between convex parts and the surface that they stand for.

use crate::TriangleMesh;
use ballast::geometry::Polyhedron;
use ballast::math::{Pose, Vec3};
use parry3d_f64::math::Vector;
use parry3d_f64::query::PointQuery;
use parry3d_f64::shape::{TriMesh, TriMeshFlags};

/// Number of points along the longest side of the body, on its triangles.
const POINTS_ALONG: f64 = 60.0;

/// Returns the largest distance of `parts` outside of all `shells`, and that of the shells outside of all parts.
///
/// Both are measured at points on the surfaces. `None` if the library takes a surface for damaged.
pub fn deviation(shells: &[TriangleMesh], parts: &[(Polyhedron, Pose)]) -> Option<[f64; 2]> {
    let parts: Vec<TriangleMesh> = parts.iter().map(surface).collect();
    let size = shells.iter().flat_map(|s| &s.points).map(Vec3::amax).fold(0.0, f64::max);
    let largest = |from: &[TriangleMesh], to: &[TriangleMesh]| {
        let solids: Vec<TriMesh> = to.iter().map(solid).collect::<Option<_>>()?;
        let distance = |p: &Vec3| {
            let p = Vector::new(p.x, p.y, p.z);
            // Not negative inside.
            let outside = |s: &TriMesh| s.distance_to_local_point(p, false).max(0.0);
            solids.iter().map(outside).fold(f64::INFINITY, f64::min)
        };
        let triangles = from.iter().flat_map(TriangleMesh::corners);
        let points = triangles.flat_map(|t| points_on(t, size / POINTS_ALONG));
        Some(points.map(|p| distance(&p)).fold(0.0, f64::max))
    };
    Some([largest(&parts, shells)?, largest(shells, &parts)?])
}

fn surface((part, pose): &(Polyhedron, Pose)) -> TriangleMesh {
    let faces = (0..part.face_count()).map(|f| part.face(f));
    let fan = |face: &[u16]| -> Vec<[usize; 3]> {
        (2..face.len()).map(|k| [face[0], face[k - 1], face[k]].map(usize::from)).collect()
    };
    TriangleMesh {
        points: part.vertices.iter().map(|v| pose.point(v)).collect(),
        triangles: faces.flat_map(fan).collect(),
    }
}

fn solid(mesh: &TriangleMesh) -> Option<TriMesh> {
    let points = mesh.points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let triangles = mesh.triangles.iter().map(|t| t.map(|k| k as u32)).collect();
    TriMesh::with_flags(points, triangles, TriMeshFlags::ORIENTED).ok()
}

/// Returns the corners of a triangle, and points between them where the sides are longer than `spacing`.
fn points_on([a, b, c]: [Vec3; 3], spacing: f64) -> impl Iterator<Item = Vec3> {
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    let count = (longest / spacing).ceil().clamp(1.0, POINTS_ALONG) as u32;
    (0..=count).flat_map(move |i| {
        (0..=count - i).map(move |j| {
            let [u, v] = [i, j].map(|k| f64::from(k) / f64::from(count));
            a + (b - a) * u + (c - a) * v
        })
    })
}
