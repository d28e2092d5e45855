//! Whole files: written at once or not at all.
//!
//! Contract: what is new goes to a file beside the old one, which takes its place only when it is whole; a failure
//! removes the new file and leaves the old one as it was.

use crate::error::{Fault, Result, io};
use std::ffi::OsStr;
use std::fs::File;
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// Names of files on their way: that of what they replace, a point, letters, this.
const SUFFIX: &str = ".tmp";
const RANDOM: usize = 6;

/// Replaces `path` by a file with this content. Several processes may do so at a time.
///
/// # Errors
/// The system refuses; something else than a file lies there.
pub fn replace(path: &Path, content: &[&[u8]]) -> Result<()> {
    let mut file = beside(path)?;
    for bytes in content {
        file.write_all(bytes).map_err(io(path, "write"))?;
    }
    settle(file, path)
}

/// The same for what can be made again at once: it may reach the disk later.
pub(crate) fn exchange(path: &Path, content: &[u8]) -> Result<()> {
    let mut file = beside(path)?;
    file.write_all(content).map_err(io(path, "write"))?;
    put(file, path).map(drop)
}

/// Finds out whether [`replace`] can write `path`, before the work whose result goes there.
///
/// # Errors
/// The system lets no file be made beside it; something else than a file lies there: a device or a pipe would be gone.
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

/// Removes what processes that were killed within a [`replace`] of `path` have left beside it. Only for who knows that
/// none replaces it now.
pub fn clear(path: &Path) {
    let Some(name) = path.file_name() else { return };
    for entry in std::fs::read_dir(folder_of(path)).into_iter().flatten().flatten() {
        if is_temporary(&entry.file_name(), name) {
            // What cannot be removed takes room, and harms nothing else.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Whether a name is of the kind that [`temporary`] gives beside a file `of` this name.
fn is_temporary(name: &OsStr, of: &OsStr) -> bool {
    let random = (name.as_encoded_bytes().strip_prefix(of.as_encoded_bytes()))
        .and_then(|rest| rest.strip_prefix(b"."))
        .and_then(|rest| rest.strip_suffix(SUFFIX.as_bytes()));
    random.is_some_and(|r| r.len() == RANDOM && r.iter().all(u8::is_ascii_alphanumeric))
}

/// Refuses a path where something else lies than what [`replace`] is to take the place of: a slip of a name is not to
/// cost what somebody has computed or measured. `ours` says what may be replaced, and `is_ours` tells it by its content;
/// an empty file may always be.
///
/// # Errors
/// [`Error::Refused`](crate::Error::Refused), or the system refuses.
pub fn check_file_kind(path: &Path, ours: &str, is_ours: impl FnOnce(File) -> bool) -> Result<()> {
    let refused = |found: &str| {
        let expected = format!("a new file, or {ours} to replace");
        Err(Fault::new("path", expected, found).refused(path))
    };
    match path.metadata() {
        Ok(what) if what.is_file() && what.len() == 0 => Ok(()),
        Ok(what) if what.is_file() => {
            let file = File::open(path).map_err(io(path, "open"))?;
            if is_ours(file) { Ok(()) } else { refused("another file") }
        }
        Ok(what) if what.is_dir() => refused("a folder"),
        Ok(_) => refused("a device or a pipe"),
        // Nothing is there, or what is there is told when it is replaced.
        Err(_) => Ok(()),
    }
}

/// What is replaced where `path` is written: a link's target rather than the link.
///
/// # Errors
/// Something else than a file lies there: a device or a pipe would be gone.
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

/// A new file beside `path`, gone when dropped.
pub(crate) fn beside(path: &Path) -> Result<tempfile::NamedTempFile> {
    let path = &destination(path).map_err(io(path, "replace"))?;
    temporary(path).map_err(io(path, "create a file beside"))
}

fn temporary(path: &Path) -> std::io::Result<tempfile::NamedTempFile> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".");
    builder(&name).suffix(SUFFIX).rand_bytes(RANDOM).tempfile_in(folder_of(path))
}

/// Gives a file from [`beside`] the place of `path`; where that is.
fn put(file: tempfile::NamedTempFile, path: &Path) -> Result<PathBuf> {
    let place = destination(path).map_err(io(path, "replace"))?;
    file.persist(&place).map_err(|e| io(path, "replace")(e.error))?;
    Ok(place)
}

/// The same, once the file is on the disk.
pub(crate) fn settle(file: tempfile::NamedTempFile, path: &Path) -> Result<()> {
    file.as_file().sync_all().map_err(io(path, "bring to the disk"))?;
    let path = &put(file, path)?;
    // The rename itself is only safe once the folder is; not every file system can tell.
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
        // As a kill leaves it.
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
