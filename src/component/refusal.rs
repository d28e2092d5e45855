//! Reasons for which a request is refused.

use crate::error::Error;

/// Refused request; nothing has changed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The end of the window is not a later time on the grid of steps.
    #[error(
        "time: expected a whole number of steps of {step_ns} ns after {now_ns} ns (next to it: \
         {} and {} ns), found {found_ns} ns",
        nearest_ns[0],
        nearest_ns[1]
    )]
    Time {
        /// Time of the component, ns.
        now_ns: u64,
        /// Length of a step, ns.
        step_ns: u64,
        /// Times on the grid before and after the requested one, ns.
        nearest_ns: [u64; 2],
        /// Requested end of the window, ns.
        found_ns: u64,
    },
    /// The input of a body does not cover the window.
    #[error("input of {body:?}: expected {expected}, found {found}")]
    Gap {
        /// Name of the body.
        body: String,
        /// Values that are accepted.
        expected: String,
        /// Value found.
        found: String,
    },
    /// The input does not continue the window before.
    #[error("input of {body:?}: expected {expected}, found {found}")]
    Jump {
        /// Name of the body.
        body: String,
        /// Values that are accepted.
        expected: String,
        /// Value found.
        found: String,
    },
    /// The input cannot be used.
    #[error("input of {body:?}: expected {expected}, found {found}")]
    Input {
        /// Name of the body.
        body: String,
        /// Values that are accepted.
        expected: String,
        /// Value found.
        found: String,
    },
    /// No driven body has this name.
    #[error("input: expected one of {known:?}, found {found:?}")]
    UnknownBody {
        /// Names of the driven bodies.
        known: Vec<String>,
        /// Name found.
        found: String,
    },
    /// No window has been computed since the start or the last restore.
    #[error("redo: expected a window before this one, found none")]
    NothingToRedo,
    /// The observer cancelled the window, as if it had not been requested.
    #[error("window: cancelled by its observer")]
    Cancelled,
    /// The model or the state cannot be used.
    #[error(transparent)]
    Core(#[from] Error),
}

impl Refusal {
    /// Returns the code of the refusal in messages.
    pub fn code(&self) -> &'static str {
        match self {
            Refusal::Time { .. } => "time_grid",
            Refusal::Gap { .. } => "input_gap",
            Refusal::Jump { .. } => "input_jump",
            Refusal::Input { .. } => "input_invalid",
            Refusal::UnknownBody { .. } => "unknown_body",
            Refusal::NothingToRedo => "nothing_to_redo",
            Refusal::Cancelled => "cancelled",
            Refusal::Core(_) => "state_invalid",
        }
    }

    pub(super) fn input(body: &str, expected: impl Into<String>, found: impl Into<String>) -> Self {
        Self::Input { body: body.into(), expected: expected.into(), found: found.into() }
    }
}
