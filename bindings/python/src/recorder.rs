//! Recording of a simulation's windows.

use crate::errors;
use ballast::component::{Component, WindowInputsRef, WindowResult};
use ballast_beds::Case;
use ballast_hdf5::checkpoint;
use ballast_mcap::{Drive, Meta, Redoable, Tape};
use ballast_protocol::lockstep::WindowKind;
use ballast_protocol::messages::AdvanceReply;
use pyo3::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// An open recording.
pub struct Recorder {
    windows: Redoable,
    /// Simulated time at which the recording starts, ns.
    start_ns: u64,
}

impl Recorder {
    /// Creates the file and writes the start of the recording.
    pub fn create(path: PathBuf, case: &Case, component: &Component) -> ballast_mcap::Result<Self> {
        let model = component.model();
        let state = component.state();
        let hash = ballast_hdf5::state_hash(model, state).into();
        let meta = Meta::of(case.identity(), case.overrides.to_notes(), model, Drive::Inputs, hash);
        let start = || checkpoint::to_bytes(&path, &case.checkpoint(model, state, BTreeMap::new()));
        let tape = Tape::begin(&path, &case.plan, &meta, model, state, start)?;
        let windows = Redoable::new(tape, case.plan.run.output_ns, model, state)?;
        Ok(Self { windows, start_ns: state.time_ns })
    }

    /// Checks that this process started the recording.
    pub fn check_process(&self, py: Python<'_>, place: &str) -> PyResult<()> {
        if self.windows.is_of_this_process() {
            return Ok(());
        }
        let expected =
            "the process that started the recording; open the case or a saved state again";
        Err(errors::request(py, "recording", place, expected, "a fork of it"))
    }

    /// Checks that the recording contains the window that a redo replaces.
    pub fn check_redo(&self, py: Python<'_>, component: &Component) -> PyResult<()> {
        match component.last_window() {
            Some([t0, _]) if t0 < self.start_ns => {
                let start = self.start_ns;
                let expected = format!("a window of the recording, which starts at {start} ns");
                Err(errors::request(py, "recording", "redo", expected, format!("one from {t0} ns")))
            }
            _ => Ok(()),
        }
    }

    /// Records a window, at whose end `component` is.
    pub fn window(
        &mut self,
        component: &Component,
        kind: WindowKind,
        window: &WindowInputsRef,
        outcome: &WindowResult,
    ) -> ballast_mcap::Result<()> {
        let windows = &mut self.windows;
        let model = component.model();
        if kind == WindowKind::Advance {
            // Writes the previous window, which can no longer be redone; numbering continues from it.
            windows.settle()?;
        }
        let motions = window.motions.iter().map(Into::into).collect();
        let mut request = windows.tape().request(outcome.t0_ns, outcome.t1_ns, motions);
        request.loads = window.loads.iter().map(Into::into).collect();
        let hash = ballast_hdf5::state_hash(model, component.state()).into();
        let reply = AdvanceReply::of(&request, model, outcome, hash);
        windows.window(component.shared_model(), kind, &request, &reply, component.save())
    }

    /// Writes the last window and the end of the file.
    pub fn finish(self) -> ballast_mcap::Result<()> {
        self.windows.finish()
    }
}
