//! Recording of a run that this process drives, in an MCAP file.

use crate::case::Case;
use ballast::component::{Component, WindowInputsRef, WindowResult};
use ballast_hdf5::checkpoint;
use ballast_mcap::{Drive, RecordingMetadata, Result, WindowRecorder};
use ballast_protocol::lockstep::WindowKind;
use ballast_protocol::messages::AdvanceReply;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Recorder of the windows of a component.
pub struct RunRecorder {
    windows: WindowRecorder,
    /// Simulated time at the beginning of the file, ns.
    begin_ns: u64,
}

impl RunRecorder {
    /// Starts a recording at the state of `component`; `drive` says what moves its bodies.
    ///
    /// # Errors
    /// As for [`WindowRecorder::begin`].
    pub fn create(path: &Path, case: &Case, component: &Component, drive: Drive) -> Result<Self> {
        let (model, state) = (component.model(), component.state());
        let hash = ballast_hdf5::state_hash(model, state).into();
        let meta =
            RecordingMetadata::of(case.identity(), case.overrides.to_notes(), model, drive, hash);
        let start = || checkpoint::to_bytes(path, &case.checkpoint(model, state, BTreeMap::new()));
        let windows = WindowRecorder::begin(path, &case.plan, &meta, model, state, start)?;
        Ok(Self { windows, begin_ns: state.time_ns })
    }

    /// Returns true if this process began the recording, and not one that it was forked from.
    pub fn is_of_this_process(&self) -> bool {
        self.windows.is_of_this_process()
    }

    /// Returns the simulated time at the beginning of the file, ns.
    pub fn begin_ns(&self) -> u64 {
        self.begin_ns
    }

    /// Takes the window that has led to the state of `component`.
    ///
    /// # Errors
    /// The system refuses to write.
    pub fn window<'a>(
        &mut self,
        component: &Component,
        kind: WindowKind,
        inputs: impl Into<WindowInputsRef<'a>>,
        result: &WindowResult,
    ) -> Result<()> {
        let WindowInputsRef { motions, loads } = inputs.into();
        if kind == WindowKind::Advance {
            // The number of the next window follows that of the last one written.
            self.windows.settle()?;
        }
        let motions = motions.iter().map(Into::into).collect();
        let mut request = self.windows.request(result.t0_ns, result.t1_ns, motions);
        request.loads = loads.iter().map(Into::into).collect();
        let model = component.shared_model();
        let hash = ballast_hdf5::state_hash(&model, component.state()).into();
        let reply = AdvanceReply::of(&request, &model, result, hash);
        self.windows.window(model, kind, &request, &reply, component.save())
    }

    /// Adds a line to the log at the end of the last window.
    ///
    /// # Errors
    /// The system refuses to write.
    pub fn log(&mut self, time_ns: u64, text: &str) -> Result<()> {
        self.windows.log(time_ns, text)
    }

    /// Ends the recording, and returns its path.
    ///
    /// # Errors
    /// The system refuses to write.
    pub fn finish(self) -> Result<PathBuf> {
        let path = self.windows.path().to_path_buf();
        self.windows.finish()?;
        Ok(path)
    }
}
