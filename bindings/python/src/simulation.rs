//! The simulation: windows, redo, states, recording, in this process or elsewhere.

use crate::arrays::Vector;
use crate::bodies::{self, Solid, Tine, parts, solid};
use crate::case::Case;
use crate::compute::Crew;
use crate::errors;
use crate::here::{Ground, Here};
use crate::inputs::{self, Load, Motion};
use crate::lock::{enter, enter_if_free, enter_patiently};
use crate::outcome::Outcome;
use crate::state::{Saved, Snapshot, State};
use crate::there::There;
use crate::work::Work;
use ballast::component::{Limits, LoadInput, MotionInput, WindowInputsRef};
use ballast::math::Pose;
use ballast::track::TinePath;
use ballast_protocol::lockstep::{SetParameters, WindowKind};
use ballast_zenoh::Description;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};

/// A model that is stepped in windows: of `ballast.open` and `ballast.resume`.
///
/// Computing releases the interpreter; Ctrl-C ends a window within a step, which is then not done, in a valid state:
/// `last` tells what it has come to. Python tells Ctrl-C to its main thread alone: a window of another thread ends by
/// `stop` or `close`, and so with `with`. One that another process computes (`ballast.open("zenoh:SITE/ID")`) goes on
/// there: the same call made again gives its outcome, any other one waits for its end first. Of that one, `advance_to`,
/// `redo`, `last`, `save`, `restore`, `set_parameters`, `stop`, `close` and what says of itself here are there; the rest
/// is refused with the code "elsewhere".
/// Only one thread at a time may step a simulation (another one gets `Error` with the code "busy");
/// simulations of their own run side by side.
#[pyclass(frozen, module = "ballast", name = "Simulation")]
pub struct Simulation {
    /// `None` once closed.
    back: Mutex<Option<Back>>,
    work: Arc<Work>,
    told: LastOutcome,
    about: About,
    /// Of a simulation of this process.
    ground: Option<Ground>,
}

/// The outcome of the last window.
pub type LastOutcome = Arc<Mutex<Option<Py<Outcome>>>>;

/// Who computes.
enum Back {
    Here(Box<Here>),
    There(Box<There>),
}

/// What does not change while a simulation is stepped.
struct About {
    name: String,
    /// Of the driven bodies `[nd]`.
    names: Arc<[String]>,
    bodies: Vec<bodies::About>,
    step_ns: u64,
    schedule: String,
    grains: usize,
}

/// What is asked of a window.
pub struct Asked {
    pub motions: Vec<MotionInput>,
    pub loads: Vec<LoadInput>,
    /// `None`: the last window again.
    pub t1_ns: Option<u64>,
    /// The motions are those of the machine.
    pub by_machine: bool,
    /// Keep the impulses of every step.
    pub series: bool,
    /// Measure the zones at the end.
    pub zones: bool,
}

impl Asked {
    /// What a partner asks.
    fn of(
        t1_ns: Option<u64>,
        tools: Option<&Bound<'_, PyAny>>,
        loads: Option<&Bound<'_, PyAny>>,
        series: bool,
        zones: bool,
    ) -> PyResult<Self> {
        let motions = inputs::named("tools", tools, |body, motion: &Bound<'_, Motion>| {
            let Motion { waveform, rebase } = motion.get();
            MotionInput { body, waveform: waveform.clone(), allow_jump: *rebase }
        })?;
        let loads = inputs::named("loads", loads, |body, load: &Bound<'_, Load>| LoadInput {
            body,
            waveform: load.get().waveform.clone(),
        })?;
        Ok(Self { motions, loads, t1_ns, by_machine: false, series, zones })
    }

    /// Without an end of its own it is the last window again.
    pub fn kind(&self) -> WindowKind {
        if self.t1_ns.is_some() { WindowKind::Advance } else { WindowKind::Redo }
    }

    /// What moves the bodies.
    pub fn window(&self) -> WindowInputsRef<'_> {
        WindowInputsRef { motions: &self.motions, loads: &self.loads }
    }
}

