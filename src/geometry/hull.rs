//! Convex polyhedra from points, with whole faces, exact mass properties and principal axes.
//!
//! Reads: points. Writes: a [`Polyhedron`] and the pose of its frame. Cost: O(n log n) for the hull, O(faces ·
//! points) for merging and checking. Contract: the result is a closed convex surface (V − E + F = 2, all points under
//! all faces); anything else is an error.

use super::clip::AxisBox;
use super::faces::{self, Surface};
use super::mass_properties::{mass_properties, principal_axes};
use super::polyhedron::{Edge, Polyhedron};
use crate::error::{Error, Result};
use crate::math::{Mat3, Pose, Quat, Vec3};
use parry3d_f64::math::Vector;
use parry3d_f64::transformation::try_convex_hull;

/// Distances within which points count as coplanar, in half sizes of the body, in order of trial.
///
/// 1e-7 is a few nm on a ballast grain, and above the rounding of coordinates stored as f32 near the origin. If
/// coplanarity is ambiguous at one tolerance, another one decides.
const TOLERANCES: [f64; 7] = [1e-7, 2e-8, 4e-9, 5e-7, 2e-6, 1e-10, 1e-12];
/// Maximum number of points, whose numbers are u16.
const MAX_POINTS: usize = u16::MAX as usize;
/// Maximum number of vertices of a hull; the check that all points are under all faces is quadratic.
const MAX_CORNERS: usize = 4096;
/// Maximum number of points for gift wrapping, which is cubic in the worst case.
const MAX_WRAPPED_POINTS: usize = 512;
/// Minimum volume, over the cube of the half size; below it points count as flat.
const MIN_VOLUME: f64 = 1e-7;
/// Half sizes (m) for which products of five lengths neither overflow nor underflow.
const HALF_SIZE_RANGE: [f64; 2] = [1e-9, 1e9];

/// Returns the convex hull of `points` (m), and the pose of its principal frame in the frame of the points.
///
/// Coplanar triangles are merged to whole faces; points inside faces or edges are dropped. Axes are kept if the
/// inertia tensor is already diagonal.
///
/// # Errors
/// [`Error::Geometry`] for fewer than 4 or more than 65 535 points, coordinates that are not finite, flat points,
/// extreme sizes, and hulls of more than 4096 vertices.
pub fn convex_hull(points: &[Vec3]) -> Result<(Polyhedron, Pose)> {
    let (middle, scale) = extent(points)?;
    let scaled: Vec<Vec3> = points.iter().map(|p| (p - middle) / scale).collect();
    let triangulated = triangulate(&scaled)?;
    for tolerance in TOLERANCES {
        let merged = triangulated.as_ref().and_then(|(corners, triangles)| {
            let (corners, triangles) = fuse(corners, triangles, tolerance);
            let surface = faces::merge(&corners, &triangles, tolerance)?;
            finish(corners, surface, &scaled, tolerance, scale)
        });
        // Hulls of nearly coplanar points may lack a sliver: then wrap the points themselves.
        let found = merged.or_else(|| {
            if scaled.len() > MAX_WRAPPED_POINTS {
                return None;
            }
            let (corners, _) = fuse(&scaled, &[], tolerance);
            let surface = faces::wrap(&corners, tolerance)?;
            finish(corners, surface, &scaled, tolerance, scale)
        });
        if let Some((polyhedron, local)) = found {
            let position = middle + local.position * scale;
            return Ok((polyhedron, Pose { position, ..local }));
        }
    }
    let found =
        format!("{} points that are flat, or nearly so, in places or as a whole", points.len());
    Err(bad("points that span a volume under well separated faces", found))
}

