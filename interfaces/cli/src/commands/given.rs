//! Which of our files is given, where one of them is expected.

use crate::files::{Ours, RunFiles, ours, start_of};
use ballast_session::{Failure, Result};
use std::path::{Path, PathBuf};

/// A file of ours that HDF5 or our own reader is to open.
#[derive(Clone, Copy)]
pub enum Expected {
    Checkpoint,
    Results,
    Any,
}

impl Expected {
    fn words(self) -> &'static str {
        match self {
            Self::Checkpoint => "a checkpoint",
            Self::Results => "results",
            Self::Any => "a bed, a checkpoint or results",
        }
    }

    /// The file that is `given`, or that of the run whose folder is given; what is clearly something else is refused.
    pub fn file(self, given: &Path) -> Result<PathBuf> {
        let path = match self {
            _ if !given.is_dir() => given.to_path_buf(),
            Self::Checkpoint => RunFiles::of_given(given)?.checkpoint(),
            Self::Results | Self::Any => RunFiles::of_given(given)?.results(),
        };
        let beside = RunFiles::beside(&path);
        if matches!(self, Self::Checkpoint) && !path.exists() && beside.results().exists() {
            let what = "it is not there: a replay leaves none, and this run may have been killed before its first \
                        (`run.checkpoint_interval_s`); `ballast export` writes out what it recorded";
            return Err(Failure::at(&path, what));
        }
        match self.another(&start_of(&path, 64)) {
            Some(found) => {
                let what = format!("expected {}, found {found}", self.words());
                Err(Failure::at(&path, what))
            }
            None => Ok(path),
        }
    }

    /// What a file is that begins with `start`, if it is nothing that can be expected.
    fn another(self, start: &[u8]) -> Option<&'static str> {
        // A letter may be cut in two at the end.
        let is_text = || {
            let letters = std::str::from_utf8(start);
            !start.contains(&0) && letters.map_or_else(|e| e.error_len().is_none(), |_| true)
        };
        match (ours(start), start) {
            (Some(Ours::Sealed), _) | (None, []) => None,
            (Some(Ours::Recording), _) => {
                Some("a recording; `ballast verify` and `ballast replay` read it")
            }
            (Some(Ours::Hdf5), _) => matches!(self, Self::Checkpoint)
                .then_some("another HDF5 file; if it is of results, the checkpoint lies beside it"),
            (None, [b'{', ..]) => Some("text (JSON), such as a summary or a sample"),
            (None, _) if is_text() => Some("text, such as a case"),
            (None, _) => Some("no file of ours"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_given_instead_is_told_by_its_first_bytes() {
        let told = |expected: Expected, start: &[u8]| expected.another(start).unwrap_or("");
        for expected in [Expected::Checkpoint, Expected::Results, Expected::Any] {
            assert!(told(expected, b"\x89MCAP0\r\n\x01").contains("recording"));
            assert!(told(expected, b"{\"case\":1}").contains("JSON"));
            assert!(told(expected, b"# A case\nname = \"a\"").contains("such as a case"));
            assert!(told(expected, &"μ".as_bytes()[..1]).contains("such as a case"));
            assert!(told(expected, b"PK\x03\x04\xff\x00").contains("no file of ours"));
            assert_eq!(told(expected, b"ballast-checkpoint 3\nbytes 12\n"), "");
            assert_eq!(told(expected, b""), "", "its reader says why");
        }
        assert!(told(Expected::Checkpoint, b"\x89HDF\r\n\x1a\n").contains("beside"));
        assert_eq!(told(Expected::Results, b"\x89HDF\r\n\x1a\n"), "");
    }
}
