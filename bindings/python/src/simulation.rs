//! The Python class `Simulation` over a local or remote backend.

use crate::arrays::{self, Vector};
use crate::backend::{Backend, LastResult, WindowSpec};
use crate::bodies::{PyTine, SolidArrays, parts, solid};
use crate::calls::CallState;
use crate::case::{PyCase, to_dict};
use crate::errors;
use crate::info::SimulationInfo;
use crate::inputs;
use crate::local::{LocalBackend, SharedContext};
use crate::lock::{lock, lock_detached, try_lock};
use crate::probe;
use crate::remote::RemoteBackend;
use crate::result::{self, PyWindowResult};
use crate::state::PyState;
use ballast::component::{PushProbe, StiffnessProbe};
use ballast::math::Pose;
use ballast::observe::stone_statistics;
use ballast_protocol::lockstep::ParameterUpdate;
use ballast_protocol::messages::ZoneMeasurement;
use ballast_session::stones::stones_json;
use ballast_zenoh::ComponentDescription;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

#[doc = stub!("Simulation")]
#[pyclass(frozen, module = "ballast", name = "Simulation")]
pub struct PySimulation {
    /// `None` once closed.
    backend: Mutex<Option<AnyBackend>>,
    calls: Arc<CallState>,
    last_result: LastResult,
    info: SimulationInfo,
    /// `None` for a remote simulation.
    context: Option<SharedContext>,
}

/// A local or a remote backend.
enum AnyBackend {
    Local(Box<LocalBackend>),
    Remote(Box<RemoteBackend>),
}

impl AnyBackend {
    fn common(&mut self) -> &mut dyn Backend {
        match self {
            AnyBackend::Local(local) => &mut **local,
            AnyBackend::Remote(remote) => &mut **remote,
        }
    }
}

impl PySimulation {
    /// Returns a simulation of this process.
    pub fn local(local: LocalBackend) -> Self {
        Self {
            calls: Arc::clone(local.calls()),
            last_result: Arc::clone(local.last_result()),
            info: SimulationInfo::local(&local),
            context: Some(local.context().clone()),
            backend: Mutex::new(Some(AnyBackend::Local(Box::new(local)))),
        }
    }

    /// Returns a simulation of a remote component.
    pub fn remote(remote: RemoteBackend, description: ComponentDescription) -> Self {
        Self {
            calls: Arc::clone(remote.calls()),
            last_result: Arc::clone(remote.last_result()),
            backend: Mutex::new(Some(AnyBackend::Remote(Box::new(remote)))),
            info: SimulationInfo::remote(description),
            context: None,
        }
    }

    /// Calls `act` with the backend, unless the simulation is closed or another thread uses it.
    fn with_any<T>(
        &self,
        py: Python<'_>,
        act: impl FnOnce(&mut AnyBackend) -> PyResult<T>,
    ) -> PyResult<T> {
        let closed = || errors::error::<errors::Error>(py, "closed", "the simulation was closed");
        if self.calls.is_closing() {
            return Err(closed());
        }
        let mut backend = try_lock(&self.backend).ok_or_else(|| {
            let text = "another thread is stepping this simulation; fork it, or wait";
            errors::error::<errors::Error>(py, "busy", text)
        })?;
        let _call = self.calls.begin();
        backend.as_mut().map_or_else(|| Err(closed()), act)
    }

    /// Calls `act` with the backend, for operations that every simulation supports.
    fn with<T>(
        &self,
        py: Python<'_>,
        act: impl FnOnce(&mut dyn Backend) -> PyResult<T>,
    ) -> PyResult<T> {
        self.with_any(py, |backend| act(backend.common()))
    }

    /// Calls `act` with the local backend.
    ///
    /// # Errors
    /// `RequestError` with the code "remote_unsupported" for a remote simulation.
    fn with_local<T>(
        &self,
        py: Python<'_>,
        operation: &str,
        act: impl FnOnce(&mut LocalBackend) -> PyResult<T>,
    ) -> PyResult<T> {
        self.with_any(py, |backend| match backend {
            AnyBackend::Local(local) => act(local),
            AnyBackend::Remote(_) => Err(errors::remote_unsupported(py, operation)),
        })
    }

