//! What can go wrong with a recording: which file, where in it, what was expected and what was found.

use ballast_protocol::MessageError;
use std::path::{Path, PathBuf};

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused: no such file, no room, no permission.
    #[error("{path}: cannot {action}: {source}")]
    Io { path: PathBuf, action: &'static str, source: std::io::Error },
    /// The file is damaged, or no MCAP file.
    #[error("{path}: {place}: expected {expected}, found {found}")]
    Damaged { path: PathBuf, place: String, expected: String, found: String },
    /// The file is sound, but not what was asked for.
    #[error("{path}: {place}: expected {expected}, found {found}")]
    Unsuitable { path: PathBuf, place: String, expected: String, found: String },
    /// The recording was written in a format that this program does not read.
    #[error("{path}: format of the recording: expected {expected}, found {found}")]
    Version { path: PathBuf, expected: String, found: String },
    /// What was to be written makes no sense.
    #[error("{path}: not written: {0}", path = .1.display())]
    Refused(MessageError, PathBuf),
    /// There is no checkpoint of what the recording begins with; it says why itself.
    #[error("{0}")]
    Start(#[source] Box<dyn std::error::Error + Send + Sync>),
    /// A window of the recording cannot be computed.
    #[error("{path}: window {seq}: {refusal}")]
    Window { path: PathBuf, seq: u64, refusal: String },
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
        let (place, expected, found) = (place.into(), expected.into(), found.to_string());
        Self::Damaged { path: path.into(), place, expected, found }
    }

    pub(crate) fn unsuitable(
        path: &Path,
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        let (place, expected, found) = (place.into(), expected.into(), found.to_string());
        Self::Unsuitable { path: path.into(), place, expected, found }
    }

    pub(crate) fn io(path: &Path, action: &'static str, source: std::io::Error) -> Self {
        Self::Io { path: path.into(), action, source }
    }

    /// A message of the file that cannot be used.
    pub(crate) fn message(path: &Path, topic: &str, time_ns: u64, fault: MessageError) -> Self {
        let place = format!("{topic} at {time_ns} ns, {}", fault.place);
        Self::damaged(path, place, fault.expected, fault.found)
    }
}
