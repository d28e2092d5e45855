//! What detection is measured against: every axis, every feature, nothing clever.

use ballast::geometry::Polyhedron;
use ballast::math::{Pose, Vec3};

/// A polyhedron in the world.
pub struct Body {
    pub vertices: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub offsets: Vec<f64>,
    pub edges: Vec<[Vec3; 2]>,
    faces: Vec<Vec<Vec3>>,
}

impl Body {
    pub fn new(shape: &Polyhedron, pose: &Pose) -> Self {
        let vertices: Vec<Vec3> = shape.vertices.iter().map(|v| pose.point(v)).collect();
        let normals: Vec<Vec3> = shape.face_normals.iter().map(|n| pose.orientation * n).collect();
        let offsets = normals
            .iter()
            .zip(&shape.face_offsets)
            .map(|(n, d)| d + n.dot(&pose.position))
            .collect();
        let edges = shape.edges.iter().map(|e| e.vertices.map(|v| vertices[v as usize])).collect();
        let corners = |f: usize| shape.face(f).iter().map(|&v| vertices[v as usize]).collect();
        let faces = (0..shape.face_count()).map(corners).collect();
        Self { vertices, normals, offsets, edges, faces }
    }

    /// Smallest and largest `n · x`.
    fn range(&self, n: &Vec3) -> [f64; 2] {
        self.vertices.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| {
            let h = n.dot(v);
            [low.min(h), high.max(h)]
        })
    }

    /// How far `x` is outside the worst face plane; negative inside.
    pub fn outside(&self, x: &Vec3) -> f64 {
        let planes = self.normals.iter().zip(&self.offsets);
        planes.fold(f64::NEG_INFINITY, |o, (n, d)| o.max(n.dot(x) - d))
    }
}

/// Separation from A to B along `n` or `-n`, whichever is larger, and the direction.
fn both_ways(a: &Body, b: &Body, n: &Vec3) -> (f64, Vec3) {
    let ([a0, a1], [b0, b1]) = (a.range(n), b.range(n));
    if b0 - a1 >= a0 - b1 { (b0 - a1, *n) } else { (a0 - b1, -n) }
}

/// Largest separation over all face normals and all products of edges, and its direction, A to B.
pub fn separation(a: &Body, b: &Body) -> (f64, Vec3) {
    let mut best = (f64::NEG_INFINITY, Vec3::zeros());
    let better = |n: &Vec3, best: (f64, Vec3)| {
        let found = both_ways(a, b, n);
        if found.0 > best.0 { found } else { best }
    };
    for n in a.normals.iter().chain(&b.normals) {
        best = better(n, best);
    }
    for [p0, p1] in &a.edges {
        let e = p1 - p0;
        for [q0, q1] in &b.edges {
            let f = q1 - q0;
            let c = e.cross(&f);
            if c.norm() > 1e-9 * e.norm() * f.norm() {
                // Twice, for nearly parallel edges.
                let c = c.normalize();
                let n = (c - e * (c.dot(&e) / e.norm_squared())).normalize();
                // Neither n nor -n can separate by more than these two points show.
                if n.dot(&(q0 - p0)).abs() > best.0 {
                    best = better(&n, best);
                }
            }
        }
    }
    best
}

/// Distance of the closest points of two bodies that are apart.
pub fn distance(a: &Body, b: &Body) -> f64 {
    let mut best = f64::INFINITY;
    for (one, other) in [(a, b), (b, a)] {
        for v in &one.vertices {
            for (f, n) in other.normals.iter().enumerate() {
                let h = n.dot(v) - other.offsets[f];
                if h >= 0.0 && h < best && projects_on(v, n, &other.faces[f]) {
                    best = h;
                }
            }
        }
    }
    for e in &a.edges {
        for f in &b.edges {
            best = best.min(segment_distance(e, f));
        }
    }
    best
}

fn projects_on(x: &Vec3, n: &Vec3, corners: &[Vec3]) -> bool {
    (0..corners.len()).all(|k| {
        let (p, q) = (corners[k], corners[(k + 1) % corners.len()]);
        n.cross(&(q - p)).dot(&(x - p)) >= 0.0
    })
}

/// The minimum of a convex quadratic over a square: inside, or on one of its four sides.
fn segment_distance([p0, p1]: &[Vec3; 2], [q0, q1]: &[Vec3; 2]) -> f64 {
    let (d, e, r) = (p1 - p0, q1 - q0, p0 - q0);
    let (dd, ee, de) = (d.dot(&d), e.dot(&e), d.dot(&e));
    let at = |s: f64, t: f64| (r + d * s - e * t).norm();
    let mut best = f64::INFINITY;
    for s in [0.0, 1.0] {
        best = best.min(at(s, ((r + d * s).dot(&e) / ee).clamp(0.0, 1.0)));
    }
    for t in [0.0, 1.0] {
        best = best.min(at(((e * t - r).dot(&d) / dd).clamp(0.0, 1.0), t));
    }
    let determinant = dd * ee - de * de;
    if determinant > 1e-14 * dd * ee {
        let s = (de * r.dot(&e) - ee * r.dot(&d)) / determinant;
        let t = (dd * r.dot(&e) - de * r.dot(&d)) / determinant;
        if (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t) {
            best = best.min(at(s, t));
        }
    }
    best
}
