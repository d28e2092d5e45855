//! Files of the command line: reading, replacing, checks of paths.

use crate::{Failure, Result};
use ballast_scenario::ReadError;
use ballast_scenario::sample::{self, Sample};
use std::ffi::{OsStr, OsString};
use std::fs::{File, Metadata};
use std::io::Read;
use std::path::{Path, PathBuf};

/// First characters of every page that the program writes.
pub const PAGE_START: &str = "<!DOCTYPE html>";
/// Quotes a word for a shell if necessary.
pub fn shell_word(word: impl AsRef<OsStr>) -> String {
    let text = word.as_ref().to_string_lossy();
    let is_plain = |c: char| c.is_alphanumeric() || "-_./:,=+@%".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        return text.into_owned();
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// Returns true if two paths lead to one file, existing or not; resolves links.
pub fn same_file(a: &Path, b: &Path) -> bool {
    match (a.metadata(), b.metadata()) {
        (Ok(file_a), Ok(file_b)) => is_same(&file_a, &file_b, [a, b]),
        (Err(_), Err(_)) => location(a).is_some_and(|of_a| location(b) == Some(of_a)),
        _ => false,
    }
}

#[cfg(unix)]
fn is_same(a: &Metadata, b: &Metadata, _: [&Path; 2]) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_one(_: &Metadata, _: &Metadata, paths: [&Path; 2]) -> bool {
    let [a, b] = paths.map(|path| path.canonicalize().ok());
    a.is_some() && a == b
}

/// Returns folder and name of a file that does not exist.
fn location(path: &Path) -> Option<(PathBuf, OsString)> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new(".")).canonicalize().ok()?;
    Some((folder, path.file_name()?.to_owned()))
}

/// Checks that the files of a command line, each with its purpose, are different.
///
/// # Errors
/// One file for two purposes.
pub fn expect_different(files: &[(&str, Option<&Path>)]) -> Result {
    let given: Vec<(&str, &Path)> =
        files.iter().filter_map(|(what, path)| Some((*what, (*path)?))).collect();
    for (k, (what, path)) in given.iter().enumerate() {
        if let Some((other, _)) = given[..k].iter().find(|(_, earlier)| same_file(earlier, path)) {
            let text = format!("{other} and {what}: expected two files, found one");
            return Err(Failure::Usage(format!("{text}, {}", path.display())));
        }
    }
    Ok(())
}

/// Creates a folder and its parents.
///
/// # Errors
/// A folder that cannot be created.
pub fn create_folder(folder: &Path) -> Result {
    std::fs::create_dir_all(folder)
        .map_err(|e| Failure::at(folder, format!("cannot create the folder: {e}")))
}

/// Returns true if a file starts with `bytes`.
pub fn begins_with(path: &Path, bytes: &[u8]) -> bool {
    start_of(path, bytes.len() as u64) == bytes
}

/// Returns the first bytes of a regular file, at most `max`; none if it cannot be read.
pub fn start_of(path: &Path, max: u64) -> Vec<u8> {
    let mut start = Vec::new();
    if path.is_file() {
        // The reader of the file reports errors.
        let _ = File::open(path).and_then(|file| file.take(max).read_to_end(&mut start));
    }
    start
}

/// Kind of a file, recognised by its first bytes.
pub enum FileKind {
    /// Bed or checkpoint.
    Sealed,
    /// HDF5 file, such as results.
    Hdf5,
    /// MCAP file.
    Recording,
}

/// Returns the kind of a file that starts with `start`.
pub fn file_kind(start: &[u8]) -> Option<FileKind> {
    match start {
        _ if start.starts_with(b"ballast-") => Some(FileKind::Sealed),
        _ if start.starts_with(b"\x89HDF") => Some(FileKind::Hdf5),
        _ if start.starts_with(b"\x89MCAP0") => Some(FileKind::Recording),
        _ => None,
    }
}

/// Reads a text file of at most `limit` bytes.
///
/// # Errors
/// A file that cannot be read, is too long or no UTF-8.
pub fn read_text(path: &Path, limit: u64) -> Result<String> {
    read(path, limit, Failure::Failed)
}

/// Reads a case or plan of at most `limit` bytes.
///
/// # Errors
/// A file that cannot be read, is too long or no UTF-8.
pub fn read_case(path: &Path, limit: u64) -> Result<String> {
    read(path, limit, Failure::InvalidCase)
}

