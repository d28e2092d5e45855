//! The simulation in this process: windows, redo, states, recording.

use crate::arrays::{Matrix, Vector};
use crate::case::Case;
use crate::compute::compute;
use crate::errors::{self, Lost};
use crate::inputs::{Load, Motion};
use crate::machine::Machine;
use crate::outcome::{Outcome, Series};
use crate::recorder::Recorder;
use crate::state::State;
use ballast::component::{
    self, Component, Input, Limits, LoadInput, OnTrouble, Refusal, Window, ZoneOutcome,
};
use ballast::model::Model;
use ballast::state;
use ballast::step::StepReport;
use ballast::track::TinePath;
use ballast::track::zones::zones;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use rayon::ThreadPool;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, TryLockError};

/// A model that is stepped in windows.
#[pyclass(frozen, module = "ballast", name = "Simulation")]
pub struct Simulation {
    inner: Mutex<Inner>,
    case: Arc<Case>,
    model: Arc<Model>,
    names: Arc<[String]>,
    pool: Arc<ThreadPool>,
}

struct Inner {
    /// `None` once closed.
    component: Option<Component>,
    recorder: Option<Recorder>,
    machine: Machine,
    /// As it was before the last window.
    machine_before: Option<Machine>,
    /// What the program failed with inside.
    lost: Option<String>,
    /// The next step panics: so that tests can see what becomes of it.
    panics: bool,
}

/// What is asked of a window.
struct Asked {
    motions: Vec<Input>,
    loads: Vec<LoadInput>,
    /// `None`: the last window again.
    t1_ns: Option<u64>,
    /// The motions are those of the machine.
    by_machine: bool,
    /// Keep the impulses of every step.
    series: bool,
    /// Measure the zones at the end.
    zones: bool,
}

impl Asked {
    /// What a partner asks.
    fn of(
        t1_ns: Option<u64>,
        tools: Option<&Bound<'_, PyDict>>,
        loads: Option<&Bound<'_, PyDict>>,
        series: bool,
        zones: bool,
    ) -> PyResult<Self> {
        let (motions, loads) = (motions(tools)?, forces(loads)?);
        Ok(Self { motions, loads, t1_ns, by_machine: false, series, zones })
    }
}

impl Simulation {
    /// A simulation that goes on from `start`.
    pub fn new(
        py: Python<'_>,
        start: &State,
        limits: Limits,
        pool: Arc<ThreadPool>,
    ) -> PyResult<Self> {
        let State { model, state, case, machine } = start;
        let component = Component::new(Arc::clone(model), Arc::clone(state), limits)
            .map_err(|e| errors::refused(py, e.code(), e))?;
        Ok(Self::of(Arc::clone(case), Arc::clone(model), component, machine.clone(), pool))
    }

    fn of(
        case: Arc<Case>,
        model: Arc<Model>,
        component: Component,
        machine: Machine,
        pool: Arc<ThreadPool>,
    ) -> Self {
        let names = model.driven.iter().map(|d| d.name.clone()).collect();
        let inner = Inner {
            component: Some(component),
            recorder: None,
            machine,
            machine_before: None,
            lost: None,
            panics: false,
        };
        Self { inner: Mutex::new(inner), case, model, names, pool }
    }

    fn measured(&self, py: Python<'_>, component: &Component) -> Vec<ZoneOutcome> {
        let (zones, model) = (zones(&self.case.plan), &self.model);
        let (state, workspace) = (component.state(), component.workspace());
        py.detach(|| self.pool.install(|| component::measure(model, state, workspace, &zones)))
    }

    /// The inside, for as long as no other thread steps it.
    fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, Inner>> {
        match self.inner.try_lock() {
            Ok(inner) => Ok(inner),
            Err(TryLockError::Poisoned(inner)) => Ok(inner.into_inner()),
            Err(TryLockError::WouldBlock) => {
                let text = "another thread is stepping this simulation; fork it, or wait";
                Err(errors::error::<errors::Error>(py, "busy", text))
            }
        }
    }

