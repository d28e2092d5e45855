//! The recording of a run that others drive.
//!
//! Contract: what `ballast verify` computes from the file's beginning on is what is recorded, see [`WindowRecorder`].
//! A change of the state (restore, reset, init) ends the file, and the next one begins: NAME.2.mcap, NAME.3.mcap.
//! A file that does not begin at the start of the case holds the checkpoint from which it continues.
//! A process that resumes a run keeps the files of the previous process and writes new ones.

use super::served_checkpoint;
use crate::case::Case;
use ballast_mcap::{Drive, RecordingMetadata, WindowRecorder};
use ballast_protocol::lockstep::{Lockstep, WindowKind};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest};
use ballast_session::Result;
use std::path::{Path, PathBuf};

/// The open recording.
pub struct ServedRecording {
    path: PathBuf,
    /// Files begun; whether those of the process before are kept.
    parts: u32,
    resumes: bool,
    /// `None` before anything is configured.
    windows: Option<WindowRecorder>,
}

impl ServedRecording {
    /// The recording at `path`, if there is to be one; it begins when there is something to record.
    pub fn create(
        path: Option<&Path>,
        resumes: bool,
        case: &Case,
        lockstep: &Lockstep,
    ) -> Result<Option<Self>> {
        let Some(path) = path else { return Ok(None) };
        let mut recording = Self { path: path.into(), parts: 0, resumes, windows: None };
        if lockstep.is_configured() {
            recording.start_new_file(case, lockstep)?;
        }
        Ok(Some(recording))
    }

    pub fn window(
        &mut self,
        lockstep: &Lockstep,
        kind: WindowKind,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
    ) -> Result {
        let Some(windows) = &mut self.windows else { return Ok(()) };
        let component = lockstep.component();
        let (model, state) = (component.shared_model(), component.save());
        windows.window(model, kind, request, reply, state)?;
        if !reply.status.is_kept() {
            let text = format!("window {} discarded: {}", reply.seq, reply.message);
            windows.log(component.now_ns(), &text)?;
        }
        Ok(())
    }

    /// Starts a file: the run begins, or continues from another state or in another bed of the case.
    pub fn start_new_file(&mut self, case: &Case, lockstep: &Lockstep) -> Result {
        if let Some(windows) = &mut self.windows {
            windows.settle()?;
        }
        let path = next_part(&self.path, &mut self.parts, self.resumes);
        let next = start(&path, case, lockstep)?;
        match self.windows.replace(next) {
            Some(windows) => Ok(windows.finish()?),
            None => Ok(()),
        }
    }

    pub fn finish(self) -> Result {
        Ok(self.windows.map_or(Ok(()), WindowRecorder::finish)?)
    }
}

/// Returns the first file of the recording at `path`.
pub fn first_part(path: &Path, resumes: bool) -> PathBuf {
    next_part(path, &mut 0, resumes)
}

/// Returns the file after `parts` files; for a resumed run, the next one that does not exist.
fn next_part(path: &Path, parts: &mut u32, resumes: bool) -> PathBuf {
    // What follows another point is part of the name.
    let is_ending = path.extension().is_some_and(|ending| ending == "mcap");
    let stem = if is_ending { path.with_extension("") } else { path.into() };
    loop {
        *parts += 1;
        let start_new_file: PathBuf = match *parts {
            1 => path.into(),
            n => {
                let mut name = stem.clone().into_os_string();
                name.push(format!(".{n}.mcap"));
                name.into()
            }
        };
        if !(resumes && start_new_file.exists()) {
            return start_new_file;
        }
    }
}

fn start(path: &Path, case: &Case, lockstep: &Lockstep) -> Result<WindowRecorder> {
    let (model, state) = (lockstep.component().model(), lockstep.component().state());
    let hash = ballast_hdf5::state_hash(model, state).into();
    let meta = RecordingMetadata::of(
        case.identity(),
        case.overrides.to_notes(),
        model,
        Drive::Inputs,
        hash,
    );
    let checkpoint = || served_checkpoint::bytes(path, case, lockstep);
    Ok(WindowRecorder::begin(path, &case.plan, &meta, model, state, checkpoint)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_that_is_taken_up_is_recorded_in_the_next_file_that_is_free() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        assert_eq!([true, false].map(|resumes| first_part(&path, resumes)), [&*path, &*path]);
        for name in ["a.mcap", "a.2.mcap"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(first_part(&path, false), path);
        let second = |name: &str| next_part(&folder.path().join(name), &mut 1, false);
        assert_eq!(second("force_2.5kN"), folder.path().join("force_2.5kN.2.mcap"));
        assert_eq!(first_part(&path, true), folder.path().join("a.3.mcap"));
    }
}