impl Simulation {
    /// A simulation of this process that goes on from `start`.
    pub fn here(py: Python<'_>, start: &Snapshot, limits: Limits, crew: Crew) -> PyResult<Self> {
        Ok(Self::of(Here::new(py, start, limits, crew)?))
    }

    fn of(here: Here) -> Self {
        let ground = here.ground().clone();
        let Ground { case, model, names, .. } = &ground;
        let about = About {
            name: case.plan.name.clone(),
            names: Arc::clone(names),
            bodies: model.driven.iter().map(Into::into).collect(),
            step_ns: model.stepping.step_ns,
            schedule: model.solver.schedule.name().into(),
            grains: model.grains.len(),
        };
        let (work, told) = (Arc::clone(here.work()), Arc::clone(here.told()));
        let back = Mutex::new(Some(Back::Here(Box::new(here))));
        Self { back, work, told, about, ground: Some(ground) }
    }

    /// One that another process computes.
    pub fn there(there: There, about: Description) -> Self {
        let schedule = about.parameters.get("schedule").and_then(|s| s.as_str());
        let about = About {
            name: format!("zenoh:{}", about.key),
            schedule: schedule.unwrap_or_default().into(),
            names: about.bodies.iter().map(|b| b.name.clone()).collect(),
            bodies: about.bodies.into_iter().map(Into::into).collect(),
            step_ns: about.step_ns,
            grains: about.grains,
        };
        let (work, told) = (Arc::clone(there.work()), Arc::clone(there.told()));
        let back = Mutex::new(Some(Back::There(Box::new(there))));
        Self { back, work, told, about, ground: None }
    }

    /// What steps it, for as long as no other thread does.
    fn lock(&self, py: Python<'_>) -> PyResult<MutexGuard<'_, Option<Back>>> {
        if self.work.is_closing() {
            return Err(closed(py));
        }
        enter_if_free(&self.back).ok_or_else(|| {
            let text = "another thread is stepping this simulation; fork it, or wait";
            errors::error::<errors::Error>(py, "busy", text)
        })
    }

    /// Does what every simulation can.
    fn with<T>(&self, py: Python<'_>, act: impl FnOnce(&mut Back) -> PyResult<T>) -> PyResult<T> {
        let mut back = self.lock(py)?;
        let _call = self.work.begin();
        back.as_mut().map_or_else(|| Err(closed(py)), act)
    }

    /// Does what only one of this process can.
    fn with_here<T>(
        &self,
        py: Python<'_>,
        what: &str,
        act: impl FnOnce(&mut Here) -> PyResult<T>,
    ) -> PyResult<T> {
        self.with(py, |back| match back {
            Back::Here(here) => act(here),
            Back::There(_) => Err(errors::elsewhere(py, what)),
        })
    }

    /// The ground of a simulation of this process.
    fn ground(&self, py: Python<'_>, what: &str) -> PyResult<&Ground> {
        self.ground.as_ref().ok_or_else(|| errors::elsewhere(py, what))
    }

    fn window(&self, py: Python<'_>, asked: &Asked) -> PyResult<Py<Outcome>> {
        self.with(py, |back| match back {
            Back::Here(here) => here.window(py, asked),
            Back::There(there) => there.window(py, asked),
        })
    }
}

fn closed(py: Python<'_>) -> PyErr {
    errors::error::<errors::Error>(py, "closed", "the simulation was closed")
}

#[pymethods]
impl Simulation {
    /// Advances to `t1_ns`, a whole number of steps from now.
    ///
    /// Args:
    ///     t1_ns: end of the window, ns since the start of the run.
    ///     tools: motions of driven bodies by name; the others stay where they are. One that a cubic motion has left
    ///         moving needs another one: that goes on so, or has `rebase`.
    ///     loads: loads on mounted bodies by name; the others have none.
    ///     series: keep the impulses of every step, see `Outcome.series`.
    ///     zones: measure the case's zones at the end, see `Outcome.zones`; it takes longer than a coupling's
    ///         own work, so it is not done unasked.
    ///
    /// Raises:
    ///     Refused: the request makes no sense; nothing has changed.
    ///     Lost: the program failed inside.
    #[pyo3(signature = (t1_ns, tools=None, loads=None, *, series=false, zones=false))]
    fn advance_to(
        &self,
        py: Python<'_>,
        t1_ns: &Bound<'_, PyAny>,
        tools: Option<&Bound<'_, PyAny>>,
        loads: Option<&Bound<'_, PyAny>>,
        series: bool,
        zones: bool,
    ) -> PyResult<Py<Outcome>> {
        let t1_ns = inputs::time(t1_ns, || "t1_ns".into())?;
        self.window(py, &Asked::of(Some(t1_ns), tools, loads, series, zones)?)
    }

