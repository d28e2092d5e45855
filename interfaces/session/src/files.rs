//! Files of a run in one folder, and files of the command line.

use crate::case;
use crate::{Failure, Result};
use ballast_hdf5::checkpoint;
use ballast_hdf5::results::Reader;
use ballast_mcap::may_become_a_recording;
use ballast_scenario::ReadError;
use ballast_scenario::sample::{self, Sample};
use serde_json::Value;
use std::ffi::{OsStr, OsString};
use std::fs::{File, Metadata, TryLockError};
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// First characters of every page that the program writes.
pub const PAGE_START: &str = "<!DOCTYPE html>";
/// File that a process locks while it writes a run.
const LOCK_FILE: &str = ".lock";
/// Backup of the index of results, which exists while they are written.
const INDEX_BACKUP: &str = "results.vtkhdf.spare";
/// Maximum size of a summary, bytes.
const MAX_SUMMARY_BYTES: u64 = 16 << 20;

/// Files of a run.
#[derive(Debug, Clone)]
pub struct RunFiles {
    /// Folder of the run.
    pub folder: PathBuf,
    /// Locked file; the system releases the lock with the last copy, however the process ends.
    _lock: Option<Arc<File>>,
}

impl RunFiles {
    /// Returns the files in `folder`, without a lock.
    pub fn in_folder(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into(), _lock: None }
    }

    /// Locks the files of a new run in `folder`.
    ///
    /// # Errors
    /// A folder in which another process writes a run.
    pub fn create_in(folder: impl Into<PathBuf>) -> Result<Self> {
        Self::in_folder(folder).locked("wait for it, or choose another folder with --out")
    }

    /// Locks the files for this process and creates the folder. `hint` says what to do while another process writes.
    ///
    /// # Errors
    /// A folder in which another process writes a run.
    pub fn locked(self, hint: &str) -> Result<Self> {
        let file = self.lock_file()?;
        match file.try_lock() {
            Ok(()) => Ok(self.with_lock(file)),
            Err(TryLockError::WouldBlock) => {
                let what = format!("another process writes a run there; {hint}");
                Err(Failure::at(&self.folder, what))
            }
            // The file system has no locks.
            Err(TryLockError::Error(_)) => Ok(self),
        }
    }

    /// Waits for the lock of the files.
    ///
    /// # Errors
    /// A folder that cannot be created.
    pub fn lock_when_free(self) -> Result<Self> {
        let file = self.lock_file()?;
        // The file system may have no locks.
        Ok(if file.lock().is_ok() { self.with_lock(file) } else { self })
    }

    /// Returns the files with their lock, and removes temporary files of a killed process.
    fn with_lock(self, lock: File) -> Self {
        let index_backup = self.folder.join(INDEX_BACKUP);
        for own in [self.results(), self.checkpoint(), self.summary(), index_backup] {
            ballast_hdf5::clear(&own);
        }
        Self { _lock: Some(Arc::new(lock)), ..self }
    }

    fn lock_file(&self) -> Result<File> {
        create_folder(&self.folder)?;
        // A separate file opened for writing, so that the lock works on network file systems.
        let path = self.folder.join(LOCK_FILE);
        let file = File::options().create(true).truncate(false).write(true).open(&path);
        file.map_err(|e| Failure::at(&path, e))
    }

    /// Returns the files of the run in `folder`.
    ///
    /// # Errors
    /// A folder without a run.
    pub fn of_run_folder(folder: &Path) -> Result<Self> {
        let files = Self::in_folder(folder);
        if files.exists() {
            return Ok(files);
        }
        let within = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let run =
            within.map(|entry| entry.path()).filter(|path| Self::in_folder(path).exists()).min();
        let hint = run.map(|run| format!("; {} is one", shell_word(run))).unwrap_or_default();
        let what = "expected the folder of a run, found one without its files";
        Err(Failure::at(folder, format!("{what}{hint}")))
    }

    /// Returns true if any of the files exists.
    fn exists(&self) -> bool {
        [self.results(), self.checkpoint(), self.summary()].iter().any(|file| file.exists())
    }

    /// Returns the files beside a checkpoint.
    pub fn beside(checkpoint: &Path) -> Self {
        let folder = checkpoint.parent().filter(|p| !p.as_os_str().is_empty());
        Self::in_folder(folder.unwrap_or(Path::new(".")))
    }

    /// Path of the results: bodies, forces and tables over time.
    pub fn results(&self) -> PathBuf {
        self.folder.join("results.vtkhdf")
    }

    /// Path of the checkpoint, from which `resume` continues.
    pub fn checkpoint(&self) -> PathBuf {
        self.folder.join("checkpoint.h5")
    }

    /// Path of the summary.
    pub fn summary(&self) -> PathBuf {
        self.folder.join("summary.json")
    }

    /// Path of the report.
    pub fn report(&self) -> PathBuf {
        self.folder.join("report.html")
    }

    /// Returns true if the folder contains a run that stopped before its end.
    pub fn is_unfinished(&self) -> bool {
        self.is_resumable() || self.results().exists() && self.read_summary().is_none()
    }

    /// Returns true if the folder contains an unfinished run with a checkpoint.
    pub fn is_resumable(&self) -> bool {
        self.checkpoint().exists() && self.complete_summary().is_none()
    }

    /// Returns the summary of a finished run; `None` for others.
    pub fn complete_summary(&self) -> Option<Value> {
        self.read_summary().filter(|summary| summary["complete"] == true)
    }

    /// Returns the summary; `None` if there is none.
    pub fn read_summary(&self) -> Option<Value> {
        serde_json::from_str(&read_text(&self.summary(), MAX_SUMMARY_BYTES).ok()?).ok()
    }

    /// Returns true if a process is writing the files.
    pub fn is_written(&self) -> bool {
        // A shared lock, which is released at once and needs no right to write.
        let lock = File::open(self.folder.join(LOCK_FILE)).map(|file| file.try_lock_shared());
        matches!(lock, Ok(Err(TryLockError::WouldBlock)))
    }

    /// Returns the failure to read a file of the run, with a hint if the run is being written.
    pub fn explain_read_failure(&self, failure: Failure) -> Failure {
        if !self.is_written() {
            return failure;
        }
        let folder = self.folder.display();
        failure.with(&format!("; a run is writing in {folder}; try again when it has ended"))
    }

    /// Checks that `path` is none of the files of the run.
    ///
    /// # Errors
    /// A file of the run.
    pub fn refuse_own(&self, path: &Path) -> Result {
        let beside = [LOCK_FILE, INDEX_BACKUP].map(|name| self.folder.join(name));
        let own = [self.results(), self.checkpoint(), self.summary(), self.report()];
        if own.iter().chain(&beside).any(|file| same_file(file, path)) {
            let text = "expected a file that does not belong to the run, found one of its files";
            return Err(Failure::Usage(format!("{}: {text}", path.display())));
        }
        Ok(())
    }

    /// Checks that a recording can be written to `path`.
    ///
    /// # Errors
    /// A file of the run, or one that cannot be written.
    pub fn check_recording(&self, path: Option<&Path>) -> Result {
        let Some(path) = path else { return Ok(()) };
        self.refuse_own(path)?;
        may_become_a_recording(path)?;
        check_writable(path)
    }

    /// Checks that the folder contains no unfinished run; `hint` is an alternative to continuing it.
    ///
    /// # Errors
    /// A folder with an unfinished run.
    pub fn refuse_unfinished(&self, hint: &str) -> Result {
        if !self.is_unfinished() {
            return Ok(());
        }
        let (folder, checkpoint) = (self.folder.display(), self.checkpoint());
        if !self.is_resumable() {
            let results = self.results();
            return Err(Failure::Usage(format!(
                "{folder} contains a run or a replay that ended before its first checkpoint; export its records with \
                 `ballast export {} --out DIR`, or {hint}",
                shell_word(&results)
            )));
        }
        let stored = checkpoint::read(&checkpoint).ok();
        let is_served = stored.as_ref().is_some_and(case::is_served);
        let of = stored.map_or(String::new(), |stored| format!(" of `{}`", stored.case_name));
        let how = if is_served {
            format!("`ballast serve CASE --out {} --resume`", shell_word(&self.folder))
        } else {
            format!("`ballast resume {}`", shell_word(&checkpoint))
        };
        Err(Failure::Usage(format!(
            "{folder} contains an unfinished run{of}; continue it with {how}, or {hint}"
        )))
    }

    /// Checks that the folder contains no finished run of another case, such as that of a copy with the same name.
    ///
    /// # Errors
    /// A folder with the finished run of another case.
    pub fn refuse_another(&self, case_text: &str) -> Result {
        let results = self.results();
        let text_of = || Reader::open(&results)?.about("case_text");
        match self.complete_summary().map(|_| text_of()) {
            Some(Ok(found)) if found != case_text => Err(Failure::Usage(format!(
                "{} contains the finished run of another case or of an earlier text of this one; choose another folder \
                 with --out, or replace it with --force",
                self.folder.display()
            ))),
            // A file that cannot be read is no run that could be lost.
            _ => Ok(()),
        }
    }

    /// Checks that the folder contains no finished run, which a replay would replace.
    ///
    /// # Errors
    /// A folder with a finished run.
    pub fn refuse_run(&self) -> Result {
        if self.complete_summary().is_none() || !self.checkpoint().exists() {
            return Ok(());
        }
        let folder = self.folder.display();
        let what = "expected a folder of replays, found a finished run";
        let how = "choose another folder with --out, or replace it with --force";
        Err(Failure::Usage(format!("{folder}: {what}; {how}")))
    }

    /// Removes summary and report of a run that is being continued.
    ///
    /// # Errors
    /// A file that cannot be removed.
    pub fn remove_end(&self) -> Result {
        remove(&self.summary())?;
        self.remove_report()
    }

    /// Removes the report, unless the file is something else.
    fn remove_report(&self) -> Result {
        let report = self.report();
        if begins_with(&report, PAGE_START.as_bytes()) { remove(&report) } else { Ok(()) }
    }

    /// Removes the files of an earlier run.
    ///
    /// # Errors
    /// A file that cannot be removed.
    pub fn remove_all(&self) -> Result {
        [self.summary(), self.checkpoint(), self.results()].iter().try_for_each(|f| remove(f))?;
        self.remove_report()
    }
}

