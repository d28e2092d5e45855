//! Failures of the program with their exit codes.
//!
//! 0 success · 1 failure · 2 usage · 3 invalid case · 4 transport or deadline · 5 verification mismatch · 6 incompatible
//! version · 130 interrupted after a clean checkpoint; a second Ctrl-C after a second aborts with 1.

use ballast_scenario::CaseErrors;
use std::fmt::Display;
use std::path::Path;

/// Failure of a command, with a message for the user.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// General failure.
    #[error("{0}")]
    Failed(String),
    /// Wrong usage of the command line.
    #[error("{0}")]
    Usage(String),
    /// Invalid case.
    #[error("{0}")]
    InvalidCase(String),
    /// Invalid case, with positions in the case file.
    #[error(transparent)]
    Case(#[from] CaseErrors),
    /// Failure of the transport, or a missed deadline.
    #[error("{0}")]
    Transport(String),
    /// Result that differs from the expected one.
    #[error("{0}")]
    Mismatch(String),
    /// File of an incompatible version.
    #[error("{0}")]
    Incompatible(String),
    /// Interrupt by the user.
    #[error("{0}")]
    Interrupted(String),
}

/// Result of a fallible operation of the program.
pub type Result<T = (), E = Failure> = std::result::Result<T, E>;

impl Failure {
    /// Creates a general failure about `path`.
    pub fn at(path: &Path, what: impl Display) -> Self {
        Failure::Failed(format!("{}: {what}", path.display()))
    }

    /// Returns the failure with `more` appended to its message.
    pub fn with(mut self, more: &str) -> Self {
        let text = match &mut self {
            Failure::Case(errors) => return Failure::InvalidCase(format!("{errors}{more}")),
            Failure::Failed(text)
            | Failure::Usage(text)
            | Failure::InvalidCase(text)
            | Failure::Transport(text)
            | Failure::Mismatch(text)
            | Failure::Incompatible(text)
            | Failure::Interrupted(text) => text,
        };
        *text += more;
        self
    }

    /// Exit code of the process.
    pub fn code(&self) -> u8 {
        match self {
            Failure::Failed(_) => 1,
            Failure::Usage(_) => 2,
            Failure::InvalidCase(_) | Failure::Case(_) => 3,
            Failure::Transport(_) => 4,
            Failure::Mismatch(_) => 5,
            Failure::Incompatible(_) => 6,
            Failure::Interrupted(_) => 130,
        }
    }

    /// Name of the failure in events.
    pub fn word(&self) -> &'static str {
        match self {
            Failure::Failed(_) => "failed",
            Failure::Usage(_) => "usage",
            Failure::InvalidCase(_) | Failure::Case(_) => "invalid case",
            Failure::Transport(_) => "transport or deadline",
            Failure::Mismatch(_) => "verification mismatch",
            Failure::Incompatible(_) => "incompatible version",
            Failure::Interrupted(_) => "interrupted",
        }
    }
}

impl From<ballast::Error> for Failure {
    fn from(error: ballast::Error) -> Self {
        match error {
            ballast::Error::Stopped(_) => Failure::Interrupted(error.to_string()),
            _ => Failure::Failed(error.to_string()),
        }
    }
}

impl From<ballast_hdf5::Error> for Failure {
    fn from(error: ballast_hdf5::Error) -> Self {
        match error {
            ballast_hdf5::Error::Version { .. } => Failure::Incompatible(error.to_string()),
            _ => Failure::Failed(error.to_string()),
        }
    }
}

impl From<ballast_scenario::OverrideError> for Failure {
    fn from(unknown: ballast_scenario::OverrideError) -> Self {
        Failure::Incompatible(format!("choices of the run: {unknown}"))
    }
}

impl From<ballast_beds::Error> for Failure {
    fn from(error: ballast_beds::Error) -> Self {
        use ballast_beds::Error;
        let hint = "delete it, or prepare it again with `ballast prepare CASE --force` (and the same `--bed-cache`)";
        match error {
            Error::Read(e) => Failure::from(e).with(&format!("; {hint}")),
            Error::Write(e) => e.into(),
            Error::Mismatch { .. } => Failure::Failed(format!("{error}; {hint}")),
            Error::Scene { .. } => Failure::InvalidCase(error.to_string()),
            Error::Preparation { source: ballast::Error::Geometry { .. }, .. } => {
                Failure::InvalidCase(format!("{error}; change the shape of grains in [bed.grains]"))
            }
            Error::Preparation { source: ballast::Error::Model { .. }, .. } => {
                Failure::InvalidCase(error.to_string())
            }
            Error::Folder { .. } | Error::Preparation { .. } => Failure::Failed(error.to_string()),
        }
    }
}

impl From<ballast_mcap::Error> for Failure {
    fn from(error: ballast_mcap::Error) -> Self {
        match error {
            ballast_mcap::Error::Version { .. } => Failure::Incompatible(error.to_string()),
            _ => Failure::Failed(error.to_string()),
        }
    }
}

#[cfg(feature = "zenoh")]
impl From<ballast_zenoh::Error> for Failure {
    fn from(error: ballast_zenoh::Error) -> Self {
        match error {
            ballast_zenoh::Error::InvalidName { .. } => Failure::Usage(error.to_string()),
            _ => Failure::Transport(error.to_string()),
        }
    }
}
