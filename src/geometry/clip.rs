//! Exact volume of the part of a polyhedron inside half-spaces, mainly inside boxes.
//!
//! Reads: a polyhedron, its pose, half-spaces. Writes: only its own buffers, which it reuses. Cost: a comparison per
//! half-space for bodies wholly inside or outside, else O(vertices) per half-space that cuts. Contract: errors are
//! rounding, relative to the volume of the whole polyhedron; parts that share a cutting plane add up to the whole.

use super::polyhedron::Polyhedron;
use crate::math::{Pose, Vec3};

/// Half-space `normal · x <= offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HalfSpace {
    /// Outward unit normal.
    pub normal: Vec3,
    /// Offset along the normal, m.
    pub offset: f64,
}

impl HalfSpace {
    /// Returns the half-space of a body at `pose`, in world axes.
    pub fn at(&self, pose: &Pose) -> Self {
        let normal = pose.orientation * self.normal;
        Self { normal, offset: self.offset + normal.dot(&pose.position) }
    }

    /// Returns the other side of the same plane.
    pub fn flipped(&self) -> Self {
        Self { normal: -self.normal, offset: -self.offset }
    }
}

/// Box along the axes of the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisBox {
    /// Vertex of minimum coordinates, m.
    pub low: Vec3,
    /// Vertex of maximum coordinates, m.
    pub high: Vec3,
}

impl AxisBox {
    /// Returns the smallest box around points; from infinity to minus infinity without points.
    pub fn around(points: impl IntoIterator<Item = Vec3>) -> Self {
        let nothing =
            Self { low: Vec3::repeat(f64::INFINITY), high: Vec3::repeat(f64::NEG_INFINITY) };
        points.into_iter().fold(nothing, |b, p| Self { low: b.low.inf(&p), high: b.high.sup(&p) })
    }

    /// True if the boxes have a common point.
    pub fn meets(&self, other: &Self) -> bool {
        self.low.x <= other.high.x
            && other.low.x <= self.high.x
            && self.low.y <= other.high.y
            && other.low.y <= self.high.y
            && self.low.z <= other.high.z
            && other.low.z <= self.high.z
    }

    /// Returns the volume, m³; zero if a side is not positive.
    pub fn volume(&self) -> f64 {
        (self.high - self.low).map(|x| x.max(0.0)).product()
    }

    /// Returns the six half-spaces of the box.
    pub fn half_spaces(&self) -> [HalfSpace; 6] {
        std::array::from_fn(|k| {
            let axis = Vec3::ith(k / 2, 1.0);
            if k.is_multiple_of(2) {
                HalfSpace { normal: -axis, offset: -self.low[k / 2] }
            } else {
                HalfSpace { normal: axis, offset: self.high[k / 2] }
            }
        })
    }

    /// True if a point is inside or on the surface.
    pub fn contains(&self, p: &Vec3) -> bool {
        (0..3).all(|k| self.low[k] <= p[k] && p[k] <= self.high[k])
    }
}

/// Returns the half-spaces, in world axes, whose intersection is `polyhedron` at `pose`.
pub fn half_spaces_of(polyhedron: &Polyhedron, pose: &Pose) -> Vec<HalfSpace> {
    let faces = polyhedron.face_normals.iter().zip(&polyhedron.face_offsets);
    faces.map(|(normal, offset)| HalfSpace { normal: *normal, offset: *offset }.at(pose)).collect()
}

/// Polygons, counter-clockwise seen from outside.
#[derive(Debug, Clone, Default)]
struct PolygonSoup {
    corners: Vec<Vec3>,
    ends: Vec<usize>,
}

/// Polyhedron clipper that reuses its buffers.
#[derive(Debug, Clone, Default)]
pub struct Clipper {
    surface: PolygonSoup,
    clipped: PolygonSoup,
    /// Points where the clipped polygons leave the half-space and return `[cut polygons]`.
    cuts: Vec<[Vec3; 2]>,
    heights: Vec<f64>,
}

impl Clipper {
    /// Returns the volume of `polyhedron` at `pose` inside all `half_spaces` (world axes), m³.
    pub fn volume_inside(
        &mut self,
        polyhedron: &Polyhedron,
        pose: &Pose,
        half_spaces: &[HalfSpace],
    ) -> f64 {
        let back = pose.orientation.inverse();
        let mut whole = true;
        for half_space in half_spaces {
            let depth = half_space.offset - half_space.normal.dot(&pose.position);
            if depth >= polyhedron.radius {
                continue;
            }
            if depth <= -polyhedron.radius {
                return 0.0;
            }
            // In the body's frame coordinates are no larger than the body.
            let normal = back * half_space.normal;
            let (mut lowest, mut highest) = (f64::MAX, f64::MIN);
            for v in &polyhedron.vertices {
                let height = normal.dot(v);
                (lowest, highest) = (lowest.min(height), highest.max(height));
            }
            if highest <= depth {
                continue;
            }
            if lowest >= depth {
                return 0.0;
            }
            if whole {
                self.load(polyhedron);
                whole = false;
            }
            self.cut(&normal, depth);
        }
        if whole {
            return polyhedron.volume;
        }
        let volume = self.surface.volume();
        if volume <= 0.0 { 0.0 } else { volume }
    }

