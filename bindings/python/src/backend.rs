//! Interface of the two backends of a simulation: `local` computes in this process, `remote` drives another one.

use crate::inputs::{self, PyLoad, PyMotion};
use crate::result::PyWindowResult;
use crate::state::PyState;
use ballast::component::{LoadInput, MotionInput, WindowInputsRef};
use ballast_protocol::lockstep::{ParameterUpdate, WindowKind};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex};

/// Result of the last window, shared with calls that do not step the simulation.
pub type LastResult = Arc<Mutex<Option<Py<PyWindowResult>>>>;

/// Operations that every simulation supports.
pub trait Backend {
    /// Computes a window.
    fn window(&mut self, py: Python<'_>, spec: &WindowSpec) -> PyResult<Py<PyWindowResult>>;

    /// Returns the current state.
    fn save(&mut self, py: Python<'_>) -> PyResult<PyState>;

    /// Restores a saved state.
    fn restore(&mut self, py: Python<'_>, state: &PyState) -> PyResult<()>;

    /// Sets parameters for all later windows and for a redo of the last one.
    fn set_parameters(&mut self, py: Python<'_>, parameters: &ParameterUpdate) -> PyResult<()>;

    /// Returns the simulated time, ns since the start of the run.
    fn now_ns(&self) -> u64;

    /// Returns true after a panic, until a state is restored.
    fn has_failed(&self) -> bool;

    /// Ends the recording, if one is open.
    fn stop_recording(&mut self, py: Python<'_>) -> PyResult<()>;

    /// Ends the simulation and its recording.
    fn close(self: Box<Self>, py: Python<'_>) -> PyResult<()>;
}

/// Request of a window.
pub struct WindowSpec {
    pub motions: Vec<MotionInput>,
    pub loads: Vec<LoadInput>,
    /// End of the window, ns since the start of the run; `None` repeats the last window.
    pub t1_ns: Option<u64>,
    /// True if the case's tamping cycle moves the bodies.
    pub by_tamping_cycle: bool,
    /// Record the impulses of every step.
    pub record_steps: bool,
    /// Measure the zones at the end.
    pub zones: bool,
}

impl WindowSpec {
    /// Returns the request that Python arguments describe.
    ///
    /// # Errors
    /// `TypeError` for values that are no mappings from body names to motions and loads.
    pub fn from_args(
        t1_ns: Option<u64>,
        motions: Option<&Bound<'_, PyAny>>,
        loads: Option<&Bound<'_, PyAny>>,
        record_steps: bool,
        zones: bool,
    ) -> PyResult<Self> {
        let motion = |body, motion: &Bound<'_, PyMotion>| {
            let PyMotion { waveform, allow_jump } = motion.get();
            MotionInput { body, waveform: waveform.clone(), allow_jump: *allow_jump }
        };
        let load = |body, load: &Bound<'_, PyLoad>| {
            let waveform = load.get().waveform.clone();
            LoadInput { body, waveform }
        };
        Ok(Self {
            motions: inputs::by_body("motions", motions, motion)?,
            loads: inputs::by_body("loads", loads, load)?,
            t1_ns,
            by_tamping_cycle: false,
            record_steps,
            zones,
        })
    }

    /// Returns whether the request advances or repeats the last window.
    pub fn kind(&self) -> WindowKind {
        if self.t1_ns.is_some() { WindowKind::Advance } else { WindowKind::Redo }
    }

    /// Returns the motions and loads of the window.
    pub fn window(&self) -> WindowInputsRef<'_> {
        WindowInputsRef { motions: &self.motions, loads: &self.loads }
    }
}
