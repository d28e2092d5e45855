//! Prescribed rotations combined with free ones (T-28): admissible orientations and angular velocities.
//!
//! Rotations are about the world's axes, so a prescribed rotation is no component of a body's rotation but a
//! constraint on the whole: with one free axis the body rotates about that axis, with two about any axis in their
//! plane.

use crate::math::{Quat, Vec3, rotation};
use crate::model::Mount;

/// Returns the constraints `n · ω = n · R ω_target` of prescribed rotations: their axes and unit vectors `n`.
///
/// `R`, the rotation `turn`, leads from the target to the body.
pub fn constraints(mount: &Mount, turn: &Quat) -> Vec<(usize, Vec3)> {
    let (free, held) = axes(mount);
    let condition = |k: &usize| {
        let axis = Vec3::ith(*k, 1.0);
        let n = if free.len() == 2 { axis * turn.w - axis.cross(&turn.imag()) } else { axis };
        (*k, n)
    };
    held.iter().map(condition).collect()
}

/// Returns the angular velocity of a unit rate of the free rotation `k` that meets the constraints of a target at
/// rest.
pub fn constrained_rotation(constraints: &[(usize, Vec3)], k: usize) -> Vec3 {
    let mut angular_velocity = Vec3::ith(k, 1.0);
    for (held, n) in constraints {
        angular_velocity[*held] -= n[k] / n[*held];
    }
    angular_velocity
}

/// Returns the admissible orientation nearest to `q`. Prevents rounding from accumulating over steps.
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

/// Returns the free and the prescribed rotations.
fn axes(mount: &Mount) -> (Vec<usize>, Vec<usize>) {
    let modes = mount.rotations();
    (0..3).partition(|k| !modes[*k].is_prescribed())
}
