//! Imposed motion and loads: what a step is told about the driven bodies.

mod speed_limit;

pub use speed_limit::SpeedLimit;

use crate::math::{Pose, Vec3};

/// Force (N) and torque about the reference point (N m), world axes, constant over a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load {
    pub force: Vec3,
    pub torque: Vec3,
}

impl Load {
    /// No load.
    pub fn zero() -> Self {
        Self { force: Vec3::zeros(), torque: Vec3::zeros() }
    }

    /// Whether every component is a number.
    pub fn is_finite(&self) -> bool {
        self.force.iter().chain(&self.torque).all(|x| x.is_finite())
    }
}

/// Inputs of one step.
#[derive(Debug, Clone, Copy)]
pub struct StepInputs<'a> {
    /// Pose of each driven body at the end of the step `[nd]`.
    ///
    /// Its velocity during the step is the constant one that ends exactly there (T-4), so imposed
    /// motion never drifts.
    ///
    /// Of a mounted body: the pose of its mount; degrees of freedom that are loaded do not mind it.
    pub targets: &'a [Pose],
    /// Load on each mounted body, besides gravity `[nm]`; empty: none. It moves the degrees of freedom
    /// that are not held.
    pub loads: &'a [Load],
    /// How far a body may be led, or moved by its loads, in the step; `None`: any distance.
    pub speed_limit: Option<&'a SpeedLimit>,
}

impl<'a> StepInputs<'a> {
    /// These targets, without loads and at any speed.
    pub fn from_targets(targets: &'a [Pose]) -> Self {
        Self { targets, loads: &[], speed_limit: None }
    }
}
