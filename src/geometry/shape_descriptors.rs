//! Shape descriptors of a stone as ballast engineers use them.
//!
//! Reads: a polyhedron. Writes: nothing. Cost: O(edges²) for the least thickness, O(vertices²) for the longest diameter;
//! below a millisecond for a stone. Contract: widths are exact for the polyhedron; the sieve size is an upper bound.

use super::plane;
use super::polyhedron::Polyhedron;
use crate::math::{Vec3, frame};
use std::f64::consts::{FRAC_PI_2, PI};

/// Sine of the angle below which two edges count as parallel, and tolerance of unit vectors.
const PARALLEL_TOLERANCE: f64 = 1e-9;
/// Minimum length of a side of a projection, over the radius of the stone; shorter sides are rounding.
const MIN_SIDE_LENGTH: f64 = 1e-9;

/// Lengths of a stone and the descriptors of its shape.
///
/// Lengths are those of a box of callipers: the thickness S is the least distance of two parallel planes that enclose
/// the stone, the width I the least one of planes perpendicular to these, and the length L that in the direction
/// perpendicular to both. A brick has its three sides, and L >= I >= S for any stone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShapeDescriptors {
    /// Length L, m: extent perpendicular to thickness and width.
    pub length: f64,
    /// Width I, m: least distance of parallel planes perpendicular to those of the thickness.
    pub width: f64,
    /// Thickness S, m: least distance of two parallel planes that enclose the stone (E of EN 933-4).
    pub thickness: f64,
    /// Longest Feret diameter, m: greatest distance of two parallel planes that touch the stone (L of EN 933-4).
    pub longest_diameter: f64,
    /// Sieve size, m: side of the smallest square around the projection of the stone along its length, its longest
    /// diameter, or its axis of least inertia, whichever is smallest.
    pub sieve_size: f64,
    /// Wadell's sphericity: surface of the sphere of equal volume over the surface of the stone; 1 for a sphere.
    pub sphericity: f64,
    /// Angularity, rad: angle between the normals of the two faces at an edge, mean over the edges by their length.
    ///
    /// It is π/2 for any brick and tends to 0 for a smooth surface.
    pub angularity: f64,
}

impl ShapeDescriptors {
    /// Computes the descriptors of a stone.
    pub fn of(stone: &Polyhedron) -> Self {
        let (thickness, flat) = least_width(stone);
        let plan = Projection::new(stone, &flat);
        let (width, across) = plan.least_width();
        let along = [-across[1], across[0]];
        let (longest_diameter, longest) = longest_diameter(stone);
        let least_inertia = Vec3::ith(stone.unit_inertia.imin(), 1.0);
        let sieve_size = [plan.in_space(along), longest, least_inertia]
            .iter()
            .map(|direction| Projection::new(stone, direction).smallest_square())
            .fold(f64::INFINITY, f64::min);
        let diameter = stone.nominal_diameter();
        Self {
            length: plan.extent(along).max(width),
            width,
            thickness,
            longest_diameter,
            sieve_size,
            sphericity: PI * diameter * diameter / stone.surface(),
            angularity: angularity(stone),
        }
    }

    /// Returns the elongation I/L: 1 for a cube, small for a needle.
    pub fn elongation(&self) -> f64 {
        self.width / self.length
    }

    /// Returns the flatness S/I: 1 for a cube, small for a plate.
    pub fn flatness(&self) -> f64 {
        self.thickness / self.width
    }

    /// Returns the ratio of longest diameter to thickness, L/E of EN 933-4.
    pub fn length_to_thickness(&self) -> f64 {
        self.longest_diameter / self.thickness
    }
}

/// Edge with the directions from it into its two faces, which bound the directions that it supports.
struct SupportEdge {
    point: Vec3,
    along: Vec3,
    inward: [Vec3; 2],
}

impl SupportEdge {
    /// True if no point of the stone lies beyond the edge in direction `n`, which is perpendicular to the edge.
    fn is_extreme(&self, n: &Vec3) -> bool {
        self.inward.iter().all(|t| n.dot(t) <= PARALLEL_TOLERANCE)
    }
}

/// Returns the least distance (m) of two parallel planes that enclose a stone, and their normal.
///
/// The minimum has a face on one plane or an edge on each (Houle and Toussaint 1988).
fn least_width(stone: &Polyhedron) -> (f64, Vec3) {
    let of_face = |(n, offset): (&Vec3, &f64)| {
        let lowest = stone.vertices.iter().map(|v| n.dot(v)).fold(f64::INFINITY, f64::min);
        (offset - lowest, *n)
    };
    let mut best = (stone.face_normals.iter().zip(&stone.face_offsets))
        .map(of_face)
        .fold((f64::INFINITY, Vec3::z()), |a, b| if b.0 < a.0 { b } else { a });
    let edges: Vec<SupportEdge> = stone
        .edges
        .iter()
        .map(|edge| {
            let [a, b] = edge.vertices.map(|v| stone.vertices[v as usize]);
            let along = (b - a).normalize();
            let [f, g] = edge.faces.map(|f| stone.face_normals[f as usize]);
            SupportEdge { point: a, along, inward: [f.cross(&along), -g.cross(&along)] }
        })
        .collect();
    for (i, e) in edges.iter().enumerate() {
        for f in &edges[..i] {
            let across = e.along.cross(&f.along);
            let sine = across.norm();
            if sine <= PARALLEL_TOLERANCE {
                continue;
            }
            let signed = across.dot(&(e.point - f.point)) / sine;
            let n = across * (signed.signum() / sine);
            if signed.abs() < best.0 && e.is_extreme(&n) && f.is_extreme(&-n) {
                best = (signed.abs(), n);
            }
        }
    }
    best
}