/// Reads a neutral sample.
///
/// # Errors
/// A file that cannot be read or is no valid sample.
pub fn read_sample(path: &Path) -> Result<Sample> {
    let text = read_text(path, sample::MAX_SAMPLE_BYTES)?;
    let read = sample::read(&text, &path.display().to_string());
    let sample = read.map_err(|e| Failure::InvalidCase(e.to_string()))?;
    let checked = sample.model.check().and_then(|()| sample.state.check(&sample.model));
    checked.map_err(|e| Failure::InvalidCase(format!("{}: {e}", path.display())))?;
    Ok(sample)
}

fn read(path: &Path, limit: u64, not_text: fn(String) -> Failure) -> Result<String> {
    let file = File::open(path).map_err(|e| Failure::at(path, e))?;
    ballast_scenario::read_text(file, limit).map_err(|e| match e {
        ReadError::NotUtf8(line) => {
            let name = path.display();
            not_text(format!("{name}:{line}: expected text in UTF-8, found other bytes"))
        }
        ReadError::OtherEncoding(_) => not_text(format!("{}: {e}", path.display())),
        other => Failure::at(path, other),
    })
}

/// Replaces a text file atomically.
///
/// # Errors
/// A file that cannot be written; it keeps its content.
pub fn replace_text(path: &Path, text: &str) -> Result {
    let replaced = ballast_hdf5::replace(path, &[text.as_bytes()]);
    replaced.map_err(|e| Failure::from(e).with("; the file keeps its content"))
}

/// Returns a table as CSV; values with commas or quotes are quoted.
pub fn csv_text<R>(columns: &[impl AsRef<str>], rows: impl IntoIterator<Item = R>) -> String
where
    R: IntoIterator,
    R::Item: AsRef<[u8]>,
{
    let mut writer = csv::Writer::from_writer(Vec::new());
    let written = writer
        .write_record(columns.iter().map(AsRef::as_ref))
        .and_then(|()| rows.into_iter().try_for_each(|row| writer.write_record(row)));
    written.expect("rows have one value per column");
    let bytes = writer.into_inner().expect("memory can be written");
    String::from_utf8(bytes).expect("values are text")
}

/// Checks that [`replace_text`] can write a path.
///
/// # Errors
/// A path that cannot be written.
pub fn check_writable(path: &Path) -> Result {
    ballast_hdf5::replaceable(path).map_err(|e| Failure::at(path, e))
}

/// Checks that a path can be written and does not contain another kind of file, which a mistyped path would destroy.
///
/// `what` describes files that may be replaced; `is_replaceable` recognises them.
///
/// # Errors
/// A path that cannot be written, or another file.
pub fn check_replaceable(
    path: &Path,
    what: &str,
    is_replaceable: impl FnOnce() -> bool,
) -> Result<(), String> {
    ballast_hdf5::replaceable(path).map_err(|e| e.to_string())?;
    if path.metadata().is_ok_and(|file| file.len() > 0) && !is_replaceable() {
        return Err(format!("expected a new file or {what} to replace, found another file"));
    }
    Ok(())
}

/// Parses the path of a table.
///
/// # Errors
/// A path that cannot be written, or another file.
pub fn table(path: &str) -> Result<PathBuf, String> {
    output_path(path, &["csv"])
}

/// Parses the path of a table or a page.
///
/// # Errors
/// A path that cannot be written, or another file.
pub fn table_or_page(path: &str) -> Result<PathBuf, String> {
    output_path(path, &["csv", "html"])
}

/// Parses the path of a sample.
///
/// # Errors
/// A path that cannot be written, or another file.
pub fn sample(path: &str) -> Result<PathBuf, String> {
    output_path(path, &["json"])
}

/// Checks a path whose extension decides the format.
fn output_path(path: &str, endings: &[&str]) -> Result<PathBuf, String> {
    let path = PathBuf::from(path);
    let ends = |ending: &&str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    let what = format!("one (.{})", endings.join(", ."));
    check_replaceable(&path, &what, || endings.iter().any(ends))?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failed_replacement_keeps_the_old_text() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("summary.json");
        replace_text(&path, "old").unwrap();
        replace_text(&path, "new").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "new");
        // No temporary name fits beside a name of this length.
        let path = folder.path().join("a".repeat(250));
        std::fs::write(&path, "old").unwrap();
        let message = replace_text(&path, "new").unwrap_err().to_string();
        assert!(message.ends_with("the file keeps its content"), "{message}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
    }
}
