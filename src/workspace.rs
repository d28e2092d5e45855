//! What is recomputed in each step: never saved, allocations reused.
//!
//! Nothing here changes the next step: a step with a fresh workspace gives the same bytes.

use crate::ddm::Decomposition;
use crate::detection::{Contacts, DetectionRange, Detector};
use crate::local_problem::LocalProblem;
use crate::math::Vec3;
use crate::motion::Motion;
use crate::state::State;

/// Buffers of a step. After a step they hold what observables read.
#[derive(Debug, Default)]
pub struct Workspace {
    /// Configuration m and free velocities of the step.
    pub motion: Motion,
    /// Contacts of the step, at configuration m `[nc]`.
    pub contacts: Contacts,
    /// Impulse on the candidate of each contact, world axes, N s `[nc]`: what the solve started
    /// from during the step, its result after it.
    pub impulse: Vec<Vec3>,
    pub(crate) detector: Detector,
    /// How far around each body contacts are looked for.
    pub(crate) detection_range: DetectionRange,
    /// Contacts of bodies that turned out faster than that.
    pub(crate) fresh: Contacts,
    /// Contacts of where bodies that turn fast end the step, as seen from configuration m.
    pub(crate) foreseen: Contacts,
    /// Configuration m of the next step, in steps in which bodies turn fast.
    pub(crate) end: Motion,
    pub(crate) decomposition: Decomposition,
    pub(crate) problem: LocalProblem,
    /// Buffers of the penetration correction; empty without one.
    pub(crate) correction: CorrectionBuffers,
    /// Velocities of the mobile bodies at the end of the step `[ng + nm]`, m/s and rad/s.
    pub(crate) velocity: Vec<Vec3>,
    pub(crate) angular_velocity: Vec<Vec3>,
    /// Memory for the state at the end of the step; nothing in it is read.
    pub(crate) next: State,
}

/// Buffers of the penetration correction (T-34).
#[derive(Debug, Default)]
pub(crate) struct CorrectionBuffers {
    pub problem: LocalProblem,
    /// Velocities that last for the step, of the mobile bodies `[ng + nm]`, m/s and rad/s.
    pub velocity: Vec<Vec3>,
    pub angular_velocity: Vec<Vec3>,
}

impl Workspace {
    /// The contact problem of the last step.
    pub fn problem(&self) -> &LocalProblem {
        &self.problem
    }

    /// How the last step was divided.
    pub fn partition(&self) -> &crate::partition::Partition {
        self.decomposition.partition()
    }
}
