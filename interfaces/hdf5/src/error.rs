//! Errors of reading and writing HDF5 files.

pub(crate) use ballast_columns::Fault;
use std::path::{Path, PathBuf};

/// Error of reading or writing an HDF5 file.
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
    /// An operation of the HDF5 library that failed.
    #[error("{path}: {place}: {message}")]
    Hdf5 {
        /// Path of the file.
        path: PathBuf,
        /// Position in the file.
        place: String,
        /// Message of the library.
        message: String,
    },
    /// A file that is damaged, or not of Ballast.
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
    /// A file in a format that this program does not read.
    #[error("{path}: format: expected {expected}, found {found}")]
    Version {
        /// Path of the file.
        path: PathBuf,
        /// Expected content.
        expected: String,
        /// Found content.
        found: String,
    },
    /// Invalid content that was not written; no file was changed.
    #[error("{path}: not written: {place}: expected {expected}, found {found}")]
    Refused {
        /// Path of the file.
        path: PathBuf,
        /// Position in the file.
        place: String,
        /// Expected content.
        expected: String,
        /// Found content.
        found: String,
    },
    /// The thread that writes results has ended.
    #[error("{path}: the writing thread ended early")]
    WriterGone {
        /// Path of the file.
        path: PathBuf,
    },
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Conversion of a fault to an error with the path of its file.
pub(crate) trait FaultInFile {
    /// Converts the fault to the error of a file that was read.
    fn in_file(self, path: &Path) -> Error;

    /// Converts the fault to the error of content that was not written.
    fn refused(self, path: &Path) -> Error;
}

impl FaultInFile for Fault {
    fn in_file(self, path: &Path) -> Error {
        let Self { place, expected, found } = self;
        Error::Damaged { path: path.into(), place, expected, found }
    }

    fn refused(self, path: &Path) -> Error {
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

/// Returns the message of the library, and for a failed system call that of the system. Describes usual files that are not
/// HDF5.
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
