//! The face of a polyhedron that separates it best from another.

use super::pair::Faces;

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
pub fn best_of_all(
    faces: &Faces,
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