/// Returns a box with the given half sizes (m, all positive), axes and centre kept exactly.
pub fn cuboid(half: Vec3) -> Polyhedron {
    let corner = |i: usize, k: usize| if i >> k & 1 == 0 { -half[k] } else { half[k] };
    let vertices = (0..8).map(|i| Vec3::new(corner(i, 0), corner(i, 1), corner(i, 2))).collect();
    const FACES: [[u16; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    const EDGES: [[u16; 4]; 12] = [
        [0, 1, 2, 4],
        [0, 2, 4, 0],
        [0, 4, 0, 2],
        [1, 3, 1, 4],
        [1, 5, 2, 1],
        [2, 3, 4, 3],
        [2, 6, 3, 0],
        [3, 7, 1, 3],
        [4, 5, 5, 2],
        [4, 6, 0, 5],
        [5, 7, 5, 1],
        [6, 7, 3, 5],
    ];
    let side = |k: usize| if k.is_multiple_of(2) { -1.0 } else { 1.0 };
    let squares = half.component_mul(&half);
    let volume = 8.0 * half.x * half.y * half.z;
    Polyhedron {
        vertices,
        face_normals: (0..6).map(|k| Vec3::ith(k / 2, side(k))).collect(),
        face_offsets: (0..6).map(|k| half[k / 2]).collect(),
        face_starts: (0..=6).map(|k| 4 * k).collect(),
        face_vertices: FACES.concat(),
        edges: EDGES.map(|[a, b, f, g]| Edge { vertices: [a, b], faces: [f, g] }).to_vec(),
        volume,
        unit_inertia: Vec3::new(
            squares.y + squares.z,
            squares.z + squares.x,
            squares.x + squares.y,
        ) * (volume / 3.0),
        radius: half.norm(),
    }
}

/// Returns the middle of the bounding box and a power of two near its half diagonal; scaling by it is exact.
fn extent(points: &[Vec3]) -> Result<(Vec3, f64)> {
    if !(4..=MAX_POINTS).contains(&points.len()) {
        return Err(bad("4 to 65535 points", points.len().to_string()));
    }
    if let Some(k) = points.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
        return Err(bad("finite coordinates", format!("{:?} at point {k}", points[k].as_slice())));
    }
    let AxisBox { low, high } = AxisBox::around(points.iter().copied());
    let half = (high - low).norm() / 2.0;
    if !(HALF_SIZE_RANGE[0]..=HALF_SIZE_RANGE[1]).contains(&half) {
        return Err(bad("a half size of 1e-9 to 1e9 m", format!("{half:e} m")));
    }
    // The exponent alone, without a logarithm that differs between platforms.
    let power_of_two = f64::from_bits(half.to_bits() & 0x7ff0_0000_0000_0000);
    Ok(((low + high) / 2.0, power_of_two))
}

/// Vertices and triangles of a hull.
type Triangulation = (Vec<Vec3>, Vec<[u16; 3]>);

/// Returns vertices and triangles of the hull; `None` if the library finds no valid one.
fn triangulate(points: &[Vec3]) -> Result<Option<Triangulation>> {
    let input: Vec<Vector> = points.iter().map(|p| Vector::new(p.x, p.y, p.z)).collect();
    let Ok((corners, triangles)) = try_convex_hull(&input) else { return Ok(None) };
    if corners.len() > MAX_CORNERS {
        return Err(bad("a hull of at most 4096 corners", corners.len().to_string()));
    }
    let corners = corners.iter().map(|p| Vec3::new(p.x, p.y, p.z)).collect();
    Ok(Some((corners, triangles.iter().map(|t| t.map(|k| k as u16)).collect())))
}

/// Merges vertices closer than `tolerance`; triangles that collapse are dropped.
fn fuse(points: &[Vec3], triangles: &[[u16; 3]], tolerance: f64) -> Triangulation {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_by(|&a, &b| points[a].x.total_cmp(&points[b].x));
    let mut same: Vec<usize> = (0..points.len()).collect();
    for (k, &i) in order.iter().enumerate() {
        let near = order[..k].iter().rev().take_while(|&&j| points[i].x - points[j].x <= tolerance);
        for &j in near {
            if same[j] == j && (points[i] - points[j]).norm() <= tolerance {
                same[i] = j;
                break;
            }
        }
    }
    let mut index = vec![0u16; points.len()];
    let mut kept = Vec::new();
    for i in 0..points.len() {
        if same[i] == i {
            index[i] = kept.len() as u16;
            kept.push(points[i]);
        }
    }
    let triangles = triangles
        .iter()
        .map(|t| t.map(|k| index[same[k as usize]]))
        .filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0])
        .collect();
    (kept, triangles)
}

