//! Comparison of the forces of two solutions of a step (T-43).

use crate::integrate::Reaction;
use crate::model::{Model, Role};

/// Comparison of the impulses on tines and sleepers between two solutions of one step: one from the impulses of the last
/// step, one from zero (T-43).
///
/// Where impulses are not unique, or iterations end before they are found, the two differ.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ForceCheck {
    /// Sum of the magnitudes of the differences, N s.
    pub difference: f64,
    /// Sum of the magnitudes of the impulses, N s.
    pub total: f64,
}

impl ForceCheck {
    /// Compares the reactions of two solutions of a step.
    pub(crate) fn new(model: &Model, solved: &[Reaction], from_zero: &[Reaction]) -> Self {
        let mut check = Self::default();
        let both = solved.iter().zip(from_zero);
        for (body, (a, b)) in model.driven.iter().zip(both) {
            if body.role != Role::Boundary {
                check.difference += (a.impulse - b.impulse).norm();
                check.total += a.impulse.norm();
            }
        }
        check
    }
}
