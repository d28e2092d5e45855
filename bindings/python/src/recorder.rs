//! The recording of a simulation: windows that stand.

use crate::case::Case;
use crate::errors;
use ballast::component::{Component, Outcome, Window};
use ballast_hdf5::checkpoint;
use ballast_mcap::{Drive, Meta, Redoable, Tape, is_the_beginning};
use ballast_protocol::messages::AdvanceReply;
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// An open recording.
pub struct Recorder {
    /// There until it is finished.
    windows: Option<Redoable>,
    /// Simulated time at its beginning.
    begins_ns: u64,
    /// A fork of it has the same file, and is not to write in it.
    process: u32,
}

impl Recorder {
    pub fn create(
        py: Python<'_>,
        path: PathBuf,
        case: &Case,
        component: &Component,
    ) -> PyResult<Self> {
        let (model, state) = (component.model(), component.state());
        let key = ballast_scenario::content_key(&case.plan);
        let names = [case.plan.name.clone(), key, case.text.clone()];
        let hash = ballast_hdf5::state_hash(model, state).into();
        let meta = Meta::of(names, case.choices.notes(), model, Drive::Inputs, hash);
        let start = match is_the_beginning(&case.plan, model, state) {
            true => None,
            false => {
                let kept = case.checkpoint(model, state, BTreeMap::new());
                Some(checkpoint::to_bytes(&path, &kept).map_err(|e| errors::file(py, e))?)
            }
        };
        let recording = Tape::create(&path, &meta, model, state, start.as_deref())
            .and_then(|tape| Redoable::new(tape, case.plan.run.output_ns, model, state));
        let windows = recording.map_err(|e| errors::file(py, e))?;
        let process = std::process::id();
        Ok(Self { windows: Some(windows), begins_ns: state.time_ns, process })
    }

    /// Refuses a process that was forked from the one that records.
    pub fn check_process(&self, py: Python<'_>, place: &str) -> PyResult<()> {
        if self.process == std::process::id() {
            return Ok(());
        }
        let expected =
            "the process that began the recording; open the case, or a saved state, anew";
        Err(errors::refused(py, "recording", place, expected, "a fork of it"))
    }

    /// Refuses a redo of a window that stands in no file.
    pub fn check_redo(&self, py: Python<'_>, component: &Component) -> PyResult<()> {
        match component.last_window() {
            Some([t0, _]) if t0 < self.begins_ns => {
                let begin = self.begins_ns;
                let expected = format!("a window of the recording, which begins at {begin} ns");
                Err(errors::refused(py, "recording", "redo", expected, format!("one from {t0} ns")))
            }
            _ => Ok(()),
        }
    }

    /// Takes a window that `component` is at the end of.
    pub fn window(
        &mut self,
        py: Python<'_>,
        component: &Component,
        is_redone: bool,
        window: &Window,
        outcome: &Outcome,
    ) -> PyResult<()> {
        let Some(windows) = &mut self.windows else { return Ok(()) };
        let model = component.model();
        if !is_redone {
            // Windows are numbered on from the last one that is written.
            windows.settle().map_err(|e| errors::file(py, e))?;
        }
        let motions = window.motions.iter().map(Into::into).collect();
        let mut request = windows.tape().request(outcome.t0_ns, outcome.t1_ns, motions);
        request.loads = window.loads.iter().map(Into::into).collect();
        let hash = ballast_hdf5::state_hash(model, component.state()).into();
        let reply = AdvanceReply::of(&request, model, outcome, hash);
        windows
            .window(component.shared_model(), is_redone, &request, &reply, component.save())
            .map_err(|e| errors::file(py, e))
    }

    pub fn finish(mut self, py: Python<'_>) -> PyResult<()> {
        let ended = self.windows.take().map(Redoable::finish).transpose();
        ended.map(drop).map_err(|e| errors::file(py, e))
    }
}

/// A simulation that is let go without being closed: its last window is as good as the others.
impl Drop for Recorder {
    fn drop(&mut self) {
        let windows = self.windows.take();
        if self.process == std::process::id() {
            // Nobody is left to tell.
            let _ = windows.map(Redoable::finish);
        } else {
            std::mem::forget(windows);
        }
    }
}
