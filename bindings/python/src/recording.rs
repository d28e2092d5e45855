//! Recordings: the windows of a run with their inputs and results.

use crate::case::{self, PyCase};
use crate::errors;
use crate::inputs::{PyLoad, PyMotion};
use crate::lock::lock;
use crate::result::PyWindowResult;
use crate::state::{LocalState, PyState, StateStorage};
use ballast_mcap::recording::{RecordedWindow, WindowReader};
use ballast_protocol::messages::{
    AdvanceInputs, AdvanceReply, EnergyLedger, Message, ReplyStatus, SolverParameters, SolverStats,
    SqueezeReport, WrenchImpulse, ZoneMeasurement,
};
use ballast_protocol::{MessageError, from_cdr};
use ballast_scenario::CaseOverrides;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt::Display;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

#[doc = stub!("Recording")]
#[pyclass(frozen, module = "ballast", name = "Recording")]
pub struct PyRecording {
    path: PathBuf,
    windows: Mutex<WindowReader>,
    /// The truncation was reported by a warning or an exception.
    is_reported: AtomicBool,
}

#[pymethods]
impl PyRecording {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let windows = py.detach(|| WindowReader::open(&path)).map_err(|e| errors::file(py, e))?;
        Ok(Self { path, windows: Mutex::new(windows), is_reported: AtomicBool::new(false) })
    }

    #[doc = stub!("Recording.case")]
    #[getter]
    fn case(&self, py: Python<'_>) -> PyResult<PyCase> {
        let meta = py.detach(|| lock(&self.windows).meta().clone());
        let choices =
            CaseOverrides::from_notes(&meta.overrides).map_err(|e| self.file_error(py, e))?;
        let name = format!("{}, its case", self.path.display());
        Ok(PyCase(Arc::new(case::read(py, meta.case_text, &name)?.with_overrides(choices))))
    }

    #[doc = stub!("Recording.start")]
    #[getter]
    fn start(&self, py: Python<'_>) -> PyResult<Option<PyState>> {
        let bytes = py.detach(|| lock(&self.windows).start().map(<[u8]>::to_vec));
        let name = self.path.display().to_string();
        let state = bytes.map(|bytes| LocalState::from_bytes(py, &bytes, &name)).transpose()?;
        Ok(state.map(|state| PyState(StateStorage::Local(state))))
    }

    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    /// Returns the next window.
    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let read = || {
            let mut windows = lock(&self.windows);
            windows.next().map(|next| next.map(|window| (window, windows.meta().step_ns)))
        };
        let next = py.detach(read).map_err(|e| errors::file(py, e))?;
        let Some((window, step_ns)) = next else {
            return self.report_truncation(py).map(|()| None);
        };
        let record = &window.record;
        let malformed =
            |e: MessageError| self.file_error(py, format!("window {}: {e}", record.seq));
        let (motions, loads) = inputs(py, record.request.inputs().map_err(malformed)?)?;
        let reply = reply(&window, step_ns).map_err(malformed)?;
        reply.outcome().map_err(malformed)?;
        let names = reply.bodies.iter().map(|body| body.body.clone()).collect();
        let entries = case::to_dict(py, record)?;
        entries.set_item("motions", motions)?;
        entries.set_item("loads", loads)?;
        entries.set_item("parameters", parameters(py, window.parameters.as_ref())?)?;
        entries.set_item("result", PyWindowResult::new(py, reply, names, f64::NAN, false)?)?;
        Ok(Some(entries))
    }

    #[doc = stub!("Recording.truncation")]
    #[getter]
    fn truncation(&self, py: Python<'_>) -> Option<String> {
        py.detach(|| lock(&self.windows).truncation().map(ToString::to_string))
    }

    fn __repr__(&self) -> String {
        format!("Recording({:?})", self.path)
    }
}

impl PyRecording {
    /// Reports once that the file is incomplete: by a warning if it is cut short, by an exception if it is damaged.
    fn report_truncation(&self, py: Python<'_>) -> PyResult<()> {
        let read = || lock(&self.windows).truncation().map(|lost| (lost.is_cut, lost.to_string()));
        let Some((is_cut, truncation)) = py.detach(read) else { return Ok(()) };
        if self.is_reported.swap(true, Ordering::Relaxed) {
            return Ok(());
        }
        if !is_cut {
            return Err(self.file_error(py, format!("damaged: {truncation}")));
        }
        errors::warn(py, format!("{}: {truncation}", self.path.display()))
    }

    fn file_error(&self, py: Python<'_>, text: impl Display) -> PyErr {
        errors::file(py, format!("{}: {text}", self.path.display()))
    }
}

/// Returns the motions and loads of a request by body.
fn inputs<'py>(
    py: Python<'py>,
    request: AdvanceInputs,
) -> PyResult<(Bound<'py, PyDict>, Bound<'py, PyDict>)> {
    let motions = PyDict::new(py);
    for input in request.motions {
        let motion = PyMotion { waveform: input.waveform, allow_jump: input.allow_jump };
        motions.set_item(input.body, motion)?;
    }
    let loads = PyDict::new(py);
    for input in request.loads {
        loads.set_item(input.body, PyLoad { waveform: input.waveform })?;
    }
    Ok((motions, loads))
}

/// Returns the parameters set before a window, as arguments of `Simulation.set_parameters`.
fn parameters<'py>(
    py: Python<'py>,
    parameters: Option<&SolverParameters>,
) -> PyResult<Bound<'py, PyDict>> {
    let arguments = PyDict::new(py);
    if let Some(SolverParameters { max_iterations, tolerance, .. }) = parameters {
        arguments.set_item("max_iterations", max_iterations)?;
        arguments.set_item("tolerance", tolerance)?;
    }
    Ok(arguments)
}

/// Returns the reply to a window, from the messages that it recorded.
fn reply(window: &RecordedWindow, step_ns: u64) -> Result<AdvanceReply, MessageError> {
    let record = &window.record;
    let length = u64::try_from(record.t1_ns - record.t0_ns).unwrap_or(0);
    let mut reply = AdvanceReply {
        seq: record.seq,
        t0_ns: record.t0_ns,
        t1_ns: record.t1_ns,
        steps: length.checked_div(step_ns).unwrap_or(0),
        hash: record.hash,
        ..AdvanceReply::default()
    };
    for message in &window.messages {
        let in_topic = |e: MessageError| MessageError {
            place: format!("{}, {}", message.channel.topic, e.place),
            ..e
        };
        let data = &message.data;
        match &message.channel.schema[..] {
            WrenchImpulse::NAME => reply.bodies.push(from_cdr(data).map_err(in_topic)?),
            ZoneMeasurement::NAME => reply.zones.push(from_cdr(data).map_err(in_topic)?),
            SqueezeReport::NAME => reply.squeezes.push(from_cdr(data).map_err(in_topic)?),
            SolverStats::NAME => reply.solver = from_cdr(data).map_err(in_topic)?,
            EnergyLedger::NAME => reply.energy = from_cdr(data).map_err(in_topic)?,
            _ => {}
        }
    }
    if reply.solver.steps_not_converged > 0 {
        reply.status = ReplyStatus::Warn;
    }
    Ok(reply)
}
