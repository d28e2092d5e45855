//! Imposed motion: what a step is told about the driven bodies.

use crate::math::Pose;

/// Inputs of one step.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// Pose of each driven body at the end of the step `[nd]`.
    ///
    /// Its velocity during the step is the constant one that ends exactly there (T-4), so imposed
    /// motion never drifts.
    pub targets: &'a [Pose],
}
