//! Exponential and logarithm of rotations (T-3).

use super::{Quat, Vec3};

/// Rotation by the vector `angle` (rad, world axes): `exp(angle)`.
///
/// Series below 1e-4 rad, where `sin(x)/x` by division would lose digits.
pub fn exp(angle: &Vec3) -> Quat {
    let half_squared = 0.25 * angle.norm_squared();
    let (scalar, ratio) = if half_squared < 2.5e-9 {
        (1.0 - 0.5 * half_squared, 0.5 * (1.0 - half_squared / 6.0))
    } else {
        let half = half_squared.sqrt();
        (half.cos(), 0.5 * half.sin() / half)
    };
    let v = angle * ratio;
    Quat::new_normalize(nalgebra::Quaternion::new(scalar, v.x, v.y, v.z))
}

/// Rotation vector of `q` (rad), the shortest one: `exp(log(q)) = q`.
pub fn log(q: &Quat) -> Vec3 {
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    let v = Vec3::new(q.i, q.j, q.k) * sign;
    let sine = v.norm();
    let factor = if sine < 1e-8 { 2.0 } else { 2.0 * sine.atan2(q.w * sign) / sine };
    v * factor
}

/// `exp(angle) q`, renormalised.
pub fn advance(q: &Quat, angle: &Vec3) -> Quat {
    Quat::new_normalize((exp(angle) * q).into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_inverts_exp_from_tiny_to_nearly_half_a_turn() {
        for angle in [0.0, 1e-12, 1e-7, 1e-4, 0.3, 2.0, 3.1] {
            let v = Vec3::new(0.36, -0.48, 0.8) * angle;
            let back = log(&exp(&v));
            assert!((back - v).norm() < 1e-14 + 1e-15 * angle, "{angle}: {back:?}");
        }
    }
}