    /// Computes the last window again from its beginning, with other inputs: for implicit coupling. It is computed as it was
    /// asked for, also where Ctrl-C, `stop` or trouble (status "early") had ended it before its end.
    #[pyo3(signature = (tools=None, loads=None, *, series=false, zones=false))]
    fn redo(
        &self,
        py: Python<'_>,
        tools: Option<&Bound<'_, PyAny>>,
        loads: Option<&Bound<'_, PyAny>>,
        series: bool,
        zones: bool,
    ) -> PyResult<Py<Outcome>> {
        self.window(py, &Asked::of(None, tools, loads, series, zones)?)
    }

    /// A window of one step, in which the machine of the case moves tines and sleepers, as `ballast run`
    /// does: with the force limits of the case, from what it remembers of its own steps.
    #[pyo3(signature = (*, series=false, zones=false))]
    fn step_by_machine(&self, py: Python<'_>, series: bool, zones: bool) -> PyResult<Py<Outcome>> {
        self.with_here(py, "step_by_machine", |here| {
            let asked = here.asked_by_machine(series, zones);
            here.window(py, &asked)
        })
    }

    /// The outcome of the last window as far as it was computed, also where Ctrl-C or another exception came instead of
    /// it; None before the first window and after `restore`.
    #[getter]
    fn last(&self, py: Python<'_>) -> Option<Py<Outcome>> {
        enter(&self.told).as_ref().map(|outcome| outcome.clone_ref(py))
    }

    /// Ends the window that another thread is computing, within a step, which is then not done: its outcome has the
    /// code "stopped" and the status "early", or "discard" where it was the first step. One that another process
    /// computes goes on there, and its caller gets `Unreachable` with the code "abandoned". Windows that are begun later
    /// are not ended.
    fn stop(&self) {
        self.work.stop();
    }