    fn context(&self, py: Python<'_>, operation: &str) -> PyResult<&SharedContext> {
        self.context.as_ref().ok_or_else(|| errors::remote_unsupported(py, operation))
    }
}

#[pymethods]
impl PySimulation {
    #[doc = stub!("Simulation.advance_to")]
    #[pyo3(signature = (t1_ns, motions=None, loads=None, *, record_steps=false, zones=false))]
    fn advance_to(
        &self,
        py: Python<'_>,
        t1_ns: &Bound<'_, PyAny>,
        motions: Option<&Bound<'_, PyAny>>,
        loads: Option<&Bound<'_, PyAny>>,
        record_steps: bool,
        zones: bool,
    ) -> PyResult<Py<PyWindowResult>> {
        let t1_ns = inputs::time(t1_ns, || "t1_ns".into())?;
        let spec = WindowSpec::from_args(Some(t1_ns), motions, loads, record_steps, zones)?;
        self.with(py, |backend| backend.window(py, &spec))
    }

    #[doc = stub!("Simulation.redo")]
    #[pyo3(signature = (motions=None, loads=None, *, record_steps=false, zones=false))]
    fn redo(
        &self,
        py: Python<'_>,
        motions: Option<&Bound<'_, PyAny>>,
        loads: Option<&Bound<'_, PyAny>>,
        record_steps: bool,
        zones: bool,
    ) -> PyResult<Py<PyWindowResult>> {
        let spec = WindowSpec::from_args(None, motions, loads, record_steps, zones)?;
        self.with(py, |backend| backend.window(py, &spec))
    }

    #[doc = stub!("Simulation.step_tamping_cycle")]
    #[pyo3(signature = (*, record_steps=false, zones=false))]
    fn step_tamping_cycle(
        &self,
        py: Python<'_>,
        record_steps: bool,
        zones: bool,
    ) -> PyResult<Py<PyWindowResult>> {
        self.with_local(py, "step_tamping_cycle", |local| {
            let spec = local.tamping_cycle_step(record_steps, zones);
            local.window(py, &spec)
        })
    }

    #[doc = stub!("Simulation.last")]
    #[getter]
    fn last(&self, py: Python<'_>) -> Option<Py<PyWindowResult>> {
        lock(&self.last_result).as_ref().map(|result| result.clone_ref(py))
    }

    #[doc = stub!("Simulation.stop")]
    fn stop(&self) {
        self.calls.stop();
    }

    #[doc = stub!("Simulation.phase")]
    #[getter]
    fn phase(&self, py: Python<'_>) -> PyResult<&'static str> {
        self.with_local(py, "phase", |local| {
            Ok(local.cycle().phase(local.component().state().time()).name())
        })
    }

    #[doc = stub!("Simulation.tines")]
    #[getter]
    fn tines(&self) -> Vec<PyTine> {
        self.info.tines.iter().cloned().map(PyTine).collect()
    }

    #[doc = stub!("Simulation.save")]
    fn save(&self, py: Python<'_>) -> PyResult<PyState> {
        self.with(py, |backend| backend.save(py))
    }

    #[doc = stub!("Simulation.restore")]
    fn restore(&self, py: Python<'_>, state: &PyState) -> PyResult<()> {
        self.with(py, |backend| backend.restore(py, state))
    }

    #[doc = stub!("Simulation.set_parameters")]
    #[pyo3(signature = (*, max_iterations=None, tolerance=None, max_penetration=None))]
    fn set_parameters(
        &self,
        py: Python<'_>,
        max_iterations: Option<&Bound<'_, PyAny>>,
        tolerance: Option<f64>,
        max_penetration: Option<f64>,
    ) -> PyResult<()> {
        let expected = format!("1 to {}", u32::MAX);
        let out_of_range =
            |py: Python<'_>, place: &str, expected: &str, found: &Bound<'_, PyAny>| {
                errors::request(py, "parameter_invalid", place, expected, found)
            };
        let to_u32 = |found| {
            let kind = "a whole number";
            let number = inputs::whole(found, kind, "max_iterations", &expected, out_of_range)?;
            u32::try_from(number).map_err(|_| out_of_range(py, "max_iterations", &expected, found))
        };
        let max_iterations = max_iterations.map(to_u32).transpose()?;
        let penetration = match max_penetration {
            Some(limit) if !(limit > 0.0) => {
                let place = "max_penetration";
                return Err(errors::request(py, "parameter_invalid", place, "above 0 m", limit));
            }
            // The protocol writes no limit as 0.
            Some(f64::INFINITY) => Some(0.0),
            limit => limit,
        };
        let parameters = ParameterUpdate {
            max_iterations,
            tolerance,
            max_penetration: penetration,
            ..ParameterUpdate::default()
        };
        parameters.check().map_err(|fault| errors::fault(py, &fault))?;
        self.with(py, |backend| backend.set_parameters(py, &parameters))
    }

    #[doc = stub!("Simulation.probe_stiffness")]
    #[pyo3(signature = (sleeper=None, *, max_load=20e3, min_load=1e3, cycles=2, ramp=0.2))]
    fn probe_stiffness<'py>(
        &self,
        py: Python<'py>,
        sleeper: Option<&str>,
        max_load: f64,
        min_load: f64,
        cycles: u32,
        ramp: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let settings = StiffnessProbe { max_load, min_load, cycles, ramp };
        let curve = self.with_local(py, "probe_stiffness", |local| {
            local.probe(py, sleeper, |model, state, body, observer| {
                settings.run(model, state, body, observer)
            })
        })?;
        probe::stiffness(py, &curve)
    }

