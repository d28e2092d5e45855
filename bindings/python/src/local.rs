//! Local backend: computes windows in this process, with redo, saved states and recording.

use crate::backend::{Backend, LastResult, WindowSpec};
use crate::calls::CallState;
use crate::errors;
use crate::lock::lock;
use crate::probe;
use crate::result::PyWindowResult;
use crate::state::{LocalState, PyState, StateStorage};
use crate::threads::{TaskControl, ThreadPoolHandle, run_controlled};
use ballast::component::{
    self, Component, DrivenWindow, Limits, Parameters, Refusal, StopReason, TampingDriver,
    WindowInputs, WindowInputsRef, WindowResult, WindowStatus, ZoneResult,
};
use ballast::model::{Model, Solver};
use ballast::state;
use ballast::step::{StepObserver, StepReport};
use ballast::track::plan::TampingPlan;
use ballast::track::{self, TampingCycle};
use ballast_beds::Case;
use ballast_mcap::Drive;
use ballast_protocol::lockstep::ParameterUpdate;
use ballast_protocol::messages::StepSeries;
use ballast_session::run_recorder::RunRecorder;
use pyo3::prelude::*;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Data of a local simulation that stepping does not change.
#[derive(Clone)]
pub struct SharedContext {
    pub case: Arc<Case>,
    pub model: Arc<Model>,
    /// Names of the driven bodies `[nd]`.
    pub names: Arc<[String]>,
    pub threads: ThreadPoolHandle,
}

/// A component of this process with its recording and the case's tamping cycle.
pub struct LocalBackend {
    context: SharedContext,
    component: Component,
    recorder: Option<RunRecorder>,
    /// Reason why the recording ended early, until `stop_recording` reports it.
    recording_error: Option<String>,
    /// Tamping cycle of the case; its state is part of the component's.
    driver: TampingDriver,
    /// Message of the panic that made the simulation unusable.
    failure: Option<String>,
    calls: Arc<CallState>,
    last_result: LastResult,
    /// Makes the next step panic, for tests.
    pub panics: bool,
}

/// Result of a window, with its inputs if the tamping cycle gave them.
type ComputedWindow = (Option<WindowInputs>, WindowResult);

/// Data collected while a window is computed.
struct WindowData {
    series: Option<StepSeries>,
    wall_time: Duration,
}

impl LocalBackend {
    /// Returns a backend that continues from `start`.
    pub fn new(
        py: Python<'_>,
        start: &LocalState,
        limits: Limits,
        threads: ThreadPoolHandle,
    ) -> PyResult<Self> {
        let LocalState { model, state, case, .. } = start;
        let component = case
            .component(Arc::clone(model), Arc::clone(state), limits)
            .map_err(|e| errors::refusal(py, e))?;
        let context = SharedContext {
            case: Arc::clone(case),
            model: Arc::clone(model),
            names: model.driven.iter().map(|d| d.name.clone()).collect(),
            threads,
        };
        let cycle = TampingCycle::new(&case.plan, model).map_err(|e| errors::case(py, e))?;
        Ok(Self::with_component(context, component, TampingDriver::new(cycle)))
    }

    fn with_component(context: SharedContext, component: Component, driver: TampingDriver) -> Self {
        Self {
            context,
            component,
            recorder: None,
            recording_error: None,
            driver,
            failure: None,
            calls: Arc::default(),
            last_result: LastResult::default(),
            panics: false,
        }
    }

    pub fn calls(&self) -> &Arc<CallState> {
        &self.calls
    }

    pub fn last_result(&self) -> &LastResult {
        &self.last_result
    }

    pub fn context(&self) -> &SharedContext {
        &self.context
    }

    pub fn component(&self) -> &Component {
        &self.component
    }

    pub fn cycle(&self) -> &TampingCycle {
        self.driver.cycle()
    }

    fn check_usable(&self, py: Python<'_>) -> PyResult<()> {
        match &self.failure {
            None => Ok(()),
            Some(why) => {
                let text = format!("{why}; restore a saved state, or open the case again");
                Err(errors::internal(py, text))
            }
        }
    }

    /// Measures the case's zones.
    pub fn zones(&self, py: Python<'_>) -> PyResult<Vec<ZoneResult>> {
        let SharedContext { case, model, threads, .. } = &self.context;
        let zones = track::zones(&case.plan);
        let state = self.component.state();
        threads.run(py, || component::measure_zones(model, state, &zones))
    }

