//! A direction along which two bodies are apart for certain.
//!
//! GJK of parry3d proposes it. What counts is what corners say of it, so no tolerance of the proposal enters the
//! result: a pair for which there is none is searched as if nobody had asked.

use super::pair::{self, Pair};
use crate::math::Vec3;
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SupportMap;

/// A direction (A to B, frame of A) and how much it separates beyond the alert distance, m; `start` is one to
/// begin with.
pub fn direction(pair: &Pair, start: Option<Vec3>) -> Option<(Vec3, f64)> {
    let start = start.unwrap_or(pair.offset);
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(CsoPoint::from_shapes(&Pose::IDENTITY, &OfA(pair), &OfB(pair), to_parry(&start)));
    // A little further than has to be shown.
    let reach = pair.alert * 1.000_01 + 1e-6 * pair.size;
    match gjk::closest_points(&Pose::IDENTITY, &OfA(pair), &OfB(pair), reach, false, &mut simplex) {
        GJKResult::NoIntersection(n) => {
            let n = from_parry(n);
            pair.apart_along(&n).map(|beyond| (n, beyond))
        }
        _ => None,
    }
}

/// Corners of A.
struct OfA<'p, 's>(&'p Pair<'s>);

impl SupportMap for OfA<'_, '_> {
    fn local_support_point(&self, direction: Vector) -> Vector {
        let Self(pair) = self;
        let v = pair::first_lowest(&pair.a.vertices, &-from_parry(direction));
        to_parry(&pair.a.vertices[v])
    }
}

/// Corners of B in the frame of A.
struct OfB<'p, 's>(&'p Pair<'s>);

impl SupportMap for OfB<'_, '_> {
    fn local_support_point(&self, direction: Vector) -> Vector {
        let Self(pair) = self;
        let v = pair::first_lowest(&pair.b.vertices, &-pair.in_b(&from_parry(direction)));
        to_parry(&pair.corner_of_b(v))
    }
}

fn to_parry(x: &Vec3) -> Vector {
    Vector::new(x.x, x.y, x.z)
}

fn from_parry(x: Vector) -> Vec3 {
    Vec3::new(x.x, x.y, x.z)
}
