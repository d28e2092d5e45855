//! Which corners can be the outermost along an axis near a known one.
//!
//! Reads: pairs. Writes: lists of corners. Cost: a comparison of directions to ask whether they hold.
//! Contract: along an axis that is near enough, the outermost of the listed corners are the outermost of
//! all.
//!
//! Let unit vectors turn by at most φ against a body. A corner v at a height h above the lowest one w is
//! above it still if h > φ |v - w|.

use super::few::Few;
use super::pair::{self, Pair, larger, smaller};
use crate::math::{Vec3, round, widen};

/// How far the axis may turn in A, and B against A besides.
pub const TURN: f64 = 8e-3;

/// Corners of a pair.
#[derive(Debug, Clone, Copy, Default)]
pub struct Supports {
    /// From A to B, in the frame of A.
    axis: [f32; 3],
    /// Of A and of B, some of them repeated; `None` if there are too many.
    corners: [Option<[u8; 6]>; 2],
}

impl Supports {
    /// The corners for axes near `n`.
    pub fn new(pair: &Pair, n: &Vec3) -> Self {
        let corners =
            [lowest_few(&pair.a.vertices, &-n), lowest_few(&pair.b.vertices, &pair.in_b(n))];
        Self { axis: round(n), corners }
    }

    /// [`Pair::separation`], of bodies that have turned by at most [`TURN`] against each other.
    #[inline]
    pub fn separation(&self, pair: &Pair, n: &Vec3) -> f64 {
        if !self.is_near(n) {
            return pair.separation(n);
        }
        let low = self.lowest(1, &pair.b.vertices, &pair.in_b(n));
        low + n.dot(&pair.offset) + self.lowest(0, &pair.a.vertices, &-n)
    }

    /// The smallest `n · v` of B's corners; `axis` is n in the frame of A.
    #[inline]
    pub fn lowest_of_b(&self, axis: &Vec3, points: &[Vec3], n: &Vec3) -> f64 {
        if self.is_near(axis) { self.lowest(1, points, n) } else { pair::lowest(points, n) }
    }

    /// The smallest `n · v` of A's corners; `axis` is -n.
    #[inline]
    pub fn lowest_of_a(&self, axis: &Vec3, points: &[Vec3], n: &Vec3) -> f64 {
        if self.is_near(axis) { self.lowest(0, points, n) } else { pair::lowest(points, n) }
    }

    fn is_near(&self, n: &Vec3) -> bool {
        (widen(&self.axis) - n).norm_squared() <= TURN * TURN
    }

    #[inline]
    fn lowest(&self, side: usize, points: &[Vec3], n: &Vec3) -> f64 {
        let Some(corners) = &self.corners[side] else {
            return pair::lowest(points, n);
        };
        corners
            .iter()
            .fold(f64::INFINITY, |low, v| smaller(pair::height(n, &points[usize::from(*v)]), low))
    }
}

/// Corners that may be the lowest along an axis near `n`, the first of them as often as it takes to fill the list: how many
/// there are is nothing that a processor could foresee.
fn lowest_few<const N: usize>(points: &[Vec3], n: &Vec3) -> Option<[u8; N]> {
    let mut list = Few::<N>::default();
    let lowest = &points[pair::first_lowest(points, n)];
    for (v, x) in points.iter().enumerate() {
        let aside = x - lowest;
        // The axis may turn by TURN, the body too; single precision takes less than a thousandth.
        let fall = larger(n.dot(&aside), 0.0) / (2.001 * TURN);
        if fall * fall <= aside.norm_squared() {
            list.push(v);
        }
    }
    list.is_whole().then(|| list.filled())
}