    /// Returns the request of one step of the case's tamping cycle.
    pub fn tamping_cycle_step(&self, record_steps: bool, zones: bool) -> WindowSpec {
        let model = &self.context.model;
        WindowSpec {
            motions: Vec::new(),
            loads: Vec::new(),
            t1_ns: Some(self.component.now_ns() + model.stepping.step_ns),
            by_tamping_cycle: true,
            record_steps,
            zones,
        }
    }

    /// Computes a window; returns its outcome, with the inputs of the tamping cycle, and the exception that was raised
    /// meanwhile.
    fn compute(
        &mut self,
        py: Python<'_>,
        spec: &WindowSpec,
        data: &mut WindowData,
    ) -> PyResult<(Result<ComputedWindow, Refusal>, Option<PyErr>)> {
        let threads = &self.context.threads;
        let panics = std::mem::take(&mut self.panics);
        let component = &mut self.component;
        let driver = &mut self.driver;
        let control = TaskControl::new(self.calls.cancel.clone());
        run_controlled(py, threads, &control, |control| {
            let mut observer = WindowObserver { data, panics, control };
            let begin = Instant::now();
            let result = match spec.t1_ns {
                Some(t1) if spec.by_tamping_cycle => component
                    .advance_driven(t1, driver, &mut observer)
                    .map(|window| window.expect("the cycle has inputs for every step"))
                    .map(|DrivenWindow { inputs, result }| (Some(inputs), result)),
                Some(t1) => {
                    let result = component.advance_observed(t1, spec.window(), &mut observer);
                    result.map(|result| (None, result))
                }
                None => {
                    let result = component.redo_observed(spec.window(), &mut observer);
                    result.map(|result| (None, result))
                }
            };
            observer.data.wall_time = begin.elapsed();
            result
        })
    }

    /// Records a window, if a recording is open. A file that cannot be written ends the recording, not the simulation.
    fn record_window(
        &mut self,
        py: Python<'_>,
        spec: &WindowSpec,
        driven: Option<&WindowInputs>,
        outcome: &WindowResult,
    ) -> PyResult<()> {
        let Some(recorder) = &mut self.recorder else { return Ok(()) };
        let component = &self.component;
        let inputs = driven.map_or_else(|| spec.window(), WindowInputsRef::from);
        let record = || recorder.window(component, spec.kind(), inputs, outcome);
        py.detach(record).or_else(|why| {
            self.recorder = None;
            self.recording_error = Some(why.to_string());
            errors::warn(py, format!("{why}; the simulation continues without recording"))
        })
    }

    /// Returns to the state `before` a window that panicked; only `restore` makes the simulation usable again.
    fn fail(&mut self, py: Python<'_>, why: &PyErr, before: &Arc<state::State>) {
        self.failure = Some(why.value(py).to_string());
        if self.recorder.take().is_some() {
            let ns = before.time_ns;
            self.recording_error =
                Some(format!("recording: ended at {ns} ns by an internal error of the simulation"));
        }
        *lock(&self.last_result) = None;
        // It cannot fail: this was the component's state before the window.
        let _ = self.component.recover(Arc::clone(before));
    }

    /// Runs a probe of a sleeper (the first without a name) on model and state, which stay as they are.
    pub fn probe<T: Send>(
        &self,
        py: Python<'_>,
        sleeper: Option<&str>,
        run: impl FnOnce(&Model, &state::State, usize, &mut ProbeObserver<'_, '_>) -> Result<T, Refusal>
        + Send,
    ) -> PyResult<T> {
        self.check_usable(py)?;
        self.context.threads.check_available(py)?;
        let control = TaskControl::new(self.calls.cancel.clone());
        let (model, state) = (self.component.model(), self.component.state());
        let body = probe::find_sleeper(py, model, sleeper)?;
        let (probed, raised) = run_controlled(py, &self.context.threads, &control, |control| {
            run(model, state, body, &mut ProbeObserver(control))
        })?;
        match (probed, raised) {
            (Ok(probed), None) => Ok(probed),
            (_, Some(raised)) => Err(raised),
            (Err(refusal), None) => Err(errors::refusal(py, refusal)),
        }
    }

    pub fn fork(&self, py: Python<'_>) -> PyResult<Self> {
        self.check_usable(py)?;
        let component = self.component.fork();
        let fork = Self::with_component(self.context.clone(), component, self.driver.clone());
        // The fork can redo the last window, too.
        *lock(&fork.last_result) =
            lock(&self.last_result).as_ref().map(|result| result.clone_ref(py));
        Ok(fork)
    }

