//! Checks of recorded values.

use ballast::math::Quat;
use ballast_protocol::MessageError;
use ballast_protocol::messages::{Pose, Quaternion, Twist};

/// Maximum deviation of the squared length of a quaternion from 1, that of tf2 (`QUATERNION_NORMALIZATION_TOLERANCE`).
const MAX_SQUARED_LENGTH_ERROR: f64 = 10e-3;
/// Maximum deviation of the length from 1 at which a quaternion is not normalised, so that exact recordings stay exact.
const EXACT_LENGTH_ERROR: f64 = 1e-9;
/// Maximum deviation of the length from 1 that is not reported: the accuracy of 32-bit numbers.
pub(super) const MIN_NOTED_LENGTH_ERROR: f64 = 1e-6;

/// Advice for a message with an unusable value.
pub(super) const LEAVE_OUT: &str =
    "correct or leave out such messages (motions are interpolated between the others)";

/// Checks a pose; `names` are those of its position and orientation.
///
/// # Errors
/// Numbers that are not finite, and quaternions too far from unit length.
pub(super) fn check_pose(
    [position, orientation]: [&str; 2],
    pose: &Pose,
) -> Result<(), MessageError> {
    let (p, q) = (&pose.position, &pose.orientation);
    check_finite(position, [("x", p.x), ("y", p.y), ("z", p.z)])?;
    check_finite(orientation, [("x", q.x), ("y", q.y), ("z", q.z), ("w", q.w)])?;
    let length = length(q);
    if (length * length - 1.0).abs() < MAX_SQUARED_LENGTH_ERROR {
        return Ok(());
    }
    let expected = format!(
        "a unit quaternion (x, y, z, w), its squared length within {MAX_SQUARED_LENGTH_ERROR} of 1"
    );
    let found = format!("({}, {}, {}, {}) of length {length}; {LEAVE_OUT}", q.x, q.y, q.z, q.w);
    Err(MessageError::new(orientation, expected, found))
}

/// Checks a twist.
///
/// # Errors
/// Numbers that are not finite.
pub(super) fn check_twist(twist: &Twist) -> Result<(), MessageError> {
    for (name, v) in [("twist.linear", &twist.linear), ("twist.angular", &twist.angular)] {
        check_finite(name, [("x", v.x), ("y", v.y), ("z", v.z)])?;
    }
    Ok(())
}

fn check_finite<const N: usize>(name: &str, parts: [(&str, f64); N]) -> Result<(), MessageError> {
    match parts.into_iter().find(|(_, value)| !value.is_finite()) {
        Some((axis, value)) => {
            let found = format!("{value}; {LEAVE_OUT}");
            Err(MessageError::new(format!("{name}.{axis}"), "a finite number", found))
        }
        None => Ok(()),
    }
}

/// Returns the length of a quaternion.
pub(super) fn length(q: &Quaternion) -> f64 {
    nalgebra::Quaternion::new(q.w, q.x, q.y, q.z).norm()
}

/// Returns a checked quaternion, normalised unless it is exact.
pub(super) fn unit(q: &Quaternion) -> Quat {
    let plain = nalgebra::Quaternion::new(q.w, q.x, q.y, q.z);
    match (length(q) - 1.0).abs() <= EXACT_LENGTH_ERROR {
        true => Quat::new_unchecked(plain),
        false => Quat::new_normalize(plain),
    }
}
