//! Puts contact points in the overlap of two bodies.
//!
//! Half-way between the surfaces is in both bodies unless one is thinner there than the overlap is
//! deep, as near a sharp edge. Then the point moves along the normal to the middle of what the
//! bodies share of its line.

use super::faces;
use super::reduce::Candidate;
use crate::geometry::Polyhedron;
use crate::math::{Pose, Vec3};

/// Which part of each point's line, as distances from the point, is in the bodies asked so far.
#[derive(Debug, Clone, Copy)]
pub struct Span {
    low: f64,
    high: f64,
}

impl Span {
    /// The stretch between the two surfaces.
    pub fn between_surfaces(c: &Candidate) -> Self {
        let half = (-0.5 * c.gap).max(0.0);
        Self { low: -half, high: half }
    }

    /// Middle of the span, or of the stretch that parts the bodies if they share nothing.
    pub fn middle(&self) -> f64 {
        0.5 * (self.low + self.high)
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.low > self.high
    }
}

/// Cuts the spans to what is inside `shape` or at most `tolerance` out of each face; points and the
/// unit vector `n` in its frame.
///
/// The tolerance keeps faces along `n` that points lie on to rounding from cutting anything.
pub fn cut(shape: &Polyhedron, points: &[Vec3], n: &Vec3, tolerance: f64, spans: &mut [Span]) {
    let Some(first) = points.first() else { return };
    let count = points.len() as f64;
    let centre = points.iter().fold(Vec3::zeros(), |sum, p| sum + p) / count;
    let extent = |p: &Vec3, s: &Span| (p - centre).norm() + s.high;
    let reach =
        points.iter().zip(&*spans).fold((first - centre).norm(), |r, (p, s)| r.max(extent(p, s)));
    for (normal, offset) in shape.face_normals.iter().zip(&shape.face_offsets) {
        // Most faces are further off than any of the points can reach.
        if normal.dot(&centre) - offset + reach <= 0.0 {
            continue;
        }
        let slope = normal.dot(n);
        for (p, span) in points.iter().zip(&mut *spans) {
            let out = normal.dot(p) - offset - tolerance;
            if slope > 0.0 && out + slope * span.high > 0.0 {
                span.high = -out / slope;
            } else if slope < 0.0 && out + slope * span.low > 0.0 {
                span.low = -out / slope;
            }
        }
    }
}

/// A point near `x` that is in both bodies up to `tolerance`, if they overlap.
///
/// Projects on the plane that is violated most, a little too far, so that the end is reached in few
/// steps: for sharp edges, whose normal line passes beside the overlap.
pub fn pull_in(solids: [(&Polyhedron, &Pose); 2], x: &Vec3, tolerance: f64) -> Vec3 {
    let mut x = *x;
    for _ in 0..PULLS {
        let worst = |(shape, pose): (&Polyhedron, &Pose)| {
            let local = pose.inverse_point(&x);
            let (out, f) = faces::furthest_out(shape, &local);
            (out, pose.orientation * shape.face_normals[f])
        };
        let (a, b) = (worst(solids[0]), worst(solids[1]));
        let (out, n) = if a.0 >= b.0 { a } else { b };
        if out <= tolerance {
            break;
        }
        x -= n * (1.3 * out);
    }
    x
}

const PULLS: usize = 100;
