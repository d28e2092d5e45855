//! How far two bodies have moved against each other.
//!
//! With any point c, displaced by Δc, and a rotation that moves unit vectors by at most φ,
//! no point of B has moved by more than |Δc| + φ l in the frame of A, and no point of A in that of B, l
//! being its distance from c.

use super::pair::Pair;
use crate::math::{Vec3, round, widen};

/// What single precision takes from a distance, over the sum of the radii.
const ROUNDING: f64 = 2e-6;

/// A configuration of two bodies to be compared with later ones.
#[derive(Debug, Clone, Copy, Default)]
pub struct Anchor {
    set: bool,
    /// The point c in the frames of A and B.
    point: [[f32; 3]; 2],
    /// From B to A.
    turn: [f32; 4],
}

/// Bounds on a motion: of the anchor's point (Δc) in m, and of unit vectors (φ).
#[derive(Debug, Clone, Copy)]
pub struct Moved {
    pub at_point: f64,
    pub turn: f64,
}

impl Anchor {
    /// The configuration of `pair`; `c` is in the frame of A, best a point near both bodies.
    pub fn new(pair: &Pair, c: &Vec3) -> Self {
        let point = [*c, pair.point_in_b(c)].map(|x| round(&x));
        let q = pair.turn.coords;
        let turn = [q.x as f32, q.y as f32, q.z as f32, q.w as f32];
        Self { set: true, point, turn }
    }

    /// How far the bodies have moved, if a configuration is known.
    pub fn moved(&self, pair: &Pair) -> Option<Moved> {
        if !self.set {
            return None;
        }
        let [a, b] = &self.point;
        let (a, b) = (widen(a), widen(b));
        let at_point = (pair.rotation * b + pair.offset - a).norm() + ROUNDING * pair.size;
        let [x, y, z, w] = self.turn;
        let old = nalgebra::Vector4::new(x.into(), y.into(), z.into(), w.into());
        let turn = pair.turn.coords;
        let turn = 2.0 * (turn - old).norm_squared().min((turn + old).norm_squared()).sqrt();
        Some(Moved { at_point, turn })
    }
}
