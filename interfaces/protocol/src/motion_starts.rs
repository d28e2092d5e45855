//! Pose and twist with which the next motion of each driven body begins, as a client follows them from window to window.

use crate::MessageError;
use crate::description::{BodyDescription, ComponentDescription};
use ballast::component::{MotionInput, Twist};
use ballast::math::Pose;

/// Returns the motion starts of a component as described `[nd]`; any twist may follow a linear motion.
///
/// # Errors
/// An orientation that is none.
pub fn motion_starts(
    description: &ComponentDescription,
) -> Result<Vec<(Pose, Option<Twist>)>, MessageError> {
    let start = |body: &BodyDescription| {
        let orientation = body.orientation.try_into()?;
        let pose = Pose { position: body.position.into(), orientation };
        Ok((pose, body.twist.map(Into::into)))
    };
    description.bodies.iter().map(start).collect()
}

/// Returns the motion starts after a window with these inputs that has ended at `end_ns` `[nd]`.
///
/// `starts` are those before the window, `bodies` the names of the driven bodies `[nd]`.
pub fn motion_starts_after(
    starts: &[(Pose, Option<Twist>)],
    bodies: &[String],
    inputs: &[MotionInput],
    end_ns: u64,
) -> Vec<(Pose, Option<Twist>)> {
    let after = |(name, (pose, _)): (&String, &(Pose, Option<Twist>))| match inputs
        .iter()
        .find(|input| input.body == *name)
    {
        Some(input) => (input.waveform.pose(end_ns), input.waveform.twist(end_ns)),
        None => (*pose, Some(Twist::default())),
    };
    bodies.iter().zip(starts).map(after).collect()
}
