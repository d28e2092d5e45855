//! Results of windows. They wrap the protocol's messages, so that remote and recorded results are the same objects.

mod parts;
mod series;

pub use parts::{
    _unpickle_part, PyBodyResult, PyEnergyLedger, PySolverResult, PySqueeze, PyZoneResult, zones,
};
pub use series::{_unpickle_step_series, PyStepSeries};

use ballast::component::WindowResult;
use ballast::model::Model;
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, StateHash, StepSeries};
use ballast_protocol::{MessageError, from_cdr, to_cdr};
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyIterator};
use std::sync::Arc;

/// Return value of `__reduce__`: a private function of the module and its arguments.
type PickleReduction<'py, Args> = (Bound<'py, PyAny>, Args);

/// Returns a private function of the module, for pickling.
fn private_function<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("ballast._ballast")?.getattr(name)
}

fn malformed(error: MessageError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

#[doc = stub!("WindowResult")]
#[pyclass(frozen, module = "ballast", name = "WindowResult")]
pub struct PyWindowResult {
    /// Reply to the window, without its series.
    reply: AdvanceReply,
    wall_time_s: f64,
    /// Names of the driven bodies `[nd]`.
    names: Arc<[String]>,
    step_series: Option<Py<PyStepSeries>>,
}

impl PyWindowResult {
    /// Returns the result of a reply; the reply's series is kept if `has_step_series`.
    pub fn new(
        py: Python<'_>,
        mut reply: AdvanceReply,
        names: Arc<[String]>,
        wall_time_s: f64,
        has_step_series: bool,
    ) -> PyResult<Self> {
        let steps = std::mem::take(&mut reply.step_series);
        let series = has_step_series.then(|| Py::new(py, PyStepSeries::new(steps, &names)));
        Ok(Self { reply, wall_time_s, names, step_series: series.transpose()? })
    }

    /// Returns the reply to a window that this process has computed.
    pub fn reply(model: &Model, outcome: &WindowResult, series: StepSeries) -> AdvanceReply {
        let reply =
            AdvanceReply::of(&AdvanceRequest::default(), model, outcome, StateHash::default());
        AdvanceReply { step_series: series, ..reply }
    }

    fn body(&self, name: &str) -> Option<PyBodyResult> {
        let index = self.names.iter().position(|known| known == name)?;
        self.reply.bodies.get(index).cloned().map(PyBodyResult)
    }
}

#[pymethods]
impl PyWindowResult {
    #[doc = stub!("WindowResult.status")]
    #[getter]
    fn status(&self) -> &'static str {
        self.reply.status.word()
    }

    #[doc = stub!("WindowResult.error_message")]
    #[getter]
    fn error_message(&self) -> Option<&str> {
        let message = &self.reply.message;
        (!message.is_empty()).then_some(message)
    }

    #[doc = stub!("WindowResult.code")]
    #[getter]
    fn code(&self) -> Option<&str> {
        let code = &self.reply.code;
        (!code.is_empty()).then_some(code)
    }

    #[doc = stub!("WindowResult.t0_ns")]
    #[getter]
    fn t0_ns(&self) -> i64 {
        self.reply.t0_ns
    }

    #[doc = stub!("WindowResult.t1_ns")]
    #[getter]
    fn t1_ns(&self) -> i64 {
        self.reply.t1_ns
    }

    #[doc = stub!("WindowResult.steps")]
    #[getter]
    fn steps(&self) -> u64 {
        self.reply.steps
    }

    #[doc = stub!("WindowResult.bodies")]
    #[getter]
    fn bodies<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let bodies = PyDict::new(py);
        for (name, body) in self.names.iter().zip(&self.reply.bodies) {
            bodies.set_item(name, PyBodyResult(body.clone()))?;
        }
        Ok(bodies)
    }

    #[doc = stub!("WindowResult.zones")]
    #[getter]
    fn zones<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        zones(py, self.reply.zones.iter().cloned())
    }

    #[doc = stub!("WindowResult.squeezes")]
    #[getter]
    fn squeezes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let squeezes = PyDict::new(py);
        for squeeze in &self.reply.squeezes {
            squeezes.set_item(&squeeze.pair, PySqueeze(squeeze.clone()))?;
        }
        Ok(squeezes)
    }

    #[doc = stub!("WindowResult.solver")]
    #[getter]
    fn solver(&self) -> PySolverResult {
        PySolverResult(self.reply.solver)
    }

    #[doc = stub!("WindowResult.energy")]
    #[getter]
    fn energy(&self) -> PyEnergyLedger {
        PyEnergyLedger(self.reply.energy)
    }

    #[doc = stub!("WindowResult.max_knot_spacing_ns")]
    #[getter]
    fn max_knot_spacing_ns(&self) -> u64 {
        self.reply.max_knot_spacing_ns
    }

    #[doc = stub!("WindowResult.wall_time_s")]
    #[getter]
    fn wall_time_s(&self) -> f64 {
        self.wall_time_s
    }

    #[doc = stub!("WindowResult.step_series")]
    #[getter]
    fn step_series(&self, py: Python<'_>) -> Option<Py<PyStepSeries>> {
        self.step_series.as_ref().map(|series| series.clone_ref(py))
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        self.bodies(py)?.try_iter()
    }

    fn __len__(&self) -> usize {
        self.names.len()
    }

    #[doc = stub!("WindowResult.keys")]
    fn keys<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.bodies(py)?.call_method0("keys")
    }

    #[doc = stub!("WindowResult.values")]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.bodies(py)?.call_method0("values")
    }

    #[doc = stub!("WindowResult.items")]
    fn items<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.bodies(py)?.call_method0("items")
    }

    fn __getitem__(&self, name: &str) -> PyResult<PyBodyResult> {
        // Python quotes the text of a KeyError, including quotes in it.
        self.body(name).ok_or_else(|| {
            let known = self.names.join(", ");
            PyKeyError::new_err(format!("body: expected one of {known}, found {name}"))
        })
    }

    #[doc = stub!("WindowResult.get")]
    #[pyo3(signature = (name, default=None))]
    fn get(&self, py: Python<'_>, name: &str, default: Option<Py<PyAny>>) -> PyResult<Py<PyAny>> {
        match self.body(name) {
            Some(body) => Ok(Py::new(py, body)?.into_any()),
            None => Ok(default.unwrap_or_else(|| py.None())),
        }
    }

    fn __contains__(&self, name: &Bound<'_, PyAny>) -> bool {
        name.extract().is_ok_and(|name: &str| self.names.iter().any(|known| known == name))
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<PickleReduction<'py, PickledWindow<'py>>> {
        let series = self.step_series.as_ref().map(|series| series.get().steps().clone());
        let has_step_series = series.is_some();
        let series = series.unwrap_or_default();
        let bytes = to_cdr(&AdvanceReply { step_series: series, ..self.reply.clone() })
            .map_err(malformed)?;
        let arguments =
            (PyBytes::new(py, &bytes), self.names.to_vec(), self.wall_time_s, has_step_series);
        Ok((private_function(py, "_unpickle_window_result")?, arguments))
    }

    fn __repr__(&self) -> String {
        let AdvanceReply { t0_ns, t1_ns, steps, .. } = self.reply;
        format!("WindowResult({}, {t0_ns} to {t1_ns} ns, {steps} steps)", self.status())
    }
}

type PickledWindow<'py> = (Bound<'py, PyBytes>, Vec<String>, f64, bool);

/// Returns a pickled result of a window.
#[pyfunction]
pub fn _unpickle_window_result(
    py: Python<'_>,
    bytes: &[u8],
    names: Vec<String>,
    wall_time_s: f64,
    has_step_series: bool,
) -> PyResult<PyWindowResult> {
    let reply = from_cdr(bytes).map_err(malformed)?;
    PyWindowResult::new(py, reply, names.into(), wall_time_s, has_step_series)
}
