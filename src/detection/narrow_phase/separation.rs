//! Separating axis by GJK for pairs without a cache.
//!
//! GJK of parry3d proposes the axis; the vertices decide. Hence no tolerance of the proposal enters the result: a
//! pair without a proposed axis is searched in full.

use super::pair::{self, BodyPair};
use crate::math::Vec3;
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SupportMap;

/// Returns a separating axis (A to B, frame of A) and its separation beyond the alert distance, m.
///
/// `start` is the initial direction of the search.
pub fn direction(pair: &BodyPair, start: Option<Vec3>) -> Option<(Vec3, f64)> {
    let start = start.unwrap_or(pair.offset);
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(CsoPoint::from_shapes(
        &Pose::IDENTITY,
        &ShapeA(pair),
        &ShapeB(pair),
        to_parry(&start),
    ));
    // A little further than has to be shown.
    let reach = pair.alert * 1.000_01 + 1e-6 * pair.size;
    match gjk::closest_points(
        &Pose::IDENTITY,
        &ShapeA(pair),
        &ShapeB(pair),
        reach,
        false,
        &mut simplex,
    ) {
        GJKResult::NoIntersection(n) => {
            let n = from_parry(n);
            pair.separation_beyond_alert(&n).map(|beyond| (n, beyond))
        }
        _ => None,
    }
}

/// Support function of A.
pub(super) struct ShapeA<'p, 's>(pub(super) &'p BodyPair<'s>);

impl SupportMap for ShapeA<'_, '_> {
    fn local_support_point(&self, direction: Vector) -> Vector {
        let Self(pair) = self;
        let v = pair::first_lowest(&pair.a.vertices, &-from_parry(direction));
        to_parry(&pair.a.vertices[v])
    }
}

/// Support function of B in the frame of A.
struct ShapeB<'p, 's>(&'p BodyPair<'s>);

impl SupportMap for ShapeB<'_, '_> {
    fn local_support_point(&self, direction: Vector) -> Vector {
        let Self(pair) = self;
        let v = pair::first_lowest(&pair.b.vertices, &-pair.in_b(&from_parry(direction)));
        to_parry(&pair.corner_of_b(v))
    }
}

pub(super) fn to_parry(x: &Vec3) -> Vector {
    Vector::new(x.x, x.y, x.z)
}

pub(super) fn from_parry(x: Vector) -> Vec3 {
    Vec3::new(x.x, x.y, x.z)
}

#[cfg(test)]
mod tests {
    use super::super::pair::ConvexBody;
    use super::*;
    use crate::geometry::{GrainShape, random_grain, random_rotation};
    use crate::math::Pose as WorldPose;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    const ALERT: f64 = 1e-3;

    #[test]
    fn proposed_axes_separate_and_none_is_missed() {
        let mut rng = Pcg64::seed_from_u64(53);
        let grains: Vec<_> = (0..40)
            .map(|_| random_grain(&mut rng, &GrainShape::default(), 0.04).unwrap())
            .collect();
        for i in 0..400 {
            let (a, b) = (&grains[i % 40], &grains[(7 * i + 3) % 40]);
            let axis = random_rotation(&mut rng) * Vec3::z();
            let orientation = random_rotation(&mut rng);
            let rotated: Vec<Vec3> = b.vertices.iter().map(|v| orientation * v).collect();
            // The separation of B from A along an axis is slightly above or below the alert distance.
            let off = ALERT * if i % 2 == 0 { 1.01 } else { rng.random_range(-5.0..0.99) };
            let contacts = pair::highest(&a.vertices, &axis) - pair::lowest(&rotated, &axis);
            let b = ConvexBody {
                shape: b,
                pose: WorldPose { position: axis * (contacts + off), orientation },
            };
            let a = ConvexBody { shape: a, pose: WorldPose::identity() };
            let Ok(pair) = BodyPair::new(a, b, ALERT) else { continue };
            let found = direction(&pair, None);
            if i % 2 == 0 {
                let (n, beyond) = found.unwrap_or_else(|| panic!("{i}: apart by {off}"));
                assert!((n.norm() - 1.0).abs() < 1e-9 && beyond > 0.0, "{i}");
                assert!(pair.separation(&n) > ALERT + 0.999 * beyond, "{i}");
            } else if let Some((n, _)) = found {
                // Bodies close along one axis may well be apart along another.
                assert!(pair.separation(&n) > ALERT, "{i}");
            }
        }
    }
}