    /// Returns the volume of `polyhedron` at `pose` inside `half_spaces` and outside all convex `obstacles`, m³.
    ///
    /// Obstacles may overlap. Exact: the region outside an obstacle is split into convex pieces, the k-th below its
    /// first k faces and above the next. Cost grows with the number of obstacles that overlap at the same place, not
    /// with their total.
    pub fn volume_outside(
        &mut self,
        polyhedron: &Polyhedron,
        pose: &Pose,
        half_spaces: &mut Vec<HalfSpace>,
        obstacles: &[Vec<HalfSpace>],
    ) -> f64 {
        let known = half_spaces.len();
        let left = self.volume_inside(polyhedron, pose, half_spaces);
        // Slivers of rounding would otherwise branch like real pieces.
        if left <= 1e-15 * polyhedron.volume {
            return 0.0;
        }
        let Some((first, rest)) = obstacles.split_first() else { return left };
        half_spaces.extend_from_slice(first);
        let shared = self.volume_inside(polyhedron, pose, half_spaces);
        half_spaces.truncate(known);
        if shared <= 1e-15 * polyhedron.volume {
            return self.volume_outside(polyhedron, pose, half_spaces, rest);
        }
        let mut sum = 0.0;
        for face in first {
            half_spaces.push(face.flipped());
            sum += self.volume_outside(polyhedron, pose, half_spaces, rest);
            half_spaces.pop();
            half_spaces.push(*face);
        }
        half_spaces.truncate(known);
        sum
    }

    fn load(&mut self, polyhedron: &Polyhedron) {
        let PolygonSoup { corners, ends } = &mut self.surface;
        corners.clear();
        corners.extend(polyhedron.face_vertices.iter().map(|&v| polyhedron.vertices[v as usize]));
        ends.clear();
        ends.extend(polyhedron.face_starts[1..].iter().map(|&e| e as usize));
    }

    /// Keeps the part below `normal · x = offset` and closes the cut.
    fn cut(&mut self, normal: &Vec3, offset: f64) {
        let Self { surface, clipped, cuts, heights } = self;
        clipped.corners.clear();
        clipped.ends.clear();
        cuts.clear();
        heights.clear();
        heights.extend(surface.corners.iter().map(|v| normal.dot(v) - offset));
        let mut start = 0;
        for &end in &surface.ends {
            clip_polygon(&surface.corners[start..end], &heights[start..end], clipped, cuts);
            start = end;
        }
        // The lid is a fan: the order of the cuts does not matter, and later cuts treat its triangles like any other
        // polygon.
        if let Some(&[apex, _]) = cuts.first() {
            for &[left, returned] in cuts[1..].iter() {
                clipped.corners.extend([apex, returned, left]);
                clipped.ends.push(clipped.corners.len());
            }
        }
        std::mem::swap(surface, clipped);
    }
}

/// Appends the part of a convex polygon below zero height, and the points where it leaves and returns.
///
/// It may leave more than once if it lies in the cut except for rounding.
fn clip_polygon(
    polygon: &[Vec3],
    heights: &[f64],
    kept: &mut PolygonSoup,
    cuts: &mut Vec<[Vec3; 2]>,
) {
    let before = kept.corners.len();
    // Points where it has left, and where it has returned before the first vertex.
    let (mut left, mut first) = (None, None);
    for k in 0..polygon.len() {
        let next = if k + 1 == polygon.len() { 0 } else { k + 1 };
        let (a, b) = (heights[k], heights[next]);
        if a <= 0.0 {
            kept.corners.push(polygon[k]);
        }
        // Interpolated from inside to outside, so that both polygons at an edge find the same point.
        if a <= 0.0 && b > 0.0 {
            let p = polygon[k] + (polygon[next] - polygon[k]) * (a / (a - b));
            left = Some(p);
            kept.corners.push(p);
        } else if a > 0.0 && b <= 0.0 {
            let p = polygon[next] + (polygon[k] - polygon[next]) * (b / (b - a));
            match left.take() {
                Some(left) => cuts.push([left, p]),
                None => first = Some(p),
            }
            kept.corners.push(p);
        }
    }
    if let (Some(left), Some(first)) = (left, first) {
        cuts.push([left, first]);
    }
    if kept.corners.len() > before {
        kept.ends.push(kept.corners.len());
    }
}

impl PolygonSoup {
    /// Returns the volume within the closed surface, m³.
    fn volume(&self) -> f64 {
        let (mut volume, mut start) = (0.0, 0);
        for &end in &self.ends {
            let polygon = &self.corners[start..end];
            let a = polygon[0];
            for pair in polygon[1..].windows(2) {
                volume += a.dot(&pair[0].cross(&pair[1])) / 6.0;
            }
            start = end;
        }
        volume
    }
}

#[cfg(test)]
#[path = "clip_tests.rs"]
mod tests;
