//! Puts contact points in the overlap of two bodies.
//!
//! Half-way between the surfaces is in both bodies unless one is thinner there than the overlap is
//! deep, as near a sharp edge. Then the point moves along the normal to the middle of what the
//! bodies share of its line. Bodies of equal outline that lean a little, as in a wall, overlap with
//! corners whose lines pass just beside one of them: those move sideways, for a manifold that loses
//! its corners carries no moment.

use super::faces;
use super::reduce::Candidate;
use crate::geometry::Polyhedron;
use crate::math::{Pose, Vec3};

/// How far a line may pass beside a body, over the depth of the overlap at its point.
const LEAN: f64 = 0.1;
/// Sine squared of the angle between line and face above which the face is beside the line.
const BESIDE: f64 = 0.5;

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

/// Cuts the spans to what is inside `shape`, or moves points sideways into it; points and the unit
/// vector `n` in its frame.
pub fn cut(shape: &Polyhedron, points: &mut [Vec3], n: &Vec3, spans: &mut [Span]) {
    let Some(&first) = points.first() else { return };
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
        let sine_squared = 1.0 - slope * slope;
        for (p, span) in points.iter_mut().zip(&mut *spans) {
            let mut out = normal.dot(p) - offset;
            let farthest = out + (slope * span.high).max(slope * span.low);
            let beside = farthest <= LEAN * (span.high - span.low) && sine_squared > BESIDE;
            if farthest > 0.0 && beside {
                *p -= (normal - n * slope) * (farthest / sine_squared);
                out -= farthest;
            }
            if slope > 0.0 && out + slope * span.high > 0.0 {
                span.high = -out / slope;
            } else if slope < 0.0 && out + slope * span.low > 0.0 {
                span.low = -out / slope;
            }
        }
    }
}
