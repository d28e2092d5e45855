//! Workspace of a step: buffers that each step recomputes, never saved, allocations reused.
//!
//! The content has no effect on the next step: a step with a fresh workspace gives the same bytes.

use crate::ddm::Decomposition;
use crate::detection::{ContactHistory, Contacts, DetectionRange, Detector};
use crate::local_problem::LocalProblem;
use crate::math::Vec3;
use crate::motion::Motion;
use crate::state::State;

/// Buffers of a step. After a step they hold the data that observables read.
#[derive(Debug, Default)]
pub struct Workspace {
    /// Configuration m and free velocities of the step.
    pub motion: Motion,
    /// Contacts of the step, at configuration m `[nc]`.
    pub contacts: Contacts,
    /// Impulse on the candidate of each contact, world axes, N s `[nc]`: the initial guess during the step, the
    /// solution after it.
    pub impulse: Vec<Vec3>,
    /// Impulses and overlaps of the contacts in the last step.
    pub(crate) history: ContactHistory,
    /// Overlap of each contact's spring at the end of the step, m `[nc]`; zero where it is rigid.
    pub(crate) overlap: Vec<f64>,
    pub(crate) detector: Detector,
    /// Detection range of each body.
    pub(crate) detection_range: DetectionRange,
    /// Contacts of bodies that were faster than their detection range allows for.
    pub(crate) fresh: Contacts,
    /// Contacts at the end-of-step configuration of fast-rotating bodies, seen from configuration m.
    pub(crate) foreseen: Contacts,
    /// Configuration m of the next step, in steps with fast-rotating bodies.
    pub(crate) end: Motion,
    pub(crate) decomposition: Decomposition,
    pub(crate) problem: LocalProblem,
    /// Buffers of the penetration correction; empty without one.
    pub(crate) correction: CorrectionBuffers,
    /// Velocities of the mobile bodies at the end of the step `[ng + nm]`, m/s.
    pub(crate) velocity: Vec<Vec3>,
    /// Angular velocities of the mobile bodies at the end of the step `[ng + nm]`, rad/s.
    pub(crate) angular_velocity: Vec<Vec3>,
    /// Memory for the state at the end of the step; its content is never read.
    pub(crate) next: State,
}

/// Buffers of the penetration correction (T-34).
#[derive(Debug, Default)]
pub(crate) struct CorrectionBuffers {
    /// Position-level problem.
    pub problem: LocalProblem,
    /// Correction velocities of the mobile bodies, which last for the step `[ng + nm]`, m/s.
    pub velocity: Vec<Vec3>,
    /// Angular correction velocities of the mobile bodies `[ng + nm]`, rad/s.
    pub angular_velocity: Vec<Vec3>,
}

impl Workspace {
    /// Contact problem of the last step.
    pub fn problem(&self) -> &LocalProblem {
        &self.problem
    }

    /// Partition of the last step.
    pub fn partition(&self) -> &crate::partition::Partition {
        self.decomposition.partition()
    }
}
