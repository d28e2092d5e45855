//! What is recomputed in each step: never saved, allocations reused.

use crate::detection::Contacts;
use crate::math::Vec3;

/// Buffers of a step. After a step they hold what observables read.
#[derive(Debug, Default)]
pub struct Workspace {
    /// Contacts of the step, at its configuration m.
    pub contacts: Contacts,
    /// Impulse on the candidate of each contact, components (n, t, s) in the frame of
    /// [`crate::math::frame::tangents`], N s `[nc]`.
    pub impulse: Vec<Vec3>,
}
