//! Files of a run in one folder.

use crate::files::{
    PAGE_START, begins_with, check_writable, create_folder, read_text, same_file, shell_word,
};
use crate::{Failure, Result};
use ballast_hdf5::checkpoint::{self, Checkpoint};
use ballast_hdf5::results::ResultsReader;
use ballast_mcap::may_become_a_recording;
use serde_json::Value;
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Key of the note in a checkpoint with the run of a served component.
pub const RUN_ID: &str = "run_id";

/// Returns true if the checkpoint belongs to a served run.
pub fn is_served(checkpoint: &Checkpoint) -> bool {
    checkpoint.extra.contains_key(RUN_ID)
}

/// File that a process locks while it writes a run.
const LOCK_FILE: &str = ".lock";
/// Backup of the index of results, which exists while they are written.
const INDEX_BACKUP: &str = "results.vtkhdf.index-backup";
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
        let is_served = stored.as_ref().is_some_and(is_served);
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
        let text_of = || ResultsReader::open(&results)?.metadata("case_text");
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

    /// Checks that the folder contains no finished run of more than `steps` steps.
    ///
    /// # Errors
    /// A folder with a finished run of more steps.
    pub fn refuse_longer(&self, steps: u64) -> Result {
        let found = self.complete_summary().and_then(|summary| summary["steps"].as_u64());
        match found {
            Some(found) if found > steps => Err(Failure::Usage(format!(
                "{} contains a finished run of {found} steps, which one of {steps} would replace; choose another folder with \
                 --out, or replace it with --force",
                self.folder.display()
            ))),
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

/// Removes a file if it exists.
fn remove(file: &Path) -> Result {
    match std::fs::remove_file(file) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(Failure::at(file, format!("cannot replace it: {e}")))
        }
        _ => Ok(()),
    }
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
}
