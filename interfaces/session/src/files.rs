//! The files of one run, side by side in one folder.

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
/// What a process that writes a run has locked.
const LOCK: &str = ".lock";
/// What lies beside results while they are written, and is removed with their end.
const SPARE: &str = "results.vtkhdf.spare";
/// Most bytes of a summary.
const LONGEST_SUMMARY: u64 = 16 << 20;

/// Paths of a run's files.
#[derive(Debug, Clone)]
pub struct RunFiles {
    pub folder: PathBuf,
    /// A file of the folder, locked; the system lets go of it with the last copy, however the process ends.
    _claim: Option<Arc<File>>,
}

impl RunFiles {
    /// The files in `folder`.
    pub fn in_folder(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into(), _claim: None }
    }

    /// The files of a run that begins in `folder`.
    pub fn begun_in(folder: impl Into<PathBuf>) -> Result<Self> {
        Self::in_folder(folder).claimed("wait for it, or choose another folder with --out")
    }

    /// The same, to be written by this process alone; the folder is made. `or` is what can be done while another
    /// writes there.
    pub fn claimed(self, or: &str) -> Result<Self> {
        let file = self.lock_file()?;
        match file.try_lock() {
            Ok(()) => Ok(self.owning(file)),
            Err(TryLockError::WouldBlock) => {
                let what = format!("another process writes a run there; {or}");
                Err(Failure::at(&self.folder, what))
            }
            // A file system that knows no locks.
            Err(TryLockError::Error(_)) => Ok(self),
        }
    }

    /// The same, when its turn has come.
    pub fn claimed_in_turn(self) -> Result<Self> {
        let file = self.lock_file()?;
        // A file system that knows no locks has no turns.
        Ok(if file.lock().is_ok() { self.owning(file) } else { self })
    }

    /// The same with the lock, and without what a process that was killed has left of its writing.
    fn owning(self, lock: File) -> Self {
        let spare = self.folder.join(SPARE);
        for own in [self.results(), self.checkpoint(), self.summary(), spare] {
            ballast_hdf5::clear(&own);
        }
        Self { _claim: Some(Arc::new(lock)), ..self }
    }

    fn lock_file(&self) -> Result<File> {
        create_folder(&self.folder)?;
        // Of its own, and open to be written: so it holds over a network, too.
        let path = self.folder.join(LOCK);
        let file = File::options().create(true).truncate(false).write(true).open(&path);
        file.map_err(|e| Failure::at(&path, e))
    }

    /// The files of the run whose folder is given for one of them; refuses a folder that holds no run.
    pub fn of_given(folder: &Path) -> Result<Self> {
        let files = Self::in_folder(folder);
        if files.is_there() {
            return Ok(files);
        }
        let within = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let run =
            within.map(|entry| entry.path()).filter(|path| Self::in_folder(path).is_there()).min();
        let hint = run.map(|run| format!("; {} is one", typed(run))).unwrap_or_default();
        let what = "expected the folder of a run, found one without its files";
        Err(Failure::at(folder, format!("{what}{hint}")))
    }

    /// Whether there is any of them.
    fn is_there(&self) -> bool {
        [self.results(), self.checkpoint(), self.summary()].iter().any(|file| file.exists())
    }

    /// The files beside a checkpoint.
    pub fn beside(checkpoint: &Path) -> Self {
        let folder = checkpoint.parent().filter(|p| !p.as_os_str().is_empty());
        Self::in_folder(folder.unwrap_or(Path::new(".")))
    }

    /// Bodies, forces and tables over time.
    pub fn results(&self) -> PathBuf {
        self.folder.join("results.vtkhdf")
    }

    /// What `resume` continues from.
    pub fn checkpoint(&self) -> PathBuf {
        self.folder.join("checkpoint.h5")
    }

    /// The final figures.
    pub fn summary(&self) -> PathBuf {
        self.folder.join("summary.json")
    }

    /// The page about the run.
    pub fn report(&self) -> PathBuf {
        self.folder.join("report.html")
    }

    /// Whether a run stopped here before its end, be it where it was told to, or was ended before its first checkpoint.
    pub fn is_unfinished(&self) -> bool {
        self.is_resumable() || self.results().exists() && self.told_summary().is_none()
    }

    /// Whether a run stopped here that can be gone on with.
    pub fn is_resumable(&self) -> bool {
        self.checkpoint().exists() && self.whole_summary().is_none()
    }

    /// What the summary says, where it is that of a run up to its end.
    pub fn whole_summary(&self) -> Option<Value> {
        self.told_summary().filter(|summary| summary["complete"] == true)
    }

    /// What the summary says, where there is one.
    pub fn told_summary(&self) -> Option<Value> {
        serde_json::from_str(&read_text(&self.summary(), LONGEST_SUMMARY).ok()?).ok()
    }

    /// Whether a process is writing them.
    pub fn is_written(&self) -> bool {
        // A lock to read with: it is let go of at once, and asks for no right to write.
        let lock = File::open(self.folder.join(LOCK)).map(|file| file.try_lock_shared());
        matches!(lock, Ok(Err(TryLockError::WouldBlock)))
    }

    /// What went wrong with reading a file of the run, and why it may have.
    pub fn unread(&self, failure: Failure) -> Failure {
        if !self.is_written() {
            return failure;
        }
        let folder = self.folder.display();
        failure.with(&format!("; a run is writing in {folder}: try again when it has ended"))
    }

    /// Refuses a file of the run for something else.
    pub fn refuse_own(&self, path: &Path) -> Result {
        let beside = [LOCK, SPARE].map(|name| self.folder.join(name));
        let own = [self.results(), self.checkpoint(), self.summary(), self.report()];
        if own.iter().chain(&beside).any(|file| same_file(file, path)) {
            let text = "expected a file that is none of the run's own, found one of them";
            return Err(Failure::Usage(format!("{}: {text}", path.display())));
        }
        Ok(())
    }

    /// Refuses a file of the run, and one that cannot be written, for a recording of it: before a bed is prepared, and anything
    /// removed.
    pub fn may_record(&self, path: Option<&Path>) -> Result {
        let Some(path) = path else { return Ok(()) };
        self.refuse_own(path)?;
        may_become_a_recording(path)?;
        writable(path)
    }

    /// Refuses a folder where a run stopped before its end; `or` is what else can be done than to go on with it.
    pub fn refuse_unfinished(&self, or: &str) -> Result {
        if !self.is_unfinished() {
            return Ok(());
        }
        let (folder, checkpoint) = (self.folder.display(), self.checkpoint());
        if !self.is_resumable() {
            let results = self.results();
            return Err(Failure::Usage(format!(
                "{folder} holds a run or a replay that was ended before its first checkpoint; `ballast export {} \
                 --out DIR` writes out what it recorded; {or}",
                typed(&results)
            )));
        }
        let kept = checkpoint::read(&checkpoint).ok();
        let is_served = kept.as_ref().is_some_and(case::is_served);
        let of = kept.map_or(String::new(), |kept| format!(" of `{}`", kept.case_name));
        let how = if is_served {
            format!("`ballast serve CASE --out {} --resume`", typed(&self.folder))
        } else {
            format!("`ballast resume {}`", typed(&checkpoint))
        };
        Err(Failure::Usage(format!(
            "{folder} holds an unfinished run{of}; go on with {how}, or {or}"
        )))
    }

    /// Refuses a folder that holds the finished run of another case: who changes a copy of a case and leaves its name does
    /// not mean to lose that.
    pub fn refuse_another(&self, case_text: &str) -> Result {
        let results = self.results();
        let text_of = || Reader::open(&results)?.about("case_text");
        match self.whole_summary().map(|_| text_of()) {
            Some(Ok(found)) if found != case_text => Err(Failure::Usage(format!(
                "{} holds the finished run of another case, or of this one as it was; choose another folder with --out, or \
                 replace it with --force",
                self.folder.display()
            ))),
            // What cannot be read is no run that could be lost.
            _ => Ok(()),
        }
    }

    /// Refuses a folder that holds a finished run, which a replay would take the place of: no replay leaves a checkpoint.
    pub fn refuse_run(&self) -> Result {
        if self.whole_summary().is_none() || !self.checkpoint().exists() {
            return Ok(());
        }
        let folder = self.folder.display();
        let what = "expected a folder of replays, found a finished run";
        let how = "choose another folder with --out, or replace it with --force";
        Err(Failure::Usage(format!("{folder}: {what}; {how}")))
    }

    /// Removes the final figures of a run that is gone on with, and the page about it.
    pub fn forget_end(&self) -> Result {
        remove(&self.summary())?;
        self.remove_report()
    }

    /// Removes the page about the run; one that somebody else has put there is no report.
    fn remove_report(&self) -> Result {
        let report = self.report();
        if begins_with(&report, PAGE_START.as_bytes()) { remove(&report) } else { Ok(()) }
    }

    /// Removes what an earlier run left, so that no old file passes for one of the new run.
    pub fn remove_all(&self) -> Result {
        [self.summary(), self.checkpoint(), self.results()].iter().try_for_each(|f| remove(f))?;
        self.remove_report()
    }
}

