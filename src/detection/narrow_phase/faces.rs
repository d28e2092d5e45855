//! The face of a polyhedron that separates it best from another.

use super::cloud::Cloud;
use crate::geometry::Polyhedron;
use crate::math::Vec3;

/// A face normal as separating axis.
#[derive(Debug, Clone, Copy)]
pub struct FaceAxis {
    pub face: usize,
    /// Distance of the other body's nearest vertex above the face's plane, m; negative below.
    pub separation: f64,
}

/// The face that lies most in the direction `n`.
pub fn most_aligned(shape: &Polyhedron, n: &Vec3) -> usize {
    let mut best = (f64::NEG_INFINITY, 0);
    for (f, normal) in shape.face_normals.iter().enumerate() {
        let c = normal.dot(n);
        if c > best.0 {
            best = (c, f);
        }
    }
    best.1
}

/// The face of largest separation above `floor`, the lowest number among equals; `Err(face)` when
/// a face separates by more than `alert`.
///
/// `other` is the other body in the frame of `shape`. For any vertex w of the other body,
/// `n · w - d` bounds the separation of a face from above, because the separation is the minimum
/// of that expression over all vertices. With w deep in `shape` one product discards a face. The
/// bound is computed by the same operations as the minimum, so it holds to the bit, and the result
/// does not depend on `start`, where the search begins. If no face reaches `floor`, the
/// result is some face below it.
pub fn best_face(
    shape: &Polyhedron,
    other: &Cloud,
    start: usize,
    floor: f64,
    alert: f64,
) -> Result<FaceAxis, usize> {
    let n = &shape.face_normals[start];
    let low = other.lowest(n);
    let mut best = FaceAxis { face: start, separation: low - shape.face_offsets[start] };
    if best.separation > alert {
        return Err(start);
    }
    let mut witness = other.get(other.first_at(n, low));
    for (f, (n, d)) in shape.face_normals.iter().zip(&shape.face_offsets).enumerate() {
        let bound = (n.x * witness.x + n.y * witness.y + n.z * witness.z) - d;
        if bound < best.separation || bound < floor || f == start {
            continue;
        }
        let low = other.lowest(n);
        let separation = low - d;
        if separation > alert {
            return Err(f);
        }
        let better = separation > best.separation;
        if better || (separation == best.separation && f < best.face) {
            best = FaceAxis { face: f, separation };
        }
        if better {
            witness = other.get(other.first_at(n, low));
        }
    }
    Ok(best)
}

/// Whether `x`, in the frame of `shape`, is inside it or at most `tolerance` out of every face.
pub fn contains(shape: &Polyhedron, x: &Vec3, tolerance: f64) -> bool {
    shape.face_normals.iter().zip(&shape.face_offsets).all(|(n, d)| n.dot(x) - d <= tolerance)
}