    #[doc = stub!("Simulation.probe_push")]
    #[pyo3(signature = (sleeper=None, *, displacement=5e-3, speed=0.01, seating=0.2))]
    fn probe_push<'py>(
        &self,
        py: Python<'py>,
        sleeper: Option<&str>,
        displacement: f64,
        speed: f64,
        seating: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let settings = PushProbe { displacement, speed, seating };
        let curve = self.with_local(py, "probe_push", |local| {
            local.probe(py, sleeper, |model, state, body, observer| {
                settings.run(model, state, body, observer)
            })
        })?;
        probe::push(py, &curve)
    }

    #[doc = stub!("Simulation.fork")]
    fn fork(&self, py: Python<'_>) -> PyResult<Self> {
        self.with_local(py, "fork", |local| local.fork(py).map(Self::local))
    }

    #[doc = stub!("Simulation.record")]
    fn record(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.with_local(py, "record", |local| local.record(py, path))
    }

    #[doc = stub!("Simulation.stop_recording")]
    fn stop_recording(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |backend| backend.stop_recording(py))
    }

    #[doc = stub!("Simulation.close")]
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        if !self.calls.close() {
            let text = "close: expected an idle simulation, found one that computes a window for this thread; \
                        `stop` cancels it";
            return Err(errors::error::<errors::Error>(py, "busy", text));
        }
        let mut backend = lock_detached(py, &self.backend);
        let _call = self.calls.begin_last();
        match backend.take() {
            None => Ok(()),
            Some(AnyBackend::Local(local)) => local.close(py),
            Some(AnyBackend::Remote(remote)) => remote.close(py),
        }
    }

    fn __enter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    /// Closes the simulation. If an exception is propagating, an error of `close` becomes a note of it.
    #[pyo3(signature = (*error))]
    fn __exit__(&self, py: Python<'_>, error: &Bound<'_, PyTuple>) -> PyResult<()> {
        let Err(failure) = self.close(py) else { return Ok(()) };
        match error.get_item(1) {
            Ok(first) if !first.is_none() && failure.is_instance_of::<errors::Error>(py) => {
                first.call_method1("add_note", (format!("close: {}", failure.value(py)),))?;
                Ok(())
            }
            _ => Err(failure),
        }
    }

    #[doc = stub!("Simulation.case")]
    #[getter]
    fn case(&self, py: Python<'_>) -> PyResult<PyCase> {
        Ok(PyCase(Arc::clone(&self.context(py, "case")?.case)))
    }

    #[doc = stub!("Simulation.now_ns")]
    #[getter]
    fn now_ns(&self, py: Python<'_>) -> PyResult<u64> {
        self.with(py, |backend| Ok(backend.now_ns()))
    }

    #[doc = stub!("Simulation.step_ns")]
    #[getter]
    fn step_ns(&self) -> u64 {
        self.info.step_ns
    }

    #[doc = stub!("Simulation.schedule")]
    #[getter]
    fn schedule(&self) -> &str {
        &self.info.schedule
    }

    #[doc = stub!("Simulation.threads")]
    #[getter]
    fn threads(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.context(py, "threads")?.threads.threads())
    }

    #[doc = stub!("Simulation.has_failed")]
    #[getter]
    fn has_failed(&self) -> bool {
        // A simulation that is being stepped has not failed. Waiting for it would block the interpreter.
        let mut backend = try_lock(&self.backend);
        let backend = backend.as_mut().and_then(|backend| backend.as_mut());
        backend.is_some_and(|backend| backend.common().has_failed())
    }

    #[doc = stub!("Simulation.is_closed")]
    #[getter]
    fn is_closed(&self) -> bool {
        self.calls.is_closing()
    }

    #[doc = stub!("Simulation.bodies")]
    #[getter]
    fn bodies(&self) -> Vec<String> {
        self.info.names.to_vec()
    }

    #[doc = stub!("Simulation.roles")]
    #[getter]
    fn roles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let roles = PyDict::new(py);
        for (name, body) in self.info.names.iter().zip(&self.info.bodies) {
            roles.set_item(name, &body.role)?;
        }
        Ok(roles)
    }

    #[doc = stub!("Simulation.mounts")]
    #[getter]
    fn mounts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let mounts = PyDict::new(py);
        for (name, body) in self.info.names.iter().zip(&self.info.bodies) {
            if let Some(mount) = &body.mount {
                mounts.set_item(name, mount.clone())?;
            }
        }
        Ok(mounts)
    }

    #[doc = stub!("Simulation.grain_count")]
    #[getter]
    fn grain_count(&self) -> usize {
        self.info.grain_count
    }

    #[doc = stub!("Simulation.zones")]
    fn zones<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let measured = self.with_local(py, "zones", |local| local.zones(py))?;
        result::zones(py, measured.iter().map(|zone| ZoneMeasurement::of(0, zone)))
    }

    #[doc = stub!("Simulation.stones")]
    #[getter]
    fn stones<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let statistics = stone_statistics(&self.context(py, "stones")?.model);
        statistics.map(|stones| to_dict(py, &stones_json(&stones))).transpose()
    }

    #[doc = stub!("Simulation.shape_indices")]
    #[getter]
    fn shape_indices<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py, u32>> {
        Ok(arrays::column(py, &self.context(py, "shape_indices")?.model.grains.shape))
    }

    #[doc = stub!("Simulation.masses")]
    #[getter]
    fn masses<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py>> {
        Ok(arrays::column(py, &self.context(py, "masses")?.model.grains.mass))
    }

    #[doc = stub!("Simulation.shape")]
    fn shape<'py>(&self, py: Python<'py>, index: &Bound<'py, PyAny>) -> PyResult<SolidArrays<'py>> {
        let shapes = &self.context(py, "shape")?.model.shapes;
        let shape = &shapes[inputs::index(index, "shape", shapes.len())?];
        Ok(solid(py, shape, &Pose::identity()))
    }

    #[doc = stub!("Simulation.parts")]
    fn parts<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Vec<SolidArrays<'py>>> {
        let model = &self.context(py, "parts")?.model;
        let driven = model.driven_index(name).map(|d| &model.driven[d]).ok_or_else(|| {
            let text = format!("body: expected one of {:?}, found {name:?}", self.info.names);
            pyo3::exceptions::PyKeyError::new_err(text)
        })?;
        Ok(parts(py, model, driven))
    }

    /// Makes the next step panic, for tests.
    fn _fail_next(&self, py: Python<'_>) -> PyResult<()> {
        self.with_local(py, "_fail_next", |local| {
            local.panics = true;
            Ok(())
        })
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let now = match self.now_ns(py) {
            Ok(t) => format!("{t} ns"),
            Err(_) if self.is_closed() => "closed".into(),
            Err(_) => "in use by another thread".into(),
        };
        format!("Simulation({:?}, {} grains, {now})", self.info.name, self.info.grain_count)
    }
}
