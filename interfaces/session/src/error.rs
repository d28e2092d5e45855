//! How the program ends: every failure, its word and its exit code, decided here alone.
//!
//! 0 done · 1 failed · 2 usage · 3 invalid case · 4 transport or deadline · 5 verification
//! mismatch · 6 incompatible version · 130 interrupted, after a clean checkpoint; who does not wait
//! for that and asks again after a second gets 1.

use ballast_scenario::CaseErrors;
use std::fmt::Display;
use std::path::Path;

/// Why the program does not end with 0. The text is for the person at the terminal.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    #[error("{0}")]
    Failed(String),
    #[error("{0}")]
    Usage(String),
    #[error("{0}")]
    InvalidCase(String),
    /// The same, with the places in the case file.
    #[error(transparent)]
    Case(#[from] CaseErrors),
    /// Without the feature `zenoh` no command speaks over a transport.
    #[cfg_attr(not(feature = "zenoh"), allow(dead_code))]
    #[error("{0}")]
    Transport(String),
    #[error("{0}")]
    Mismatch(String),
    #[error("{0}")]
    Incompatible(String),
    #[error("{0}")]
    Interrupted(String),
}

/// Result of a fallible operation of the program.
pub type Result<T = (), E = Failure> = std::result::Result<T, E>;

impl Failure {
    /// Something went wrong with `path`.
    pub fn at(path: &Path, what: impl Display) -> Self {
        Failure::Failed(format!("{}: {what}", path.display()))
    }

    /// The same with more to say.
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

    /// The process's exit code.
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

    /// The failure's word in events.
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
        Failure::Incompatible(format!("what was chosen for the run, {unknown}"))
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
