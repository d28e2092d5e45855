//! Held rotations beside free ones (T-28): which turns from its target's orientation they leave a body, and which angular velocities.
//!
//! Rotations are about the world's axes, so what is held is no component of a body's turn but a condition on the whole:
//! with one free axis it turns about that axis, with two about any axis in their plane.

use crate::math::{Quat, Vec3, rotation};
use crate::model::Mount;

/// The constraints `n · ω = n · R ω_target` of held rotations on the angular velocity of a body that is turned by `R`, the rotation `turn`,
/// from its target: the held axes, and their unit vectors `n`.
pub fn constraints(mount: &Mount, turn: &Quat) -> Vec<(usize, Vec3)> {
    let (free, held) = axes(mount);
    let condition = |k: &usize| {
        let axis = Vec3::ith(*k, 1.0);
        let n = if free.len() == 2 { axis * turn.w - axis.cross(&turn.imag()) } else { axis };
        (*k, n)
    };
    held.iter().map(condition).collect()
}

/// The angular velocity of a unit rate of the free rotation `k` that meets the constraints of a target that does not turn.
pub fn constrained_rotation(constraints: &[(usize, Vec3)], k: usize) -> Vec3 {
    let mut angular_velocity = Vec3::ith(k, 1.0);
    for (held, n) in constraints {
        angular_velocity[*held] -= n[k] / n[*held];
    }
    angular_velocity
}

/// The orientation next to `q` that held rotations allow beside the target's. Rounding does not add up over steps.
pub fn project(mount: &Mount, target: &Quat, q: &Quat) -> Quat {
    let turn = q * target.inverse();
    let about =
        |k: usize, share: f64| Vec3::ith(k, share * 2.0 * libm::atan2(turn.imag()[k], turn.w));
    let (free, held) = axes(mount);
    match (&free[..], &held[..]) {
        ([], _) => *target,
        ([k], _) => rotation::advance(target, &about(*k, 1.0)),
        (_, [k]) => rotation::advance(q, &about(*k, -1.0)),
        _ => *q,
    }
}

/// Rotations that are free, and that are held.
fn axes(mount: &Mount) -> (Vec<usize>, Vec<usize>) {
    let modes = mount.rotations();
    (0..3).partition(|k| !modes[*k].is_prescribed())
}