    pub fn record(&mut self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.check_usable(py)?;
        if self.recorder.is_some() || self.recording_error.is_some() {
            let expected = "no open recording; stop_recording first";
            return Err(errors::request(py, "recording", "record", expected, "one"));
        }
        let case = &self.context.case;
        let component = &self.component;
        let recorder = py.detach(|| RunRecorder::create(&path, case, component, Drive::Inputs));
        self.recorder = Some(recorder.map_err(|e| errors::file(py, e))?);
        Ok(())
    }

    /// Checks that a state belongs to this case and its machine.
    fn check_state(&self, py: Python<'_>, saved: &LocalState) -> PyResult<()> {
        let invalid = |expected: &str, found: &str| {
            Err(errors::request(py, "state_invalid", "state", expected, found))
        };
        let model = self.component.shared_model();
        let is_same_model = Arc::ptr_eq(&model, &saved.model) || *model == *saved.model;
        if !is_same_model && !Parameters::are_only_difference(&model, &saved.model) {
            return invalid("a state of this case and seed", "one of another model");
        }
        // Durations of runs and output settings may differ, except for the duration of the withdrawal.
        let own = &self.context.case.plan;
        let other = &saved.case.plan;
        let own_machine = (&own.tines, &own.sleepers, &own.tamping);
        if own_machine == (&other.tines, &other.sleepers, &other.tamping) {
            return Ok(());
        }
        let tamping = own
            .tamping
            .zip(other.tamping)
            .map(|(own, other)| TampingPlan { withdrawal: own.withdrawal, ..other });
        let found = if own_machine == (&other.tines, &other.sleepers, &tamping) {
            "one with another withdrawal (`tamping.withdrawal_s`; by default the rest of the run)"
        } else {
            "one of another machine on the same bed"
        };
        invalid("a state of this case", found)
    }
}

impl Backend for LocalBackend {
    fn window(&mut self, py: Python<'_>, spec: &WindowSpec) -> PyResult<Py<PyWindowResult>> {
        self.check_usable(py)?;
        self.context.threads.check_available(py)?;
        if let Some(recorder) = &self.recorder {
            check_process(py, recorder, "window")?;
            if spec.t1_ns.is_none() {
                check_redo(py, recorder, &self.component)?;
            }
        }
        let before = self.component.save();
        let mut data = WindowData {
            series: spec.record_steps.then(|| StepSeries::new(&self.context.model)),
            wall_time: Duration::ZERO,
        };
        let computed = self.compute(py, spec, &mut data);
        let (result, raised) = computed.inspect_err(|error| self.fail(py, error, &before))?;
        let (driven, mut outcome) = match (result, raised.as_ref()) {
            (Ok(outcome), _) => outcome,
            (Err(_), Some(raised)) => return Err(raised.clone_ref(py)),
            (Err(e), None) => return Err(errors::refusal(py, e)),
        };
        let is_discarded = outcome.status == WindowStatus::Discard;
        if spec.zones && !is_discarded {
            outcome.zones = self.zones(py)?;
        }
        let recorded = self.record_window(py, spec, driven.as_ref(), &outcome);
        // A window without steps, such as one that was rolled back, has an empty series.
        let series = data.series.filter(|_| outcome.steps > 0).unwrap_or_default();
        let mut reply = PyWindowResult::reply(&self.context.model, &outcome, series);
        if outcome.error.is_none() && (is_discarded || outcome.status == WindowStatus::Early) {
            reply.code = "stopped".into();
            reply.message = stop_message(py, raised.as_ref());
        }
        let names = Arc::clone(&self.context.names);
        let wall_time_s = data.wall_time.as_secs_f64();
        let result = PyWindowResult::new(py, reply, names, wall_time_s, spec.record_steps)?;
        let result = Py::new(py, result)?;
        *lock(&self.last_result) = Some(result.clone_ref(py));
        if let Some(raised) = raised {
            return Err(raised);
        }
        // An exception if warnings are errors.
        recorded?;
        Ok(result)
    }

    fn save(&mut self, _py: Python<'_>) -> PyResult<PyState> {
        Ok(PyState(StateStorage::Local(LocalState {
            model: self.component.shared_model(),
            state: self.component.save(),
            case: Arc::clone(&self.context.case),
            max_penetration: Some(self.component.limits().penetration),
        })))
    }

