//! Files of Ballast that a command expects.

use crate::files::{FileKind, file_kind, start_of};
use ballast_session::run_files::RunFiles;
use ballast_session::{Failure, Result};
use std::path::{Path, PathBuf};

/// File that a command expects.
#[derive(Clone, Copy)]
pub enum ExpectedFile {
    Checkpoint,
    Results,
    Any,
}

impl ExpectedFile {
    fn description(self) -> &'static str {
        match self {
            Self::Checkpoint => "a checkpoint",
            Self::Results => "results",
            Self::Any => "a bed, a checkpoint or results",
        }
    }

    /// Returns the file `given`, or the file of the run in the folder `given`.
    ///
    /// # Errors
    /// A folder without a run, or a file that is recognisably of another kind.
    pub fn find(self, given: &Path) -> Result<PathBuf> {
        let path = match self {
            _ if !given.is_dir() => given.to_path_buf(),
            Self::Checkpoint => RunFiles::of_run_folder(given)?.checkpoint(),
            Self::Results | Self::Any => RunFiles::of_run_folder(given)?.results(),
        };
        let beside = RunFiles::beside(&path);
        if matches!(self, Self::Checkpoint) && !path.exists() && beside.results().exists() {
            let what = "no such file: replays have none, and runs killed before their first checkpoint \
                        (`run.checkpoint_interval_s`); export the records with `ballast export`";
            return Err(Failure::at(&path, what));
        }
        match self.other_kind(&start_of(&path, 64)) {
            Some(found) => {
                let what = format!("expected {}, found {found}", self.description());
                Err(Failure::at(&path, what))
            }
            None => Ok(path),
        }
    }

    /// Returns the kind of a file that starts with `start`, unless it may be the expected one.
    fn other_kind(self, start: &[u8]) -> Option<&'static str> {
        // The last character may be cut.
        let is_text = || {
            let letters = std::str::from_utf8(start);
            !start.contains(&0) && letters.map_or_else(|e| e.error_len().is_none(), |_| true)
        };
        match (file_kind(start), start) {
            (Some(FileKind::Sealed), _) | (None, []) => None,
            (Some(FileKind::Recording), _) => {
                Some("a recording; read it with `ballast verify` or `ballast replay`")
            }
            (Some(FileKind::Hdf5), _) => matches!(self, Self::Checkpoint)
                .then_some("another HDF5 file; the checkpoint of results lies beside them"),
            (None, [b'{', ..]) => Some("text (JSON), such as a summary or a sample"),
            (None, _) if is_text() => Some("text, such as a case"),
            (None, _) => Some("no file of Ballast"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_files_are_recognised_by_their_first_bytes() {
        let found = |expected: ExpectedFile, start: &[u8]| expected.other_kind(start).unwrap_or("");
        for expected in [ExpectedFile::Checkpoint, ExpectedFile::Results, ExpectedFile::Any] {
            assert!(found(expected, b"\x89MCAP0\r\n\x01").contains("recording"));
            assert!(found(expected, b"{\"case\":1}").contains("JSON"));
            assert!(found(expected, b"# A case\nname = \"a\"").contains("such as a case"));
            assert!(found(expected, &"μ".as_bytes()[..1]).contains("such as a case"));
            assert!(found(expected, b"PK\x03\x04\xff\x00").contains("no file of Ballast"));
            assert_eq!(found(expected, b"ballast-checkpoint 3\nbytes 12\n"), "");
            assert_eq!(found(expected, b""), "", "its reader reports the error");
        }
        assert!(found(ExpectedFile::Checkpoint, b"\x89HDF\r\n\x1a\n").contains("beside"));
        assert_eq!(found(ExpectedFile::Results, b"\x89HDF\r\n\x1a\n"), "");
    }
}
