//! What can go wrong with a file: which file, where in it, what was expected and what was found.

use std::path::{Path, PathBuf};

/// Errors of this crate.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The operating system refused: no such file, no room, no permission.
    #[error("{path}: cannot {action}: {source}")]
    Io { path: PathBuf, action: &'static str, source: std::io::Error },
    /// The HDF5 library refused.
    #[error("{path}: {place}: {message}")]
    Hdf5 { path: PathBuf, place: String, message: String },
    /// The file is damaged, or no file of ours.
    #[error("{path}: {place}: expected {expected}, found {found}")]
    Damaged { path: PathBuf, place: String, expected: String, found: String },
    /// The file was written in a format that this program does not read.
    #[error("{path}: format: expected {expected}, found {found}")]
    Version { path: PathBuf, expected: String, found: String },
    /// What was to be written makes no sense; no file was touched.
    #[error("{path}: not written: {place}: expected {expected}, found {found}")]
    Refused { path: PathBuf, place: String, expected: String, found: String },
    /// The thread that writes results is gone.
    #[error("{path}: the writing thread ended early")]
    WriterGone { path: PathBuf },
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// A value that is not what it should be; the caller knows the file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Fault {
    pub place: String,
    pub expected: String,
    pub found: String,
}

impl Fault {
    pub fn new(
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Self { place: place.into(), expected: expected.into(), found: found.to_string() }
    }

    /// The fault of a file that was read.
    pub fn in_file(self, path: &Path) -> Error {
        let Self { place, expected, found } = self;
        Error::Damaged { path: path.into(), place, expected, found }
    }

    /// The fault of something that was to be written.
    pub fn refused(self, path: &Path) -> Error {
        let Self { place, expected, found } = self;
        Error::Refused { path: path.into(), place, expected, found }
    }
}

pub(crate) fn io(
    path: &Path,
    action: &'static str,
) -> impl FnOnce(std::io::Error) -> Error + use<> {
    let path = path.to_path_buf();
    move |source| Error::Io { path, action, source }
}

pub(crate) fn hdf5(path: &Path, place: &str) -> impl FnOnce(::hdf5::Error) -> Error + use<> {
    let (path, place) = (path.to_path_buf(), place.to_string());
    move |e| Error::Hdf5 { path, place, message: words(&e.to_string()) }
}

/// What the library says, and of what it tells about a call to the operating system the system's own words. Of the usual
/// files that it does not open, what they are.
fn words(message: &str) -> String {
    let number = |before: &str| {
        let (_, told) = message.split_once(before)?;
        told.split(',').next()?.trim().parse::<u64>().ok()
    };
    if let (Some(found), Some(expected)) =
        (number("truncated file: eof = "), number("stored_eof = "))
    {
        return format!("expected {expected} bytes, found {found}: it is cut short");
    }
    if message.ends_with("file signature not found") {
        return "expected an HDF5 file, found another one".into();
    }
    let told = message.split_once(": time = ").and_then(|(before, call)| {
        let (_, words) = call.split_once("error message = '")?;
        Some(format!("{before}: {}", words.split_once('\'')?.0))
    });
    told.unwrap_or_else(|| message.into())
}

#[cfg(test)]
mod tests {
    use super::words;

    #[test]
    fn of_a_call_to_the_system_its_words_are_told() {
        let call = "H5Dwrite(): can't write data: file write failed: time = Wed Nov 25 04:12:27 2026\n, filename = 'r.h5', \
                    file descriptor = 3, errno = 28, error message = 'No space left on device', buf = 0x7f, offset = 0";
        assert_eq!(
            words(call),
            "H5Dwrite(): can't write data: file write failed: No space left on device"
        );
        assert_eq!(words("H5Fopen(): no time = left"), "H5Fopen(): no time = left");
    }

    #[test]
    fn of_a_file_that_is_not_opened_it_is_told_what_it_is() {
        let told = "H5Fopen(): unable to open file: truncated file: eof = 300000, sblock->base_addr = 0, \
                    stored_eof = 4776268";
        assert_eq!(words(told), "expected 4776268 bytes, found 300000: it is cut short");
        let told = "H5Fopen(): unable to open file: file signature not found";
        assert_eq!(words(told), "expected an HDF5 file, found another one");
    }
}
