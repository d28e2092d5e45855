//! Exponential and logarithm of rotations (T-3).
//!
//! Sines and arctangents are libm's, because those of operating systems differ in the last bit (decision 002).

use super::{Quat, Vec3};

/// Returns the rotation by the vector `angle` (rad, world axes): `exp(angle)`.
///
/// Series below 1e-4 rad, where `sin(x)/x` by division would lose digits.
pub fn exp(angle: &Vec3) -> Quat {
    let half_squared = 0.25 * angle.norm_squared();
    let (scalar, ratio) = if half_squared < 2.5e-9 {
        (1.0 - 0.5 * half_squared, 0.5 * (1.0 - half_squared / 6.0))
    } else {
        let half = half_squared.sqrt();
        let (sine, cosine) = libm::sincos(half);
        (cosine, 0.5 * sine / half)
    };
    let v = angle * ratio;
    Quat::new_normalize(nalgebra::Quaternion::new(scalar, v.x, v.y, v.z))
}

/// Returns the shortest rotation vector of `q` (rad): `exp(log(q)) = q`.
pub fn log(q: &Quat) -> Vec3 {
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    let v = Vec3::new(q.i, q.j, q.k) * sign;
    let sine = v.norm();
    let factor = if sine < 1e-8 { 2.0 } else { 2.0 * libm::atan2(sine, q.w * sign) / sine };
    v * factor
}

/// Returns `exp(angle) q`, renormalised.
pub fn advance(q: &Quat, angle: &Vec3) -> Quat {
    Quat::new_normalize((exp(angle) * q).into_inner())
}

/// Returns the rate of the rotation vector `phi` of a body that rotates with `angular_velocity` (world axes).
///
/// Inverse of the left Jacobian of the exponential map. Source: Sola, Deray, Atchuthan, *A micro Lie theory for state
/// estimation in robotics*, 2018, equation 146.
pub fn rotation_vector_rate(phi: &Vec3, angular_velocity: &Vec3) -> Vec3 {
    let squared = phi.norm_squared();
    let factor = if squared < 1e-6 {
        1.0 / 12.0 + squared / 720.0
    } else {
        let angle = squared.sqrt();
        1.0 / squared - 0.5 / (angle * libm::tan(0.5 * angle))
    };
    let once = phi.cross(angular_velocity);
    angular_velocity - once * 0.5 + phi.cross(&once) * factor
}

/// Returns the angular velocity (world axes) of a body whose rotation vector `phi` has this rate.
///
/// Inverse of [`rotation_vector_rate`]: left Jacobian of the exponential map. Source: Sola, Deray, Atchuthan,
/// equation 145.
pub fn angular_velocity_from_rate(phi: &Vec3, rate: &Vec3) -> Vec3 {
    let squared = phi.norm_squared();
    let (first, second) = if squared < 1e-6 {
        (0.5 - squared / 24.0, 1.0 / 6.0 - squared / 120.0)
    } else {
        let angle = squared.sqrt();
        let (sine, cosine) = libm::sincos(angle);
        ((1.0 - cosine) / squared, (angle - sine) / (squared * angle))
    };
    let once = phi.cross(rate);
    rate + once * first + phi.cross(&once) * second
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_of_vectors_are_those_of_their_rotations() {
        for angle in [0.0, 1e-4, 0.3, 1.9, 3.0] {
            let phi = Vec3::new(0.36, -0.48, 0.8) * angle;
            let angular_velocity = Vec3::new(1.0, 5.0, -2.0);
            let rate = rotation_vector_rate(&phi, &angular_velocity);
            let ahead = log(&advance(&exp(&phi), &(angular_velocity * 1e-6)));
            assert!((rate - (ahead - phi) / 1e-6).norm() < 1e-4, "{angle}: {rate:?}");
            assert!(
                (angular_velocity_from_rate(&phi, &rate) - angular_velocity).norm() < 1e-13,
                "{angle}"
            );
        }
    }

    #[test]
    fn log_inverts_exp_from_tiny_to_nearly_half_a_turn() {
        for angle in [0.0, 1e-12, 1e-7, 1e-4, 0.3, 2.0, 3.1] {
            let v = Vec3::new(0.36, -0.48, 0.8) * angle;
            let back = log(&exp(&v));
            assert!((back - v).norm() < 1e-14 + 1e-15 * angle, "{angle}: {back:?}");
        }
    }
}
