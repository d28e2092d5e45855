//! Contacts of bodies that pass each other in a step without touching (T-40).
//!
//! The gap of a contact is linear along the normal of configuration m. Near an edge or a corner that normal is the line to
//! the closest point, and its plane extends over space that is free: a body on its way past would be stopped by it. If a
//! plane keeps both bodies apart in the whole step, as their free velocities have it, its normal is taken instead. It
//! separates them in configuration m, too, so the contact along it keeps them apart all the same.

use super::memory::Scratch;
use super::pair::{self, BodyPair, ConvexBody};
use super::separation::{ShapeA, from_parry, to_parry};
use crate::math::{Pose, Vec3};
use parry3d_f64::math::Pose as ParryPose;
use parry3d_f64::math::Vector;
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SupportMap;

/// Replaces the contact points from `start` on by those along a normal that separates A and B in the whole step, if there
/// is one; `end` are the poses of A and B to which the free velocities lead.
pub fn replace_passing_contact(
    a: ConvexBody,
    b: ConvexBody,
    end: [Pose; 2],
    detection_distance: f64,
    start: usize,
    scratch: &mut Scratch,
) {
    let Ok(pair) = BodyPair::new(a, b, detection_distance) else { return };
    let [pose_a, pose_b] = end;
    let (a, b) = (ConvexBody { pose: pose_a, ..a }, ConvexBody { pose: pose_b, ..b });
    let Ok(end) = BodyPair::new(a, b, detection_distance + 8.0 * pair.size) else { return };
    let present = -(pair.pose.orientation.inverse() * scratch.points[start].normal);
    // Its plane keeps them apart for the whole step already.
    if end.separation(&present) > 0.0 {
        return;
    }
    let Some(normal) = separating_normal(&pair, &end) else { return };
    let gap = pair.separation(&normal);
    if !(gap > 0.0 && end.separation(&normal) > 0.0) {
        return;
    }
    scratch.points.truncate(start);
    if gap <= detection_distance {
        pair.report_along(&normal, gap, scratch);
    }
}

/// Normal (A to B, frame of A) of a plane between A and all that B sweeps from one configuration to the other.
fn separating_normal(pair: &BodyPair, end: &BodyPair) -> Option<Vec3> {
    let (a, b) = (ShapeA(pair), SweptShapeB { pair, end });
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(CsoPoint::from_shapes(&ParryPose::IDENTITY, &a, &b, to_parry(&pair.offset)));
    match gjk::closest_points(&ParryPose::IDENTITY, &a, &b, f64::MAX, true, &mut simplex) {
        GJKResult::ClosestPoints(_, _, normal) => Some(from_parry(normal).normalize()),
        _ => None,
    }
}

/// Corners of B in both configurations, in the frame of A.
struct SweptShapeB<'p, 's> {
    pair: &'p BodyPair<'s>,
    end: &'p BodyPair<'s>,
}

impl SupportMap for SweptShapeB<'_, '_> {
    fn local_support_point(&self, direction: Vector) -> Vector {
        let direction = from_parry(direction);
        let [now, later] = [self.pair, self.end].map(|pair| {
            let v = pair::first_lowest(&pair.b.vertices, &-pair.in_b(&direction));
            pair.corner_of_b(v)
        });
        to_parry(if direction.dot(&now) >= direction.dot(&later) { &now } else { &later })
    }
}