/// Returns the greatest distance (m) of two vertices, and its direction.
fn longest_diameter(stone: &Polyhedron) -> (f64, Vec3) {
    let mut longest = Vec3::zeros();
    for (i, a) in stone.vertices.iter().enumerate() {
        for b in &stone.vertices[..i] {
            if (a - b).norm_squared() > longest.norm_squared() {
                longest = a - b;
            }
        }
    }
    let length = longest.norm();
    (length, longest / length)
}

fn angularity(stone: &Polyhedron) -> f64 {
    let (mut sum, mut total) = (0.0, 0.0);
    for edge in &stone.edges {
        let [a, b] = edge.vertices.map(|v| stone.vertices[v as usize]);
        let [f, g] = edge.faces.map(|f| stone.face_normals[f as usize]);
        let length = (b - a).norm();
        sum += length * libm::atan2(f.cross(&g).norm(), f.dot(&g));
        total += length;
    }
    sum / total
}

/// Convex polygon around the projection of a stone on a plane.
struct Projection {
    corners: Vec<[f64; 2]>,
    axes: [Vec3; 2],
    min_side: f64,
}

impl Projection {
    /// Projects a stone along a unit vector.
    fn new(stone: &Polyhedron, along: &Vec3) -> Self {
        let (u, v) = frame::tangents(along);
        let mut points: Vec<_> =
            stone.vertices.iter().enumerate().map(|(i, p)| ([u.dot(p), v.dot(p)], i)).collect();
        let mut chain = Vec::new();
        plane::hull(&mut points, &mut chain);
        Self {
            corners: chain.into_iter().map(|(p, _)| p).collect(),
            axes: [u, v],
            min_side: MIN_SIDE_LENGTH * stone.radius,
        }
    }

    /// Returns a direction of the plane as a vector in space.
    fn in_space(&self, [x, y]: [f64; 2]) -> Vec3 {
        self.axes[0] * x + self.axes[1] * y
    }

    /// Returns the unit vectors along the sides.
    fn sides(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        let next = self.corners.iter().cycle().skip(1);
        self.corners.iter().zip(next).filter_map(|(a, b)| {
            let (x, y) = (b[0] - a[0], b[1] - a[1]);
            let length = libm::hypot(x, y);
            (length > self.min_side).then(|| [x / length, y / length])
        })
    }

    /// Returns the vector between the extreme corners in direction `d`.
    fn span(&self, d: [f64; 2]) -> [f64; 2] {
        let along = |p: &[f64; 2]| p[0] * d[0] + p[1] * d[1];
        let mut extremes = [self.corners[0]; 2];
        for p in &self.corners {
            if along(p) < along(&extremes[0]) {
                extremes[0] = *p;
            }
            if along(p) > along(&extremes[1]) {
                extremes[1] = *p;
            }
        }
        let [low, high] = extremes;
        [high[0] - low[0], high[1] - low[1]]
    }

    /// Returns the extent in the direction of the unit vector `d`, m.
    fn extent(&self, d: [f64; 2]) -> f64 {
        let [x, y] = self.span(d);
        x * d[0] + y * d[1]
    }

    /// Returns the least extent (m) and its direction; the minimum is perpendicular to a side.
    fn least_width(&self) -> (f64, [f64; 2]) {
        self.sides()
            .map(|[x, y]| (self.extent([-y, x]), [-y, x]))
            .fold((f64::INFINITY, [1.0, 0.0]), |a, b| if b.0 < a.0 { b } else { a })
    }

    /// Returns the side of the smallest square around the polygon, m.
    ///
    /// Between two directions of sides both extents are concave in the angle, so that the larger one is least at such a
    /// direction or where the extents are equal.
    fn smallest_square(&self) -> f64 {
        let quarter = |[x, y]: [f64; 2]| {
            let angle = libm::fmod(libm::atan2(y, x) + 2.0 * PI, FRAC_PI_2);
            if angle < FRAC_PI_2 { angle } else { 0.0 }
        };
        let mut angles: Vec<f64> = self.sides().map(quarter).collect();
        angles.sort_by(f64::total_cmp);
        let at = |angle: f64| {
            let d = [libm::cos(angle), libm::sin(angle)];
            [self.extent(d), self.extent([-d[1], d[0]])]
        };
        let mut smallest = f64::INFINITY;
        for (k, &low) in angles.iter().enumerate() {
            let high = angles.get(k + 1).copied().unwrap_or(angles[0] + FRAC_PI_2);
            let [first, second] = at(low);
            smallest = smallest.min(first.max(second));
            let [next_first, next_second] = at(high);
            if (first - second) * (next_first - next_second) < 0.0 {
                let middle = 0.5 * (low + high);
                let d = [libm::cos(middle), libm::sin(middle)];
                let (p, q) = (self.span(d), self.span([-d[1], d[0]]));
                // Both extents are linear in the direction here; they are equal perpendicular to this vector.
                let r = [p[0] - q[1], p[1] + q[0]];
                let equal = (p[0] * r[1] - p[1] * r[0]).abs() / libm::hypot(r[0], r[1]);
                smallest = smallest.min(equal);
            }
        }
        smallest
    }
}

#[cfg(test)]
#[path = "shape_descriptors_tests.rs"]
mod tests;
