//! Recordings: what was asked, window by window, as it can be asked again, and what was answered.

use crate::case::{self, Case, as_dict};
use crate::errors;
use crate::inputs::{Load, Motion};
use crate::lock::enter;
use crate::outcome::Outcome;
use crate::state::{Saved, Snapshot, State};
use ballast_mcap::recording::{Window, Windows};
use ballast_protocol::messages::{
    AdvanceReply, Asked, Compactness, EnergyLedger, Message, Parameters, SolverStats, Squeeze,
    Status, WrenchImpulse,
};
use ballast_protocol::{Malformed, from_cdr};
use ballast_scenario::Choices;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt::Display;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

/// A recording (MCAP): an iterator over its windows, each a dictionary with `seq`, `t0_ns`, `t1_ns`, what was asked
/// (`request`), also as motions and loads by the names of their bodies (`tools`, `loads`) to be asked again, the
/// `parameters` that were set before (empty where none were), what the window did (`outcome`), and the `hash` of the state
/// and the `reply_digest` that it led to.
///
/// Such an outcome is what `advance_to` gave, but for what is not recorded: `wall_s` is nan, `hint_max_step_ns` is 0,
/// there is no `series`, and one that was ended early is as "ok", or "warn", as the shorter window that it was.
///
/// Of a file that does not go on to its end the iterator gives what is sound. At the end of that it gives a
/// RuntimeWarning, once, where the file is cut short, as after a kill, and raises FileError, once, where it is
/// damaged. `lost` says it, too.
#[pyclass(frozen, module = "ballast")]
pub struct Recording {
    path: PathBuf,
    windows: Mutex<Windows>,
    /// Whether it was told that reading ended early.
    is_told: AtomicBool,
}

#[pymethods]
impl Recording {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let windows = py.detach(|| Windows::open(&path)).map_err(|e| errors::file(py, e))?;
        Ok(Self { path, windows: Mutex::new(windows), is_told: AtomicBool::new(false) })
    }

    /// What it is a recording of, with the seed and the schedule that were chosen.
    #[getter]
    fn case(&self, py: Python<'_>) -> PyResult<Case> {
        let meta = py.detach(|| enter(&self.windows).meta().clone());
        let choices = Choices::from_notes(&meta.choices).map_err(|e| self.wrong(py, e))?;
        let name = format!("{}, its case", self.path.display());
        Ok(Case(Arc::new(case::read(py, meta.case_text, &name)?.chosen(choices))))
    }

    /// The state that it begins with; None where that is the beginning of its case.
    #[getter]
    fn start(&self, py: Python<'_>) -> PyResult<Option<State>> {
        let start = py.detach(|| enter(&self.windows).start().map(<[u8]>::to_vec));
        let name = self.path.display().to_string();
        let read = |bytes: Vec<u8>| Snapshot::from_bytes(py, &bytes, &name);
        Ok(start.map(read).transpose()?.map(|snapshot| State(Saved::Here(snapshot))))
    }

    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    /// The record of the next window: what was asked, and what was answered.
    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let read = || {
            let mut windows = enter(&self.windows);
            windows.next().map(|next| next.map(|window| (window, windows.meta().step_ns)))
        };
        let next = py.detach(read).map_err(|e| errors::file(py, e))?;
        let Some((window, step_ns)) = next else { return self.tell_lost(py).map(|()| None) };
        let record = &window.record;
        let malformed = |e: Malformed| self.wrong(py, format!("window {}: {e}", record.seq));
        let asked = record.request.inputs().map_err(malformed)?;
        let reply = reply(&window, step_ns).map_err(malformed)?;
        let outcome = Outcome {
            inner: reply.outcome().map_err(malformed)?,
            trouble: None,
            wall_s: f64::NAN,
            names: reply.bodies.into_iter().map(|body| body.body).collect(),
            series: None,
        };
        let told = as_dict(py, record)?;
        let (tools, loads) = inputs(py, asked)?;
        told.set_item("tools", tools)?;
        told.set_item("loads", loads)?;
        told.set_item("parameters", parameters(py, window.parameters.as_ref())?)?;
        told.set_item("outcome", outcome)?;
        Ok(Some(told))
    }

    /// Why reading ended early, where it did.
    #[getter]
    fn lost(&self, py: Python<'_>) -> Option<String> {
        py.detach(|| enter(&self.windows).lost().map(ToString::to_string))
    }

    fn __repr__(&self) -> String {
        format!("Recording({:?})", self.path)
    }
}

impl Recording {
    /// Says, once, that reading ended early, where it did: who only counts windows would take the file for whole.
    fn tell_lost(&self, py: Python<'_>) -> PyResult<()> {
        let lost = || enter(&self.windows).lost().map(|lost| (lost.is_cut, lost.to_string()));
        let Some((is_cut, lost)) = py.detach(lost) else { return Ok(()) };
        if self.is_told.swap(true, Ordering::Relaxed) {
            return Ok(());
        }
        if !is_cut {
            return Err(self.wrong(py, format!("it is damaged: {lost}")));
        }
        errors::warn(py, format!("{}: {lost}", self.path.display()))
    }

    fn wrong(&self, py: Python<'_>, what: impl Display) -> PyErr {
        errors::file(py, format!("{}: {what}", self.path.display()))
    }
}

/// What was asked, by the names of bodies.
fn inputs<'py>(
    py: Python<'py>,
    asked: Asked,
) -> PyResult<(Bound<'py, PyDict>, Bound<'py, PyDict>)> {
    let (tools, loads) = (PyDict::new(py), PyDict::new(py));
    for input in asked.motions {
        tools
            .set_item(input.body, Motion { waveform: input.waveform, rebase: input.allow_jump })?;
    }
    for input in asked.loads {
        loads.set_item(input.body, Load { waveform: input.waveform })?;
    }
    Ok((tools, loads))
}

/// What was set before a window, as `Simulation.set_parameters` takes it.
fn parameters<'py>(py: Python<'py>, set: Option<&Parameters>) -> PyResult<Bound<'py, PyDict>> {
    let told = PyDict::new(py);
    if let Some(Parameters { iterations, tolerance, .. }) = set {
        told.set_item("iterations", iterations)?;
        told.set_item("tolerance", tolerance)?;
    }
    Ok(told)
}

/// The reply to a window, of the messages that it has left: of one that stands.
fn reply(window: &Window, step_ns: u64) -> Result<AdvanceReply, Malformed> {
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
        let of = |e: Malformed| Malformed {
            place: format!("{}, {}", message.channel.topic, e.place),
            ..e
        };
        let data = &message.data;
        match &message.channel.schema[..] {
            WrenchImpulse::NAME => reply.bodies.push(from_cdr(data).map_err(of)?),
            Compactness::NAME => reply.zones.push(from_cdr(data).map_err(of)?),
            Squeeze::NAME => reply.squeezes.push(from_cdr(data).map_err(of)?),
            SolverStats::NAME => reply.solver = from_cdr(data).map_err(of)?,
            EnergyLedger::NAME => reply.energy = from_cdr(data).map_err(of)?,
            _ => {}
        }
    }
    if reply.solver.steps_not_converged > 0 {
        reply.status = Status::Warn;
    }
    Ok(reply)
}
