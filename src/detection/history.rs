//! Impulses and overlaps that the contacts of a step have from the last one.

use crate::math::Vec3;

/// Speed with which springs take up overlap that the last step did not foresee, m/s (T-42).
///
/// A rotation, or another point of the same two bodies, may reveal an overlap at once. Its spring would throw the bodies
/// apart with energy from no source.
const RECOVERY_SPEED: f64 = 0.01;

/// Impulses and overlaps of the contacts of a step in the last one.
#[derive(Debug, Clone, Default)]
pub struct ContactHistory {
    /// Impulse on the candidate in the last step, world axes, N s `[nc]`; zero for a new contact.
    pub impulse: Vec<Vec3>,
    /// Overlap of the contact's spring where the last step ended, m `[nc]`.
    ///
    /// Points of a pair come and go: those that come share the energy of those that have gone.
    pub overlap: Vec<f64>,
}

impl ContactHistory {
    /// Returns the gap that the spring of contact `i` starts a step of `h` seconds with, m, where its bodies have `gap`.
    pub fn spring_gap(&self, i: usize, gap: f64, h: f64) -> f64 {
        gap.max(-self.overlap[i] - RECOVERY_SPEED * h)
    }

    /// Inserts a new contact at place `i`.
    pub(super) fn insert(&mut self, i: usize) {
        self.impulse.insert(i, Vec3::zeros());
        self.overlap.insert(i, 0.0);
    }
}
