//! The Python class `Simulation` over a local or remote backend.

use crate::arrays::{self, Vector};
use crate::backend::{Backend, LastResult, WindowSpec};
use crate::bodies::{PyTine, SolidArrays, parts, solid};
use crate::calls::CallState;
use crate::case::PyCase;
use crate::errors;
use crate::info::SimulationInfo;
use crate::inputs;
use crate::local::{LocalBackend, SharedContext};
use crate::lock::{lock, lock_detached, try_lock};
use crate::remote::RemoteBackend;
use crate::result::{self, PyWindowResult};
use crate::state::PyState;
use ballast::math::Pose;
use ballast::track::TinePath;
use ballast_protocol::lockstep::ParameterUpdate;
use ballast_protocol::messages::ZoneMeasurement;
use ballast_zenoh::ComponentDescription;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

/// A ballast model advanced in windows. Created by `ballast.open` or `ballast.resume`.
///
/// Threads: `advance_to` releases the GIL. One thread at a time may step a simulation; a second one gets
/// `Error(code="busy")`. Different simulations run in parallel.
///
/// Interrupting: Ctrl-C (main thread), `stop()` or `close()` cancel the running step. Completed steps are kept; see `last`.
///
/// Remote components (`ballast.open("zenoh:SITE/ID")`): a cancelled window continues on the server, and repeating the
/// call returns its result. Available: `advance_to`, `redo`, `last`, `save`, `restore`, `set_parameters`, `stop`,
/// `close`, `now_ns`, `step_ns`, `schedule`, `bodies`, `grain_count`, `roles`, `mounts`, `has_failed`, `is_closed`.
/// Other methods raise `RequestError(code="remote_unsupported")`.
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
        let context = local.context().clone();
        Self {
            calls: Arc::clone(local.calls()),
            last_result: Arc::clone(local.last_result()),
            backend: Mutex::new(Some(AnyBackend::Local(Box::new(local)))),
            info: SimulationInfo::local(&context),
            context: Some(context),
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
    /// Advances the simulation to `t1_ns`.
    ///
    /// Args:
    ///     t1_ns: end of the window, ns since the start of the run; a whole number of steps after `now_ns`.
    ///     motions: motions of driven bodies by name. Other bodies keep their commanded pose; a body that its last cubic
    ///         motion left moving needs a motion that continues it, or one with `allow_jump=True`.
    ///     loads: loads on mounted bodies by name; other mounted bodies have none.
    ///     record_steps: record the impulses of every step, see `WindowResult.step_series`.
    ///     zones: measure the case's zones at the end of the window, see `WindowResult.zones`. This takes longer than
    ///         the rest of a coupling step.
    ///
    /// Raises:
    ///     RequestError: the request is invalid; the simulation has not changed.
    ///     InternalError: a bug in Ballast; only `restore` makes the simulation usable again.
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

    /// Computes the last window again from its start with other inputs, for implicit coupling.
    ///
    /// The window ends at the requested time, even if Ctrl-C, `stop` or an error ended it earlier the first time.
    /// Arguments and errors are those of `advance_to`.
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

    /// Advances one step, in which the case's tamping cycle moves tines and sleepers.
    ///
    /// The motion is that of `ballast run`, including the force limits of the case.
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

    /// Result of the last window, even if its call raised an exception; None before the first and after `restore`.
    #[getter]
    fn last(&self, py: Python<'_>) -> Option<Py<PyWindowResult>> {
        lock(&self.last_result).as_ref().map(|result| result.clone_ref(py))
    }

    /// Cancels the window that another thread is computing; later windows are not affected.
    ///
    /// The running step is dropped. The window's result has the code "stopped" and the status "early", or "discard" if
    /// no step was complete. A remote window continues on the server, and its caller gets
    /// `RemoteError(code="cancelled")`.
    fn stop(&self) {
        self.calls.stop();
    }

    /// Current phase of the tamping cycle: waiting, lift, insertion, squeeze, hold, withdrawal or done.
    #[getter]
    fn phase(&self, py: Python<'_>) -> PyResult<&'static str> {
        self.with_local(py, "phase", |local| {
            Ok(local.cycle().phase(local.component().state().time()).name())
        })
    }

    /// Paths of the tines in the case's tamping cycle; empty without tamping.
    #[getter]
    fn tines(&self, py: Python<'_>) -> PyResult<Vec<PyTine>> {
        self.with_local(py, "tines", |local| {
            let cycle = local.cycle();
            let tine = |path: &TinePath| PyTine {
                name: self.info.names[path.body].clone(),
                pair: cycle.pairs()[path.pair].number,
                path: path.clone(),
            };
            Ok(cycle.tines().iter().map(tine).collect())
        })
    }

    /// Returns the current state, with everything that the next window depends on. The data is shared, not copied.
    fn save(&self, py: Python<'_>) -> PyResult<PyState> {
        self.with(py, |backend| backend.save(py))
    }

    /// Restores a saved state of the same case.
    ///
    /// Raises:
    ///     RequestError: the state belongs to another case, or a recording is open.
    fn restore(&self, py: Python<'_>, state: &PyState) -> PyResult<()> {
        self.with(py, |backend| backend.restore(py, state))
    }

    /// Sets solver parameters for all later windows and for a redo of the last one. Omitted parameters keep their value.
    ///
    /// Args:
    ///     max_iterations: maximum number of iterations per step, at least 1.
    ///     tolerance: residual below which a step counts as solved; 0: always use all iterations.
    ///     max_penetration: penetration that ends a window, m; infinite: no limit.
    ///
    /// Raises:
    ///     RequestError: a value is out of range; nothing has changed.
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

    /// Returns an independent simulation that starts from the current state.
    fn fork(&self, py: Python<'_>) -> PyResult<Self> {
        self.with_local(py, "fork", |local| local.fork(py).map(Self::local))
    }

    /// Starts recording all later windows in an MCAP file, which is replaced.
    ///
    /// If the file cannot be written later, a RuntimeWarning is issued and the simulation continues without recording.
    ///
    /// Raises:
    ///     FileError: the file cannot be created.
    ///     RequestError: a recording is open already.
    fn record(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.with_local(py, "record", |local| local.record(py, path))
    }

    /// Ends the recording, if one is open.
    ///
    /// Raises:
    ///     FileError: the recording is incomplete.
    fn stop_recording(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |backend| backend.stop_recording(py))
    }

    /// Ends the simulation and its recording. Saved states and arrays stay valid.
    ///
    /// A window that another thread is computing is cancelled as by `stop`, and waited for.
    ///
    /// Raises:
    ///     FileError: the recording is incomplete.
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

    /// Case of the simulation.
    #[getter]
    fn case(&self, py: Python<'_>) -> PyResult<PyCase> {
        Ok(PyCase(Arc::clone(&self.context(py, "case")?.case)))
    }

    /// Simulated time, ns since the start of the run.
    #[getter]
    fn now_ns(&self, py: Python<'_>) -> PyResult<u64> {
        self.with(py, |backend| Ok(backend.now_ns()))
    }

    /// Length of a time step, ns.
    #[getter]
    fn step_ns(&self) -> u64 {
        self.info.step_ns
    }

    /// Schedule of the solver: "sequential", "synchronous" or "asynchronous".
    #[getter]
    fn schedule(&self) -> &str {
        &self.info.schedule
    }

    /// Number of computing threads, including the calling one.
    #[getter]
    fn threads(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.context(py, "threads")?.threads.threads())
    }

    /// True after an `InternalError`, until a saved state is restored.
    #[getter]
    fn has_failed(&self) -> bool {
        // A simulation that is being stepped has not failed. Waiting for it would block the interpreter.
        let mut backend = try_lock(&self.backend);
        let backend = backend.as_mut().and_then(|backend| backend.as_mut());
        backend.is_some_and(|backend| backend.common().has_failed())
    }

    /// True after `close`.
    #[getter]
    fn is_closed(&self) -> bool {
        self.calls.is_closing()
    }

    /// Names of the driven bodies: tines, boundaries and sleepers.
    #[getter]
    fn bodies(&self) -> Vec<String> {
        self.info.names.to_vec()
    }

    /// Role of each driven body by name: "boundary", "sleeper" or "tine".
    #[getter]
    fn roles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let roles = PyDict::new(py);
        for (name, body) in self.info.names.iter().zip(&self.info.bodies) {
            roles.set_item(name, &body.role)?;
        }
        Ok(roles)
    }

    /// Mounts by name of the driven bodies that loads can move. All other driven bodies have prescribed motion.
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

    /// Number of grains, ng.
    #[getter]
    fn grain_count(&self) -> usize {
        self.info.grain_count
    }

    /// Measures the case's zones now; returns the results by name.
    fn zones<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let measured = self.with_local(py, "zones", |local| local.zones(py))?;
        result::zones(py, measured.iter().map(|zone| ZoneMeasurement::of(0, zone)))
    }

    /// Shape index of each grain (ng,), for `shape`.
    #[getter]
    fn shape_indices<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py, u32>> {
        Ok(arrays::column(py, &self.context(py, "shape_indices")?.model.grains.shape))
    }

    /// Masses of the grains (ng,), kg.
    #[getter]
    fn masses<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py>> {
        Ok(arrays::column(py, &self.context(py, "masses")?.model.grains.mass))
    }

    /// Returns the corners (n, 3) of a shape in its own frame, m, and its faces.
    ///
    /// Each face is a list of corner indices, counter-clockwise seen from outside.
    fn shape<'py>(&self, py: Python<'py>, index: &Bound<'py, PyAny>) -> PyResult<SolidArrays<'py>> {
        let shapes = &self.context(py, "shape")?.model.shapes;
        let shape = &shapes[inputs::index(index, "shape", shapes.len())?];
        Ok(solid(py, shape, &Pose::identity()))
    }

    /// Returns the convex parts of a driven body: corners (n, 3) in the body's frame, m, and faces as in `shape`.
    ///
    /// Infinite walls have no parts.
    ///
    /// Raises:
    ///     KeyError: no driven body has this name.
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