    fn window(&self, py: Python<'_>, asked: &Asked) -> PyResult<Outcome> {
        let mut inner = self.lock(py)?;
        inner.check_sound(py)?;
        let before = inner.component(py)?.save();
        let mut series = asked.series.then(|| Series::new(&self.names));
        let mut machine = match (&asked.t1_ns, &inner.machine_before) {
            (None, Some(machine)) => machine.clone(),
            _ => inner.machine.clone(),
        };
        let machine_before = machine.clone();
        let panics = std::mem::take(&mut inner.panics);
        let window = Window { motions: &asked.motions, loads: &asked.loads };
        let component = inner.component.as_mut().ok_or_else(|| closed(py))?;
        let computed = compute(py, &self.pool, None, |turn| {
            let mut watch = |state: &state::State, report: &StepReport| {
                assert!(!panics, "a failure that was asked for");
                if let Some(series) = &mut series {
                    series.take(state, report);
                }
                if asked.by_machine {
                    machine.observe(&self.model, state, report);
                }
                if turn.is_over() {
                    ControlFlow::Break(OnTrouble::Early)
                } else {
                    ControlFlow::Continue(())
                }
            };
            match asked.t1_ns {
                Some(t1) => component.advance_watched(t1, window, &mut watch),
                None => component.redo_watched(window, &mut watch),
            }
        });
        let (result, raised) = computed.inspect_err(|lost| inner.lose(py, lost, &before))?;
        let mut outcome = result.map_err(|e: Refusal| errors::refused(py, e.code(), e))?;
        let is_discarded = outcome.status == component::Status::Discard;
        inner.machine = if is_discarded { machine_before.clone() } else { machine };
        inner.machine_before = Some(machine_before);
        if asked.zones && !is_discarded {
            outcome.zones = self.measured(py, inner.component(py)?);
        }
        if let Inner { recorder: Some(recorder), component: Some(component), .. } = &mut *inner {
            recorder.window(py, component, asked.t1_ns.is_none(), &window, &outcome)?;
        }
        if let Some(raised) = raised {
            return Err(raised);
        }
        let series = series.map(|s| Py::new(py, s)).transpose()?;
        Ok(Outcome { inner: outcome, names: Arc::clone(&self.names), series })
    }
}

impl Inner {
    fn component(&self, py: Python<'_>) -> PyResult<&Component> {
        self.component.as_ref().ok_or_else(|| closed(py))
    }

    fn check_sound(&self, py: Python<'_>) -> PyResult<()> {
        self.component(py)?;
        match &self.lost {
            None => Ok(()),
            Some(why) => {
                let text = format!("{why}; restore a saved state, or open the case again");
                Err(errors::error::<Lost>(py, "lost", text))
            }
        }
    }

    /// The program failed inside.
    fn lose(&mut self, py: Python<'_>, why: &PyErr, before: &Arc<state::State>) {
        self.lost = Some(why.value(py).to_string());
        self.recorder = None;
        if let Some(component) = &mut self.component {
            // It was the state of this model a moment ago.
            let _ = component.recover(Arc::clone(before));
        }
    }
}

fn closed(py: Python<'_>) -> PyErr {
    errors::error::<errors::Error>(py, "closed", "the simulation was closed")
}

fn motions(tools: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<Input>> {
    let input = |(name, motion): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        let motion = motion.cast::<Motion>()?.get();
        let (waveform, rebase) = (motion.waveform.clone(), motion.rebase);
        Ok(Input { body: name.extract()?, waveform, rebase })
    };
    tools.map_or(Ok(Vec::new()), |tools| tools.iter().map(input).collect())
}

fn forces(loads: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<LoadInput>> {
    let input = |(name, load): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
        let waveform = load.cast::<Load>()?.get().waveform.clone();
        Ok(LoadInput { body: name.extract()?, waveform })
    };
    loads.map_or(Ok(Vec::new()), |loads| loads.iter().map(input).collect())
}

#[pymethods]
impl Simulation {
    /// Advances to `t1_ns`, a whole number of steps from now.
    #[pyo3(signature = (t1_ns, tools=None, loads=None, *, series=false, zones=false))]
    fn advance_to(
        &self,
        py: Python<'_>,
        t1_ns: u64,
        tools: Option<&Bound<'_, PyDict>>,
        loads: Option<&Bound<'_, PyDict>>,
        series: bool,
        zones: bool,
    ) -> PyResult<Outcome> {
        self.window(py, &Asked::of(Some(t1_ns), tools, loads, series, zones)?)
    }

