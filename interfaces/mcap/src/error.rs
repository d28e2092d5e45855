//! Errors of reading and writing recordings.

use ballast_protocol::MessageError;
use std::path::{Path, PathBuf};

/// Error of reading or writing a recording.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file operation that failed.
    #[error("{path}: cannot {action}: {source}")]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// Name of the operation.
        action: &'static str,
        /// Reason given by the system.
        source: std::io::Error,
    },
    /// A file that is damaged, or no MCAP file.
    #[error("{path}: {place}: expected {expected}, found {found}")]
    Damaged {
        /// Path of the file.
        path: PathBuf,
        /// Position in the file.
        place: String,
        /// Expected content.
        expected: String,
        /// Found content.
        found: String,
    },
    /// A valid file that cannot be used for the requested purpose.
    #[error("{path}: {place}: expected {expected}, found {found}")]
    Unsuitable {
        /// Path of the file.
        path: PathBuf,
        /// Position in the file.
        place: String,
        /// Expected content.
        expected: String,
        /// Found content.
        found: String,
    },
    /// A recording in another version of the format.
    #[error("{path}: format of the recording: expected {expected}, found {found}")]
    Version {
        /// Path of the file.
        path: PathBuf,
        /// Expected content.
        expected: String,
        /// Found content.
        found: String,
    },
    /// A message that cannot be written.
    #[error("{path}: not written: {0}", path = .1.display())]
    Refused(MessageError, PathBuf),
    /// A start of the recording for which no checkpoint could be created.
    #[error("{0}")]
    Start(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// A window of the recording that cannot be computed.
    #[error("{path}: window {seq}: {refusal}")]
    Window {
        /// Path of the file.
        path: PathBuf,
        /// Number of the window.
        seq: u64,
        /// Reason of the refusal.
        refusal: String,
    },
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    pub(crate) fn damaged(
        path: &Path,
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Self::Damaged {
            path: path.into(),
            place: place.into(),
            expected: expected.into(),
            found: found.to_string(),
        }
    }

    pub(crate) fn unsuitable(
        path: &Path,
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Self::Unsuitable {
            path: path.into(),
            place: place.into(),
            expected: expected.into(),
            found: found.to_string(),
        }
    }

    pub(crate) fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io { path: path.into(), action, source }
    }

    /// Creates the error of an invalid message in the file.
    pub(crate) fn message(path: &Path, topic: &str, time_ns: u64, fault: MessageError) -> Self {
        let place = format!("{topic} at {time_ns} ns, {}", fault.place);
        Self::damaged(path, place, fault.expected, fault.found)
    }
}