    /// Of the case's tamping cycle at this time: waiting, lift, insertion, squeeze, hold, withdrawal
    /// or done.
    #[getter]
    fn phase(&self, py: Python<'_>) -> PyResult<&'static str> {
        self.with_here(py, "phase", |here| {
            Ok(here.machine().phase(here.component().state().time()).name())
        })
    }

    /// The ways of the tines through the case's tamping cycle; none without tamping.
    #[getter]
    fn tines(&self, py: Python<'_>) -> PyResult<Vec<Tine>> {
        self.with_here(py, "tines", |here| {
            let cycle = here.machine().cycle();
            let tine = |path: &TinePath| Tine {
                name: self.about.names[path.body].clone(),
                pair: cycle.pairs()[path.pair].number,
                path: path.clone(),
            };
            Ok(cycle.tines().iter().map(tine).collect())
        })
    }

    /// Everything that the next window depends on; shared, not copied.
    fn save(&self, py: Python<'_>) -> PyResult<State> {
        self.with(py, |back| {
            Ok(State(match back {
                Back::Here(here) => Saved::Here(here.save()),
                Back::There(there) => Saved::There(there.save(py)?),
            }))
        })
    }

    /// Goes back, or on, to a saved state of the same case.
    fn restore(&self, py: Python<'_>, state: &State) -> PyResult<()> {
        self.with(py, |back| match (back, &state.0) {
            (Back::Here(here), Saved::Here(snapshot)) => here.restore(py, snapshot),
            (Back::There(there), Saved::There(kept)) => there.restore(py, kept),
            (Back::Here(_), Saved::There(kept)) => {
                let found = format!("one kept at {}", kept.component);
                Err(errors::refused(py, "state_invalid", "state", "one of this process", found))
            }
            (Back::There(_), Saved::Here(_)) => {
                let expected = format!("one kept at {}", self.about.name);
                Err(errors::refused(py, "state_invalid", "state", expected, "one of this process"))
            }
        })
    }

    /// Sets how steps are solved from now on, also in a redo of the last window; what is not given stays.
    ///
    /// Args:
    ///     iterations: most iterations of a step, at least 1.
    ///     tolerance: a step is solved when its residual is below; 0: always all iterations.
    ///     max_penetration: how deep a step may press bodies into each other, m, before its window is taken back;
    ///         infinite: any.
    ///
    /// Raises:
    ///     Refused: a number that makes no sense; nothing has changed.
    #[pyo3(signature = (*, iterations=None, tolerance=None, max_penetration=None))]
    fn set_parameters(
        &self,
        py: Python<'_>,
        iterations: Option<&Bound<'_, PyAny>>,
        tolerance: Option<f64>,
        max_penetration: Option<f64>,
    ) -> PyResult<()> {
        let expected = format!("1 to {}", u32::MAX);
        let beyond = |py: Python<'_>, place: &str, expected: &str, found: &Bound<'_, PyAny>| {
            errors::refused(py, "parameter_invalid", place, expected, found)
        };
        let most = |asked| {
            let most = inputs::whole(asked, "a whole number", "iterations", &expected, beyond)?;
            u32::try_from(most).map_err(|_| beyond(py, "iterations", &expected, asked))
        };
        let iterations = iterations.map(most).transpose()?;
        let penetration = match max_penetration {
            Some(most) if !(most > 0.0) => {
                let place = "max_penetration";
                return Err(errors::refused(py, "parameter_invalid", place, "above 0 m", most));
            }
            // The word of the contract for any.
            Some(f64::INFINITY) => Some(0.0),
            given => given,
        };
        let ask = SetParameters { iterations, tolerance, penetration, ..Default::default() };
        ask.check().map_err(|fault| errors::fault(py, &fault))?;
        self.with(py, |back| match back {
            Back::Here(here) => here.set_parameters(py, &ask),
            Back::There(there) => there.set_parameters(py, &ask),
        })
    }

    /// Another simulation that goes on from here on its own.
    fn fork(&self, py: Python<'_>) -> PyResult<Self> {
        self.with_here(py, "fork", |here| here.fork(py).map(Self::of))
    }

    /// Records the windows from now on in an MCAP file, which is replaced. Where the file cannot be written any
    /// more, a RuntimeWarning says so, and the simulation goes on unrecorded.
    fn record(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.with_here(py, "record", |here| here.record(py, path))
    }

    /// Ends the recording, if there is one. Raises FileError, also where its file could not be written to the end.
    fn stop_recording(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |back| match back {
            Back::Here(here) => here.stop_recording(py),
            Back::There(_) => Ok(()),
        })
    }