    /// Computes the last window again from its beginning, with other inputs.
    #[pyo3(signature = (tools=None, loads=None, *, series=false, zones=false))]
    fn redo(
        &self,
        py: Python<'_>,
        tools: Option<&Bound<'_, PyDict>>,
        loads: Option<&Bound<'_, PyDict>>,
        series: bool,
        zones: bool,
    ) -> PyResult<Outcome> {
        self.window(py, &Asked::of(None, tools, loads, series, zones)?)
    }

    /// A window of one step, in which the machine of the case moves tines and sleepers.
    #[pyo3(signature = (*, series=false, zones=false))]
    fn step_by_machine(&self, py: Python<'_>, series: bool, zones: bool) -> PyResult<Outcome> {
        let (motions, t1_ns) = {
            let inner = self.lock(py)?;
            let state = inner.component(py)?.state();
            let motions = inner.machine.motions(&self.model, state);
            (motions, Some(state.time_ns + self.model.stepping.step_ns))
        };
        self.window(
            py,
            &Asked { motions, loads: Vec::new(), t1_ns, by_machine: true, series, zones },
        )
    }

    /// The phase of the case's tamping cycle at this time.
    #[getter]
    fn phase(&self, py: Python<'_>) -> PyResult<&'static str> {
        let inner = self.lock(py)?;
        Ok(inner.machine.phase(inner.component(py)?.state().time()).name())
    }

    /// The ways of the tines through the case's tamping cycle.
    #[getter]
    fn tines(&self, py: Python<'_>) -> PyResult<Vec<Tine>> {
        let tine =
            |path: &TinePath| Tine { name: self.names[path.body].clone(), path: path.clone() };
        Ok(self.lock(py)?.machine.cycle().tines().iter().map(tine).collect())
    }

    /// Everything that the next window depends on; shared, not copied.
    fn save(&self, py: Python<'_>) -> PyResult<State> {
        let inner = self.lock(py)?;
        Ok(State {
            model: Arc::clone(&self.model),
            state: inner.component(py)?.save(),
            case: Arc::clone(&self.case),
            machine: inner.machine.clone(),
        })
    }

    /// Goes back, or on, to a saved state of the same case.
    fn restore(&self, py: Python<'_>, state: &State) -> PyResult<()> {
        let mut inner = self.lock(py)?;
        if inner.recorder.is_some() {
            let text =
                "restore: expected no open recording, whose time cannot jump; stop_recording first";
            return Err(errors::refused(py, "recording", text));
        }
        if !Arc::ptr_eq(&self.model, &state.model) && *self.model != *state.model {
            let text = "state: expected one of this case and seed, found one of another model";
            return Err(errors::refused(py, "state_invalid", text));
        }
        let component = inner.component.as_mut().ok_or_else(|| closed(py))?;
        component
            .restore(Arc::clone(&state.state))
            .map_err(|e| errors::refused(py, e.code(), e))?;
        inner.lost = None;
        (inner.machine, inner.machine_before) = (state.machine.clone(), None);
        Ok(())
    }

    /// Another simulation that goes on from here on its own.
    fn fork(&self, py: Python<'_>) -> PyResult<Self> {
        let inner = self.lock(py)?;
        inner.check_sound(py)?;
        let fork = inner.component(py)?.fork();
        let (case, model) = (Arc::clone(&self.case), Arc::clone(&self.model));
        Ok(Self::of(case, model, fork, inner.machine.clone(), Arc::clone(&self.pool)))
    }

    /// Records the windows from now on in an MCAP file, which is replaced.
    fn record(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let mut inner = self.lock(py)?;
        inner.check_sound(py)?;
        if inner.recorder.is_some() {
            let text = "record: expected no open recording, found one; stop_recording first";
            return Err(errors::refused(py, "recording", text));
        }
        let recorder = Recorder::create(py, path, &self.case, inner.component(py)?)?;
        inner.recorder = Some(recorder);
        Ok(())
    }

    /// Ends the recording, if there is one.
    fn stop_recording(&self, py: Python<'_>) -> PyResult<()> {
        let mut inner = self.lock(py)?;
        let Some(recorder) = inner.recorder.take() else { return Ok(()) };
        recorder.finish(py, inner.component(py)?)
    }

    /// Ends the simulation; states and arrays that it gave away stay.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        if self.lock(py)?.component.is_none() {
            return Ok(());
        }
        let result = self.stop_recording(py);
        self.lock(py)?.component = None;
        result
    }

    fn __enter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    #[pyo3(signature = (*_error))]
    fn __exit__(&self, py: Python<'_>, _error: &Bound<'_, PyTuple>) -> PyResult<()> {
        self.close(py)
    }

    #[getter]
    fn case(&self) -> Case {
        Case::clone(&self.case)
    }

    #[getter]
    fn now_ns(&self, py: Python<'_>) -> PyResult<u64> {
        Ok(self.lock(py)?.component(py)?.now_ns())
    }

    #[getter]
    fn step_ns(&self) -> u64 {
        self.model.stepping.step_ns
    }

    #[getter]
    fn schedule(&self) -> &'static str {
        self.model.solver.schedule.name()
    }

    #[getter]
    fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    #[getter]
    fn is_lost(&self) -> bool {
        // One that is being stepped is not lost yet. Waiting for it would keep the interpreter from its thread.
        self.inner.try_lock().is_ok_and(|inner| inner.lost.is_some())
    }

    #[getter]
    fn is_closed(&self) -> bool {
        self.inner.try_lock().is_ok_and(|inner| inner.component.is_none())
    }

    /// Names of the driven bodies.
    #[getter]
    fn bodies(&self) -> Vec<String> {
        self.names.to_vec()
    }

    #[getter]
    fn grains(&self) -> usize {
        self.model.grains.len()
    }

    /// Zones measured now.
    fn zones<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let inner = self.lock(py)?;
        let measured = self.measured(py, inner.component(py)?);
        crate::outcome::zones(py, &measured)
    }

    /// Which shape each grain has.
    #[getter]
    fn shape_of<'py>(&self, py: Python<'py>) -> Vector<'py, u32> {
        crate::arrays::column(py, &self.model.grains.shape)
    }

    #[getter]
    fn masses<'py>(&self, py: Python<'py>) -> Vector<'py> {
        crate::arrays::column(py, &self.model.grains.mass)
    }

    /// Corners of a shape, and its faces as corners' numbers, counter-clockwise from outside.
    fn shape<'py>(&self, py: Python<'py>, index: usize) -> PyResult<(Matrix<'py>, Vec<Vec<u16>>)> {
        let shape = self.model.shapes.get(index).ok_or_else(|| {
            let text = format!("shape {index}; there are {}", self.model.shapes.len());
            pyo3::exceptions::PyIndexError::new_err(text)
        })?;
        let corners: Vec<f64> = shape.vertices.iter().flatten().copied().collect();
        let ends = shape.face_starts.windows(2);
        let faces =
            ends.map(|e| shape.face_vertices[e[0] as usize..e[1] as usize].to_vec()).collect();
        Ok((crate::arrays::table(py, &corners, 3), faces))
    }

    /// The next window's first step fails as if by a fault of the program.
    fn _fail_next(&self, py: Python<'_>) -> PyResult<()> {
        self.lock(py)?.panics = true;
        Ok(())
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let now = self.now_ns(py).map_or("closed".into(), |t| format!("{t} ns"));
        format!("Simulation({:?}, {} grains, {now})", self.case.plan.name, self.model.grains.len())
    }
}

/// The way of a tine through the tamping cycle of its case.
#[pyclass(frozen, module = "ballast")]
pub struct Tine {
    name: String,
    path: TinePath,
}

#[pymethods]
impl Tine {
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    #[getter]
    fn pair(&self) -> usize {
        self.path.pair
    }

    #[getter]
    fn direction(&self) -> f64 {
        self.path.direction
    }

    #[getter]
    fn start<'py>(&self, py: Python<'py>) -> Vector<'py> {
        crate::arrays::vector(py, &self.path.start)
    }

    #[getter]
    fn deep(&self) -> f64 {
        self.path.deep
    }

    #[getter]
    fn stroke(&self) -> f64 {
        self.path.stroke
    }

    fn __repr__(&self) -> String {
        format!("Tine({:?}, pair {})", self.name, self.path.pair)
    }
}
