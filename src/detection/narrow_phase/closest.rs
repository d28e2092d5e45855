//! Closest points of edges.

use super::edges::{LoneEdge, NearEdge};
use crate::math::Vec3;

/// Closest points of two segments, and where on them: 0 at the start, 1 at the end.
#[derive(Debug, Clone, Copy)]
pub struct ClosestPoints {
    /// Numbers of the edges.
    pub edges: [usize; 2],
    pub parameter: [f64; 2],
    pub on_a: Vec3,
    pub on_b: Vec3,
    pub distance_squared: f64,
}

/// Closest points over all pairs of near edges, if any are within `reach` of each other; the first
/// pair among equals.
pub fn closest_points(
    near_a: &[NearEdge],
    near_b: &[NearEdge],
    reach: f64,
) -> Option<ClosestPoints> {
    let mut best: Option<ClosestPoints> = None;
    let mut reach = reach;
    for a in near_a {
        for b in near_b {
            if !a.may_reach(b, reach) {
                continue;
            }
            let found = closest_on_segments(&a.alone(), &b.alone());
            if best.is_none_or(|c| found.distance_squared < c.distance_squared) {
                // A little more than the distance: equal ones stay in, whatever rounding does.
                reach = reach.min(found.distance_squared.sqrt() * (1.0 + 1e-6));
                best = Some(found);
            }
        }
    }
    best
}

/// Closest points of two segments, by clamping the solution for lines.
///
/// Source: Ericson, *Real-time collision detection*, 2005, section 5.1.9.
pub fn closest_on_segments(a: &LoneEdge, b: &LoneEdge) -> ClosestPoints {
    let offset = a.start - b.start;
    let (aa, bb) = (a.along.norm_squared(), b.along.norm_squared());
    let ab = a.along.dot(&b.along);
    let (ao, bo) = (a.along.dot(&offset), b.along.dot(&offset));
    let determinant = aa * bb - ab * ab;
    // Parallel: any point will do, the clamping of the other one finds its partner.
    let mut s = if determinant > 1e-20 * aa * bb {
        ((ab * bo - ao * bb) / determinant).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let mut t = (ab * s + bo) / bb;
    if t < 0.0 {
        t = 0.0;
        s = (-ao / aa).clamp(0.0, 1.0);
    } else if t > 1.0 {
        t = 1.0;
        s = ((ab - ao) / aa).clamp(0.0, 1.0);
    }
    let on_a = a.start + a.along * s;
    let on_b = b.start + b.along * t;
    let distance_squared = (on_b - on_a).norm_squared();
    ClosestPoints { edges: [a.index, b.index], parameter: [s, t], on_a, on_b, distance_squared }
}