/// Returns the polyhedron of a closed surface and its frame; `None` if it is flat or a point is outside.
fn finish(
    corners: Vec<Vec3>,
    surface: Surface,
    points: &[Vec3],
    tolerance: f64,
    scale: f64,
) -> Option<(Polyhedron, Pose)> {
    let mass = mass_properties(&corners, surface.faces.iter().map(Vec::as_slice))?;
    if mass.volume < MIN_VOLUME {
        return None;
    }
    let normals: Vec<Vec3> =
        surface.faces.iter().map(|face| polygon_normal(&corners, face)).collect::<Option<_>>()?;
    let centre = snap(mass.centre);
    let (moments, axes) = principal_axes(&mass.inertia);
    let offsets: Vec<f64> = surface
        .faces
        .iter()
        .zip(&normals)
        .map(|(face, n)| {
            let sum: f64 = face.iter().map(|&v| n.dot(&(corners[v as usize] - centre))).sum();
            sum / face.len() as f64
        })
        .collect();
    let under = |p: &Vec3| {
        normals.iter().zip(&offsets).all(|(n, d)| n.dot(&(p - centre)) <= d + 4.0 * tolerance)
    };
    if !points.iter().all(under) || !offsets.iter().all(|&d| d > 0.0) {
        return None;
    }
    let turn = axes.transpose();
    let (index, kept) = renumber(&corners, &surface);
    let vertices: Vec<Vec3> = kept.iter().map(|p| turn * (p - centre) * scale).collect();
    let mut starts = vec![0u32];
    let mut face_vertices = Vec::new();
    for face in &surface.faces {
        face_vertices.extend(face.iter().map(|&v| index[v as usize]));
        starts.push(face_vertices.len() as u32);
    }
    let edges = surface
        .edges
        .iter()
        .map(|e| Edge { vertices: e.vertices.map(|v| index[v as usize]), faces: e.faces })
        .collect();
    let polyhedron = Polyhedron {
        radius: vertices.iter().map(Vec3::norm).fold(0.0, f64::max),
        vertices,
        face_normals: normals.iter().map(|n| turn * n).collect(),
        face_offsets: offsets.iter().map(|d| d * scale).collect(),
        face_starts: starts,
        face_vertices,
        edges,
        volume: mass.volume * scale.powi(3),
        unit_inertia: moments * scale.powi(5),
    };
    Some((polyhedron, Pose { position: centre, orientation: rotation(&axes) }))
}

/// Returns the area-weighted unit normal of a polygon.
fn polygon_normal(corners: &[Vec3], face: &[u16]) -> Option<Vec3> {
    let a = corners[face[0] as usize];
    let sum = face[1..].windows(2).fold(Vec3::zeros(), |sum, w| {
        sum + (corners[w[0] as usize] - a).cross(&(corners[w[1] as usize] - a))
    });
    sum.try_normalize(f64::MIN_POSITIVE)
}

/// Removes rounding that would shift the exact coordinates of symmetric bodies.
fn snap(centre: Vec3) -> Vec3 {
    centre.map(|x| if x.abs() < 1e-14 { 0.0 } else { x })
}

fn rotation(axes: &Mat3) -> Quat {
    if *axes == Mat3::identity() {
        return Quat::identity();
    }
    Quat::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(*axes))
}

/// Returns new numbers of the used vertices and these vertices, in their old order.
fn renumber(corners: &[Vec3], surface: &Surface) -> (Vec<u16>, Vec<Vec3>) {
    let mut used = vec![false; corners.len()];
    surface.faces.iter().flatten().for_each(|&v| used[v as usize] = true);
    let mut index = vec![0; corners.len()];
    let mut kept = Vec::new();
    for (i, p) in corners.iter().enumerate().filter(|(i, _)| used[*i]) {
        index[i] = kept.len() as u16;
        kept.push(*p);
    }
    (index, kept)
}

fn bad(expected: &'static str, found: String) -> Error {
    Error::Geometry { expected, found }
}

#[cfg(test)]
#[path = "hull_tests.rs"]
mod tests;