/// Quotes a word for a shell if necessary.
pub fn shell_word(word: impl AsRef<OsStr>) -> String {
    let text = word.as_ref().to_string_lossy();
    let is_plain = |c: char| c.is_alphanumeric() || "-_./:,=+@%".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        return text.into_owned();
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// Removes a file if it exists.
fn remove(file: &Path) -> Result {
    match std::fs::remove_file(file) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(Failure::at(file, format!("cannot replace it: {e}")))
        }
        _ => Ok(()),
    }
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
    fn checkpoint_without_folder_is_in_the_working_folder() {
        assert_eq!(RunFiles::beside(Path::new("checkpoint.h5")).folder, Path::new("."));
        assert_eq!(RunFiles::beside(Path::new("a/b.h5")).folder, Path::new("a"));
    }

    #[test]
    fn summary_must_say_complete() {
        let folder = tempfile::tempdir().unwrap();
        let files = RunFiles::in_folder(folder.path().to_owned());
        for (text, is_whole) in [
            (r#"{ "complete": true }"#, true),
            (r#"{ "complete": false }"#, false),
            ("{}", false),
            ("[]", false),
            ("null", false),
            ("\"complete\"", false),
            ("", false),
        ] {
            std::fs::write(files.summary(), text).unwrap();
            assert_eq!(files.complete_summary().is_some(), is_whole, "{text}");
        }
    }

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
