//! Atomic replacement of files.
//!
//! Contract: new content is written to a temporary file in the same folder, which replaces the old file when it is complete.
//! A failure removes the temporary file and leaves the old one unchanged.

use crate::error::{Fault, FaultInFile, Result, io};
use std::ffi::OsStr;
use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Suffix of temporary files: name of the replaced file, a dot, random letters, this.
const SUFFIX: &str = ".tmp";
const RANDOM: usize = 6;

/// Replaces `path` by a file with this content. Several processes may do so at a time.
///
/// # Errors
/// A file that cannot be written; a path that is no file.
pub fn replace(path: &Path, content: &[&[u8]]) -> Result<()> {
    let mut file = beside(path)?;
    for bytes in content {
        file.write_all(bytes).map_err(io(path, "write"))?;
    }
    settle(file, path)
}

/// Replaces `path` without waiting for the disk, for content that can be computed again.
pub(crate) fn exchange(path: &Path, content: &[u8]) -> Result<()> {
    let mut file = beside(path)?;
    file.write_all(content).map_err(io(path, "write"))?;
    put(file, path).map(drop)
}

/// Checks that [`replace`] can write `path`, before the work whose result is written there.
///
/// # Errors
/// A folder where no file can be created; a device or pipe, which would be replaced.
pub fn replaceable(path: &Path) -> std::io::Result<()> {
    let path = destination(path)?;
    let refused = |e: std::io::Error| {
        let (folder, found) = (folder_of(&path), e.kind());
        let text = format!(
            "expected a folder that files can be made in, found {}: {found}",
            folder.display()
        );
        std::io::Error::new(found, text)
    };
    temporary(&path).map(drop).map_err(refused)
}

/// Removes the temporary files of processes that were killed inside a [`replace`] of `path`. The caller must know that no
/// process replaces it now.
pub fn clear(path: &Path) {
    let Some(name) = path.file_name() else { return };
    for entry in std::fs::read_dir(folder_of(path)).into_iter().flatten().flatten() {
        if is_temporary(&entry.file_name(), name) {
            // A file that cannot be removed does no harm.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Returns true if a name is that of a temporary file for a file `of` this name.
fn is_temporary(name: &OsStr, of: &OsStr) -> bool {
    let random = (name.as_encoded_bytes().strip_prefix(of.as_encoded_bytes()))
        .and_then(|rest| rest.strip_prefix(b"."))
        .and_then(|rest| rest.strip_suffix(SUFFIX.as_bytes()));
    random.is_some_and(|r| r.len() == RANDOM && r.iter().all(u8::is_ascii_alphanumeric))
}

/// Checks that `path` is free, or a file of the kind that [`replace`] may replace, so that a wrong name destroys no data.
///
/// `kind` describes the replaceable files, and `is_kind` recognises them by their content. An empty file may always be
/// replaced.
///
/// # Errors
/// [`Error::Refused`](crate::Error::Refused) for another file; a file that cannot be read.
pub fn check_file_kind(path: &Path, kind: &str, is_kind: impl FnOnce(File) -> bool) -> Result<()> {
    let refused = |found: &str| {
        let expected = format!("a new file, or {kind} to replace");
        Err(Fault::new("path", expected, found).refused(path))
    };
    match path.metadata() {
        Ok(what) if what.is_file() && what.len() == 0 => Ok(()),
        Ok(what) if what.is_file() => {
            let file = File::open(path).map_err(io(path, "open"))?;
            if is_kind(file) { Ok(()) } else { refused("another file") }
        }
        Ok(what) if what.is_dir() => refused("a folder"),
        Ok(_) => refused("a device or a pipe"),
        // No file, or one whose error is reported when it is replaced.
        Err(_) => Ok(()),
    }
}

/// Returns the path that a write to `path` replaces: the target of a link, not the link.
///
/// # Errors
/// A device or pipe, which would be replaced.
fn destination(path: &Path) -> std::io::Result<PathBuf> {
    let wrong = |found: &str| {
        let text = format!("expected a file or a new name, found {found}");
        std::io::Error::new(ErrorKind::InvalidInput, text)
    };
    match (path.metadata(), path.is_symlink()) {
        (Ok(what), is_link) if what.is_file() => {
            if is_link {
                path.canonicalize()
            } else {
                Ok(path.into())
            }
        }
        (Ok(what), _) if what.is_dir() => Err(wrong("a folder")),
        (Ok(_), _) => Err(wrong("a device or a pipe")),
        (Err(e), false) if e.kind() == ErrorKind::NotFound => Ok(path.into()),
        (Err(e), true) if e.kind() == ErrorKind::NotFound => Err(wrong("a link to nothing")),
        (Err(e), _) => Err(e),
    }
}

/// Creates a temporary file in the folder of `path`, which is removed when dropped.
pub(crate) fn beside(path: &Path) -> Result<tempfile::NamedTempFile> {
    let path = &destination(path).map_err(io(path, "replace"))?;
    temporary(path).map_err(io(path, "create a file beside"))
}

fn temporary(path: &Path) -> std::io::Result<tempfile::NamedTempFile> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".");
    builder(&name).suffix(SUFFIX).rand_bytes(RANDOM).tempfile_in(folder_of(path))
}

/// Replaces `path` by a file from [`beside`]; returns its path.
fn put(file: tempfile::NamedTempFile, path: &Path) -> Result<PathBuf> {
    let place = destination(path).map_err(io(path, "replace"))?;
    file.persist(&place).map_err(|e| io(path, "replace")(e.error))?;
    Ok(place)
}

/// Replaces `path` by a file from [`beside`] after synchronising it with the disk.
pub(crate) fn settle(file: tempfile::NamedTempFile, path: &Path) -> Result<()> {
    file.as_file().sync_all().map_err(io(path, "synchronise"))?;
    let path = &put(file, path)?;
    // The rename is durable after synchronising the folder, which not every file system supports.
    if let Ok(folder) = File::open(folder_of(path)) {
        let _ = folder.sync_all();
    }
    Ok(())
}

#[cfg(unix)]
fn builder(name: &OsStr) -> tempfile::Builder<'_, 'static> {
    use std::os::unix::fs::PermissionsExt;
    let mut builder = tempfile::Builder::new();
    // Readable by others, as any result is; the umask still applies.
    let permissions = std::fs::Permissions::from_mode(0o666);
    builder.prefix(name).permissions(permissions);
    builder
}

#[cfg(not(unix))]
fn builder(name: &OsStr) -> tempfile::Builder<'_, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(name);
    builder
}

fn folder_of(path: &Path) -> PathBuf {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.into(),
        _ => PathBuf::from("."),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_left_of_a_file_is_cleared_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5");
        // As after a kill.
        let left = beside(&path).unwrap().into_temp_path().keep().unwrap();
        let others =
            ["a.h5", "a.h5.tmp", "a.h5.index-backup", "b.h5.AbCd12.tmp", "a.h5.notes-1.tmp"]
                .map(|name| folder.path().join(name));
        others.iter().for_each(|other| std::fs::write(other, "kept").unwrap());
        clear(&path);
        assert!(!left.exists());
        others.iter().for_each(|other| assert!(other.exists(), "{}", other.display()));
    }
}