    fn restore(&mut self, py: Python<'_>, state: &PyState) -> PyResult<()> {
        let saved = match &state.0 {
            StateStorage::Local(saved) => saved,
            StateStorage::Remote(remote) => {
                let found = format!("one of the remote component {}", remote.component);
                let expected = "a state of this process";
                return Err(errors::request(py, "state_invalid", "state", expected, found));
            }
        };
        if self.recorder.is_some() {
            let expected = "no open recording, whose time cannot jump; stop_recording first";
            return Err(errors::request(py, "recording", "restore", expected, "one"));
        }
        self.check_state(py, saved)?;
        let Solver { max_iterations: iterations, tolerance, .. } = saved.model.solver;
        let penetration = saved.max_penetration.unwrap_or(self.component.limits().penetration);
        let parameters = Parameters { iterations, tolerance, penetration };
        self.component
            .restore(Arc::clone(&saved.state))
            .and_then(|()| self.component.set_parameters(&parameters))
            .map_err(|e| errors::refusal(py, e))?;
        self.failure = None;
        *lock(&self.last_result) = None;
        Ok(())
    }

    fn set_parameters(&mut self, py: Python<'_>, parameters: &ParameterUpdate) -> PyResult<()> {
        self.check_usable(py)?;
        parameters.apply(&mut self.component).map(drop).map_err(|fault| errors::fault(py, &fault))
    }

    fn now_ns(&self) -> u64 {
        self.component.now_ns()
    }

    fn has_failed(&self) -> bool {
        self.failure.is_some()
    }

    fn stop_recording(&mut self, py: Python<'_>) -> PyResult<()> {
        if let Some(why) = self.recording_error.take() {
            return Err(errors::file(py, why));
        }
        let Some(recorder) = self.recorder.take() else { return Ok(()) };
        check_process(py, &recorder, "stop_recording")?;
        py.detach(|| recorder.finish()).map(drop).map_err(|e| errors::file(py, e))
    }

    fn close(mut self: Box<Self>, py: Python<'_>) -> PyResult<()> {
        self.stop_recording(py)
    }
}

/// Checks that this process started the recording.
fn check_process(py: Python<'_>, recorder: &RunRecorder, place: &str) -> PyResult<()> {
    if recorder.is_of_this_process() {
        return Ok(());
    }
    let expected = "the process that started the recording; open the case or a saved state again";
    Err(errors::request(py, "recording", place, expected, "a fork of it"))
}

/// Checks that the recording contains the window that a redo replaces.
fn check_redo(py: Python<'_>, recorder: &RunRecorder, component: &Component) -> PyResult<()> {
    let start = recorder.begin_ns();
    match component.last_window() {
        Some([t0, _]) if t0 < start => {
            let expected = format!("a window of the recording, which starts at {start} ns");
            Err(errors::request(py, "recording", "redo", expected, format!("one from {t0} ns")))
        }
        _ => Ok(()),
    }
}

/// Observes the steps of a window and cancels it.
struct WindowObserver<'a, 't> {
    data: &'a mut WindowData,
    panics: bool,
    control: &'a TaskControl<'t>,
}

impl StepObserver for WindowObserver<'_, '_> {
    fn cancelled(&mut self) -> Option<StopReason> {
        self.control.is_cancelled_within_step().then_some(StopReason::Early)
    }

    fn step_finished(
        &mut self,
        state: &state::State,
        report: &StepReport,
    ) -> ControlFlow<StopReason> {
        assert!(!self.panics, "panic requested by a test");
        if let Some(series) = &mut self.data.series {
            series.push(state, report);
        }
        if self.control.is_cancelled() {
            return ControlFlow::Break(StopReason::Early);
        }
        ControlFlow::Continue(())
    }
}

/// Cancels a probe on request.
pub struct ProbeObserver<'a, 't>(&'a TaskControl<'t>);

impl StepObserver for ProbeObserver<'_, '_> {
    fn cancelled(&mut self) -> Option<StopReason> {
        self.0.is_cancelled_within_step().then_some(StopReason::Cancel)
    }
}

/// Returns the message of a window that was stopped by the user.
fn stop_message(py: Python<'_>, raised: Option<&PyErr>) -> String {
    let name = raised.and_then(|e| e.get_type(py).name().ok());
    let cause = name.map_or("`stop` or `close`".into(), |name| name.to_string());
    format!("window stopped by {cause}")
}