    /// Ends the simulation, and its recording as `stop_recording` does; states and arrays that it gave away stay. A window
    /// that another thread is computing is ended as by `stop`, and waited for.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        if !self.work.close() {
            let text = "what is to be closed is computing a window for this thread; `stop` ends it";
            return Err(errors::error::<errors::Error>(py, "busy", text));
        }
        let mut back = enter_patiently(py, &self.back);
        let _call = self.work.begin_last();
        match back.take() {
            None => Ok(()),
            Some(Back::Here(mut here)) => here.stop_recording(py),
            Some(Back::There(there)) => there.close(py),
        }
    }

    fn __enter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    /// Closes. What goes wrong with that is a note to the exception on its way, where there is one.
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

    /// What it is a simulation of.
    #[getter]
    fn case(&self, py: Python<'_>) -> PyResult<Case> {
        Ok(Case(Arc::clone(&self.ground(py, "case")?.case)))
    }

    /// Simulated time, ns since the start of the run.
    #[getter]
    fn now_ns(&self, py: Python<'_>) -> PyResult<u64> {
        self.with(py, |back| {
            Ok(match back {
                Back::Here(here) => here.component().now_ns(),
                Back::There(there) => there.now_ns(),
            })
        })
    }

    /// Length of a step, ns.
    #[getter]
    fn step_ns(&self) -> u64 {
        self.about.step_ns
    }

    /// Of the solver: "sequential", "synchronous" or "asynchronous".
    #[getter]
    fn schedule(&self) -> &str {
        &self.about.schedule
    }

    /// How many threads compute, the calling one among them.
    #[getter]
    fn threads(&self, py: Python<'_>) -> PyResult<usize> {
        Ok(self.ground(py, "threads")?.crew.threads())
    }

    /// Whether the program failed inside; `restore` of a saved state goes on.
    #[getter]
    fn is_lost(&self) -> bool {
        // One that is being stepped is not lost yet. Waiting for it would keep the interpreter from its thread.
        let is_lost = |back: &Option<Back>| match back {
            Some(Back::Here(here)) => here.is_lost(),
            Some(Back::There(there)) => there.is_lost(),
            None => false,
        };
        enter_if_free(&self.back).is_some_and(|back| is_lost(&back))
    }

    /// Whether `close` was called.
    #[getter]
    fn is_closed(&self) -> bool {
        self.work.is_closing()
    }

    /// Names of the driven bodies: tines, boundaries, sleepers.
    #[getter]
    fn bodies(&self) -> Vec<String> {
        self.about.names.to_vec()
    }

    /// What each driven body is, by name: "boundary", "sleeper" or "tine".
    #[getter]
    fn roles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for (name, body) in self.about.names.iter().zip(&self.about.bodies) {
            all.set_item(name, &body.role)?;
        }
        Ok(all)
    }

    /// What holds the driven bodies that loads can move, by name. The motion of the others is imposed.
    #[getter]
    fn mounts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for (name, body) in self.about.names.iter().zip(&self.about.bodies) {
            if let Some(mount) = &body.mount {
                all.set_item(name, mount.clone())?;
            }
        }
        Ok(all)
    }

    /// Number of grains.
    #[getter]
    fn grains(&self) -> usize {
        self.about.grains
    }

    /// The case's zones, measured now.
    fn zones<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let measured = self.with_here(py, "zones", |here| here.zones(py))?;
        crate::outcome::zones(py, &measured)
    }

    /// (ng,) which shape each grain has.
    #[getter]
    fn shape_of<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py, u32>> {
        Ok(crate::arrays::column(py, &self.ground(py, "shape_of")?.model.grains.shape))
    }

    /// (ng,) kg.
    #[getter]
    fn masses<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py>> {
        Ok(crate::arrays::column(py, &self.ground(py, "masses")?.model.grains.mass))
    }

    /// Corners (n, 3) of a shape in its own frame, m, and its faces as numbers of corners,
    /// counter-clockwise from outside.
    fn shape<'py>(&self, py: Python<'py>, index: &Bound<'py, PyAny>) -> PyResult<Solid<'py>> {
        let shapes = &self.ground(py, "shape")?.model.shapes;
        let shape = &shapes[inputs::index(index, "shape", shapes.len())?];
        Ok(solid(py, shape, &Pose::identity()))
    }

    /// The solids that a driven body is made of, each as corners (n, 3) in the body's frame, m, and faces as those of
    /// `shape`. A wall without end has none.
    fn parts<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Vec<Solid<'py>>> {
        let model = &self.ground(py, "parts")?.model;
        let driven = model.driven_index(name).map(|d| &model.driven[d]).ok_or_else(|| {
            let text = format!("body: expected one of {:?}, found {name:?}", self.about.names);
            pyo3::exceptions::PyKeyError::new_err(text)
        })?;
        Ok(parts(py, model, driven))
    }

    /// The next window's first step fails as if by a fault of the program.
    fn _fail_next(&self, py: Python<'_>) -> PyResult<()> {
        self.with_here(py, "_fail_next", |here| {
            here.panics = true;
            Ok(())
        })
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let now = match self.now_ns(py) {
            Ok(t) => format!("{t} ns"),
            Err(_) if self.is_closed() => "closed".into(),
            Err(_) => "in use by another thread".into(),
        };
        format!("Simulation({:?}, {} grains, {now})", self.about.name, self.about.grains)
    }
}
