//! Requests without a reply.

use ballast_protocol::lockstep::{ParameterUpdate, WindowKind};
use ballast_protocol::messages::AdvanceRequest;
use std::sync::Arc;

/// Request whose reply is missing; it may have been executed.
#[derive(Clone, PartialEq)]
pub(super) enum PendingRequest {
    Window(WindowKind, Arc<AdvanceRequest>),
    Parameters(ParameterUpdate),
}

/// Effect of a request on the run.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Effect {
    /// Continues from the current position.
    Continues,
    /// Jumps to a saved state.
    Restores,
    /// Starts a new run.
    StartsRun,
}
