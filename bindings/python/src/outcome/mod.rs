//! What a window did.

mod body;
mod series;
mod solver;
mod squeeze;
mod zone;

pub use body::Body;
pub use series::Series;
pub use solver::{Energy, Solver};
pub use squeeze::Squeeze;
pub use zone::{ZoneMeasure, zones};

use ballast::component;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyIterator};
use std::sync::Arc;

/// What ended a window, for programs and for people.
pub struct Trouble {
    pub code: String,
    pub text: String,
}

/// The result of a window, a mapping: `outcome[name]` is what the ballast did to a body.
#[pyclass(frozen, module = "ballast")]
pub struct Outcome {
    pub inner: component::WindowResult,
    /// What ended the window, where something did.
    pub trouble: Option<Trouble>,
    /// How long the window took, s: to compute, or elsewhere until it was answered.
    pub wall_s: f64,
    /// Of the driven bodies `[nd]`.
    pub names: Arc<[String]>,
    pub series: Option<Py<Series>>,
}

impl Outcome {
    /// The number of a driven body.
    fn body(&self, name: &str) -> Option<usize> {
        self.names.iter().position(|known| known == name)
    }
}

#[pymethods]
impl Outcome {
    /// "ok"; "warn": a step stopped at its cap of iterations; "early": ended before its end, in a valid
    /// state; "discard": nothing was kept.
    #[getter]
    fn status(&self) -> &'static str {
        self.inner.status.name()
    }

    /// What ended the window, where something did.
    #[getter]
    fn trouble(&self) -> Option<&str> {
        self.trouble.as_ref().map(|trouble| &trouble.text[..])
    }

    /// What ended the window, for programs: "over_speed", "penetration", "not_finite", "step_failed", or "stopped": by
    /// `stop`, `close` or Ctrl-C.
    #[getter]
    fn code(&self) -> Option<&str> {
        self.trouble.as_ref().map(|trouble| &trouble.code[..])
    }

    /// Where it began, ns since the start of the run.
    #[getter]
    fn t0_ns(&self) -> u64 {
        self.inner.t0_ns
    }

    /// As far as it was computed, ns.
    #[getter]
    fn t1_ns(&self) -> u64 {
        self.inner.t1_ns
    }

    /// How many were computed.
    #[getter]
    fn steps(&self) -> u64 {
        self.inner.steps
    }

    /// What the ballast did to each driven body, by name.
    #[getter]
    fn bodies<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for (name, body) in self.names.iter().zip(&self.inner.bodies) {
            all.set_item(name, Body(*body))?;
        }
        Ok(all)
    }

    /// At the end of the window, where `zones=True` asked for them.
    #[getter]
    fn zones<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        zones(py, &self.inner.zones)
    }

    /// Squeezes that were in progress, by pair of tines ("pair_0"); of two of a pair the later one. How they are told
    /// apart: docs/src/coupling/concepts.md.
    #[getter]
    fn squeezes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for squeeze in &self.inner.squeezes {
            all.set_item(&squeeze.name, Squeeze(squeeze.clone()))?;
        }
        Ok(all)
    }

    /// How it was solved.
    #[getter]
    fn solver(&self) -> Solver {
        Solver(self.inner.solver)
    }

    /// Since the start of the run.
    #[getter]
    fn energy(&self) -> Energy {
        Energy(self.inner.energy)
    }

    /// How far apart knots may be for no body to move too far between them at its speed now, ns;
    /// 0 where nothing moves, and of a recording.
    #[getter]
    fn hint_max_step_ns(&self) -> u64 {
        self.inner.max_knot_spacing_ns
    }

    /// How long the window took to compute, s of wall time; elsewhere: until it was answered; nan of a recording.
    #[getter]
    fn wall_s(&self) -> f64 {
        self.wall_s
    }

    /// Step by step, where `series=True` asked for it.
    #[getter]
    fn series(&self, py: Python<'_>) -> Option<Py<Series>> {
        self.series.as_ref().map(|s| s.clone_ref(py))
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyIterator>> {
        self.bodies(py)?.try_iter()
    }

    fn __len__(&self) -> usize {
        self.names.len()
    }

    /// Names of the bodies, as those of `bodies`.
    fn keys<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.bodies(py)?.call_method0("keys")
    }

    /// What the ballast did to each, as those of `bodies`.
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.bodies(py)?.call_method0("values")
    }

    /// Both, as those of `bodies`.
    fn items<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.bodies(py)?.call_method0("items")
    }

    fn __getitem__(&self, name: &str) -> PyResult<Body> {
        let body = self.body(name).map(|d| Body(self.inner.bodies[d]));
        // Python quotes the text of a KeyError, with whatever it has of quotes.
        body.ok_or_else(|| {
            let text = format!("body: expected one of {}, found {name}", self.names.join(", "));
            pyo3::exceptions::PyKeyError::new_err(text)
        })
    }

    /// What the ballast did to a body, or `default` where there is none of this name.
    #[pyo3(signature = (name, default=None))]
    fn get(&self, py: Python<'_>, name: &str, default: Option<Py<PyAny>>) -> PyResult<Py<PyAny>> {
        match self.body(name) {
            Some(d) => Ok(Py::new(py, Body(self.inner.bodies[d]))?.into_any()),
            None => Ok(default.unwrap_or_else(|| py.None())),
        }
    }

    fn __contains__(&self, name: &Bound<'_, PyAny>) -> bool {
        name.extract().is_ok_and(|name: &str| self.body(name).is_some())
    }

    fn __repr__(&self) -> String {
        let component::WindowResult { t0_ns, t1_ns, steps, .. } = self.inner;
        format!("Outcome({}, {t0_ns} to {t1_ns} ns, {steps} steps)", self.status())
    }
}