/// A word as it is typed in a shell.
pub fn typed(word: impl AsRef<OsStr>) -> String {
    let text = word.as_ref().to_string_lossy();
    let is_plain = |c: char| c.is_alphanumeric() || "-_./:,=+@%".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        return text.into_owned();
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

/// Removes a file, if it is there.
fn remove(file: &Path) -> Result {
    match std::fs::remove_file(file) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(Failure::at(file, format!("cannot replace it: {e}")))
        }
        _ => Ok(()),
    }
}

/// Whether two paths lead to one file, be it there or still to be made: links and ways round are looked through.
pub fn same_file(a: &Path, b: &Path) -> bool {
    match (a.metadata(), b.metadata()) {
        (Ok(file_a), Ok(file_b)) => is_one(&file_a, &file_b, [a, b]),
        (Err(_), Err(_)) => place(a).is_some_and(|place_a| place(b) == Some(place_a)),
        _ => false,
    }
}

#[cfg(unix)]
fn is_one(a: &Metadata, b: &Metadata, _: [&Path; 2]) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn is_one(_: &Metadata, _: &Metadata, paths: [&Path; 2]) -> bool {
    let [a, b] = paths.map(|path| path.canonicalize().ok());
    a.is_some() && a == b
}

/// Folder and name of a file that is not there.
fn place(path: &Path) -> Option<(PathBuf, OsString)> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new(".")).canonicalize().ok()?;
    Some((folder, path.file_name()?.to_owned()))
}

