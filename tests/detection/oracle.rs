//! Exhaustive reference for detection: every axis and every feature.

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

    /// Returns the distance of `x` outside the worst face plane; negative inside.
    pub fn outside(&self, x: &Vec3) -> f64 {
        let planes = self.normals.iter().zip(&self.offsets);
        planes.fold(f64::NEG_INFINITY, |o, (n, d)| o.max(n.dot(x) - d))
    }

    /// True if `x` is on the surface, to the tolerance, on a face that points along `towards`.
    pub fn faces_at(&self, x: &Vec3, tolerance: f64, towards: &Vec3) -> bool {
        let on = |(n, d): (&Vec3, &f64)| n.dot(towards) > 0.0 && (n.dot(x) - d).abs() <= tolerance;
        self.outside(x) <= tolerance && self.normals.iter().zip(&self.offsets).any(on)
    }

    /// The heights along `n` between which the line through `x` is in the body.
    fn chord(&self, x: &Vec3, n: &Vec3) -> Option<[f64; 2]> {
        let mut chord = [f64::NEG_INFINITY, f64::INFINITY];
        for (m, d) in self.normals.iter().zip(&self.offsets) {
            let (slope, room) = (m.dot(n), d - m.dot(x));
            if slope < -1e-6 {
                chord[0] = chord[0].max(room / slope);
            } else if slope > 1e-6 {
                chord[1] = chord[1].min(room / slope);
            } else if room < 0.0 {
                return None;
            }
        }
        (chord[0] <= chord[1]).then_some(chord)
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

/// Places of the corners of the gap from A to B along `n` that are no wider than `widest`: vertices
/// and crossings of edges of the surfaces that face each other, each measured by the chords of the
/// line through it.
pub fn corners(a: &Body, b: &Body, n: &Vec3, widest: f64) -> Vec<Vec3> {
    let tolerance = 1e-9 * (a.vertices[0] - a.vertices[1]).norm();
    // A point of the surface of A or of B, or a point of A that is `gap` below one of B.
    let narrow = |x: &Vec3, of_a: bool, gap: Option<f64>| {
        let (Some(in_a), Some(in_b)) = (a.chord(x, n), b.chord(x, n)) else { return false };
        let facing = if of_a { in_a[1] } else { in_b[0] };
        let on_b = gap.is_none_or(|g| (g - in_b[0]).abs() <= tolerance);
        facing.abs() <= tolerance && on_b && in_b[0] - in_a[1] <= widest
    };
    let crossing = |[p0, p1]: &[Vec3; 2], [q0, q1]: &[Vec3; 2]| {
        let (d, e, r) = (p1 - p0, q1 - q0, q0 - p0);
        let turn = n.dot(&d.cross(&e));
        let (s, t) = (n.dot(&r.cross(&e)) / turn, n.dot(&r.cross(&d)) / turn);
        let inside = (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
        let (x, gap) = (p0 + d * s, n.dot(&(r + e * t - d * s)));
        let flat = turn.abs() > 1e-6 * d.norm() * e.norm();
        (inside && flat && narrow(&x, true, Some(gap))).then_some(x)
    };
    let crossings = a
        .edges
        .iter()
        .flat_map(|p| b.edges.iter().filter_map(|q| crossing(p, q)).collect::<Vec<_>>());
    let of_a = a.vertices.iter().filter(|v| narrow(v, true, None));
    let of_b = b.vertices.iter().filter(|v| narrow(v, false, None));
    of_a.chain(of_b).copied().chain(crossings).collect()
}

/// Area of the points' hull seen along `n`: what is between its upper and its lower chain.
pub fn hull_area(points: &[Vec3], n: &Vec3) -> f64 {
    let aside = if n.x.abs() < 0.6 { Vec3::x() } else { Vec3::y() };
    let t = n.cross(&aside).normalize();
    let s = n.cross(&t);
    let mut flat: Vec<[f64; 2]> = points.iter().map(|p| [t.dot(p), s.dot(p)]).collect();
    flat.sort_by(|p, q| p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1])));
    let turn = |o: [f64; 2], p: [f64; 2], q: [f64; 2]| {
        (p[0] - o[0]) * (q[1] - o[1]) - (p[1] - o[1]) * (q[0] - o[0])
    };
    // The area under a chain of points from left to right, on the given side of all others.
    let under = |side: f64| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for &p in &flat {
            while let [.., o, last] = chain[..]
                && side * turn(o, last, p) >= 0.0
            {
                chain.pop();
            }
            chain.push(p);
        }
        chain.windows(2).map(|w| 0.5 * (w[0][1] + w[1][1]) * (w[1][0] - w[0][0])).sum::<f64>()
    };
    under(1.0) - under(-1.0)
}
