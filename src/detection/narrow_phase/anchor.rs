//! How far two bodies have moved against each other.
//!
//! With any point c, displaced by Δc, and a rotation that moves unit vectors by at most φ,
//! no point of B has moved by more than |Δc| + φ l in the frame of A, and no point of A in that of B, l
//! being the largest distance of a point of either body from c.

use super::pair::Pair;
use crate::math::Vec3;

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

/// Bounds on a motion: of points (μ) in m, and of unit vectors (φ).
#[derive(Debug, Clone, Copy)]
pub struct Moved {
    pub path: f64,
    pub turn: f64,
}

impl Anchor {
    /// The configuration of `pair`; `c` is in the frame of A, best a point near both bodies.
    pub fn new(pair: &Pair, c: &Vec3) -> Self {
        let point = [*c, pair.point_in_b(c)].map(|x| [x.x as f32, x.y as f32, x.z as f32]);
        let q = pair.turn.coords;
        Self { set: true, point, turn: [q.x as f32, q.y as f32, q.z as f32, q.w as f32] }
    }

    /// How far the bodies have moved, if a configuration is known.
    pub fn moved(&self, pair: &Pair) -> Option<Moved> {
        if !self.set {
            return None;
        }
        let [a, b] = self.point.map(|x| Vec3::from(x.map(f64::from)));
        let lever = (pair.a.radius + a.norm()).max(pair.b.radius + b.norm());
        let path = (pair.rotation * b + pair.offset - a).norm();
        let (turn, old) = (pair.turn.coords, nalgebra::Vector4::from(self.turn.map(f64::from)));
        let turn = 2.0 * (turn - old).norm_squared().min((turn + old).norm_squared()).sqrt();
        Some(Moved { path: path + lever * turn + ROUNDING * pair.size, turn })
    }
}