/// Refuses files of a command line, by what each is for, of which two are one: the second would cost the first.
pub fn expect_apart(files: &[(&str, Option<&Path>)]) -> Result {
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

/// Makes a folder and those above it.
pub fn create_folder(folder: &Path) -> Result {
    std::fs::create_dir_all(folder)
        .map_err(|e| Failure::at(folder, format!("cannot make the folder: {e}")))
}

/// Whether a file begins with these bytes.
pub fn begins_with(path: &Path, words: &[u8]) -> bool {
    start_of(path, words.len() as u64) == words
}

/// The first bytes, at most so many, of a file, not of a pipe that would be waited for; none where it cannot be read.
pub fn start_of(path: &Path, most: u64) -> Vec<u8> {
    let mut start = Vec::new();
    if path.is_file() {
        // What cannot be read is for its reader to tell.
        let _ = File::open(path).and_then(|file| file.take(most).read_to_end(&mut start));
    }
    start
}

/// The files of ours that their first bytes tell.
pub enum Ours {
    /// A bed or a checkpoint.
    Sealed,
    Hdf5,
    Recording,
}

/// Which of our files begins with `start`.
pub fn ours(start: &[u8]) -> Option<Ours> {
    match start {
        _ if start.starts_with(b"ballast-") => Some(Ours::Sealed),
        _ if start.starts_with(b"\x89HDF") => Some(Ours::Hdf5),
        _ if start.starts_with(b"\x89MCAP0") => Some(Ours::Recording),
        _ => None,
    }
}

/// Reads a text file of at most `limit` bytes.
pub fn read_text(path: &Path, limit: u64) -> Result<String> {
    read(path, limit, Failure::Failed)
}

/// The same of a text that says what is to be run.
pub fn read_case(path: &Path, limit: u64) -> Result<String> {
    read(path, limit, Failure::InvalidCase)
}

/// Reads a sample.
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

/// Replaces a text file in one go: readers see the old text or the new one, never a part.
pub fn replace_text(path: &Path, text: &str) -> Result {
    let replaced = ballast_hdf5::replace(path, &[text.as_bytes()]);
    replaced.map_err(|e| Failure::from(e).with("; what was there before is kept"))
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

/// Refuses a path that [`replace_text`] could not write: before the work whose result goes there.
pub fn writable(path: &Path) -> Result {
    ballast_hdf5::replaceable(path).map_err(|e| Failure::at(path, e))
}

/// Refuses a path that cannot be written, or where something lies that is not empty and not `what`, as `is_one` tells:
/// a slip of the command line is not to cost a case or results.
pub fn may_replace(path: &Path, what: &str, is_one: impl FnOnce() -> bool) -> Result<(), String> {
    ballast_hdf5::replaceable(path).map_err(|e| e.to_string())?;
    if path.metadata().is_ok_and(|file| file.len() > 0) && !is_one() {
        return Err(format!("expected a new file, or {what} to replace, found something else"));
    }
    Ok(())
}

/// A path for a table, as an option takes it.
pub fn table(path: &str) -> Result<PathBuf, String> {
    may_become(path, &["csv"])
}

/// The same for a table or a page.
pub fn table_or_page(path: &str) -> Result<PathBuf, String> {
    may_become(path, &["csv", "html"])
}

/// The same for a sample.
pub fn sample(path: &str) -> Result<PathBuf, String> {
    may_become(path, &["json"])
}

/// One is told by how its name ends.
fn may_become(path: &str, endings: &[&str]) -> Result<PathBuf, String> {
    let path = PathBuf::from(path);
    let ends = |ending: &&str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    let what = format!("one (.{})", endings.join(", ."));
    may_replace(&path, &what, || endings.iter().any(ends))?;
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_checkpoint_without_a_folder_lies_here() {
        assert_eq!(RunFiles::beside(Path::new("checkpoint.h5")).folder, Path::new("."));
        assert_eq!(RunFiles::beside(Path::new("a/b.h5")).folder, Path::new("a"));
    }

    #[test]
    fn only_a_run_that_says_so_is_complete() {
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
            assert_eq!(files.whole_summary().is_some(), is_whole, "{text}");
        }
    }

    #[test]
    fn a_failed_replacement_keeps_the_old_text() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("summary.json");
        replace_text(&path, "old").unwrap();
        replace_text(&path, "new").unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "new");
        // A name so long that no other one fits beside it.
        let path = folder.path().join("a".repeat(250));
        std::fs::write(&path, "old").unwrap();
        let said = replace_text(&path, "new").unwrap_err().to_string();
        assert!(said.ends_with("what was there before is kept"), "{said}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
    }
}
