//! Errors of couplings.

use crate::partner::PartnerError;
use ballast_protocol::lockstep::ErrorCode;
use ballast_protocol::messages::AdvanceReply;

/// Error of a coupling.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A setting is out of range.
    #[error("{name}: expected {expected}, found {found}")]
    InvalidSetting {
        /// Name of the setting.
        name: &'static str,
        /// Values that are accepted.
        expected: &'static str,
        /// Value found.
        found: String,
    },
    /// The partner moves a body that it cannot move.
    #[error("{body}: expected {expected}, found {found}")]
    InvalidBody {
        /// Name of the body.
        body: String,
        /// Values that are accepted.
        expected: &'static str,
        /// Value found.
        found: &'static str,
    },
    /// The partner cannot compute the window.
    #[error("partner: {0}")]
    Partner(PartnerError),
    /// The component has refused the window, or has not replied.
    #[error(transparent)]
    Request(#[from] ballast_zenoh::Error),
    /// The component has not computed the window to its end.
    #[error("window {}: {:?}, {}", .0.seq, .0.status, .0.message)]
    Window(Box<AdvanceReply>),
}

impl Error {
    /// Returns true if the component does not follow the motion, and may follow another.
    pub(crate) fn concerns_motion(&self) -> bool {
        match self {
            Self::Window(_) => true,
            Self::Request(ballast_zenoh::Error::Rejected(refusal)) => {
                refusal.code == ErrorCode::InputInvalid
            }
            _ => false,
        }
    }
}
