//! Inputs of a step: imposed motion and loads of the driven bodies.

mod speed_limit;

pub use speed_limit::SpeedLimit;

use crate::math::{Pose, Vec3};

/// Force (N) and torque about the reference point (N m), world axes, constant over a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    /// Force, world axes, N.
    pub force: Vec3,
    /// Torque about the reference point, world axes, N m.
    pub torque: Vec3,
}

impl Load {
    /// Returns zero force and torque.
    pub fn zero() -> Self {
        Self { force: Vec3::zeros(), torque: Vec3::zeros() }
    }

    /// True if every component is finite.
    pub fn is_finite(&self) -> bool {
        self.force.iter().chain(&self.torque).all(|x| x.is_finite())
    }
}

/// Inputs of one step.
#[derive(Debug, Clone, Copy)]
pub struct StepInputs<'a> {
    /// Pose of each driven body at the end of the step `[nd]`; for a mounted body the pose of its mount.
    ///
    /// The velocity during the step is the constant one that ends exactly there (T-4), so imposed motion never
    /// drifts. Free degrees of freedom of a mount ignore it.
    pub targets: &'a [Pose],
    /// Load on each mounted body, in addition to gravity `[nm]`; empty for none. It acts on the degrees of freedom
    /// that are not prescribed.
    pub loads: &'a [Load],
    /// Limit of the displacement of a driven body in the step; `None` for no limit.
    pub speed_limit: Option<&'a SpeedLimit>,
    /// True to start the iterations from zero impulses instead of those of the last step.
    pub zero_start: bool,
}

impl<'a> StepInputs<'a> {
    /// Returns these targets without loads and without a speed limit.
    pub fn from_targets(targets: &'a [Pose]) -> Self {
        Self { targets, loads: &[], speed_limit: None, zero_start: false }
    }
}
