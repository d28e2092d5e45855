//! The simulation in this process: windows, redo, states, recording.

use crate::compute::{Crew, Turn, attend};
use crate::errors::{self, Lost};
use crate::lock::enter;
use crate::machine::Machine;
use crate::outcome::{Outcome, Series, Trouble};
use crate::recorder::Recorder;
use crate::simulation::{Asked, LastOutcome};
use crate::state::Snapshot;
use crate::work::Work;
use ballast::component::{
    self, Component, Limits, Parameters, Refusal, StopReason, WindowStatus, ZoneResult,
};
use ballast::model::{Model, Solver};
use ballast::state;
use ballast::step::{StepObserver, StepReport};
use ballast::track;
use ballast::track::plan::TampingPlan;
use ballast_beds::Case;
use ballast_protocol::lockstep::SetParameters;
use ballast_protocol::messages::StepSeries;
use pyo3::prelude::*;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What does not change while a simulation of this process is stepped.
#[derive(Clone)]
pub struct Ground {
    pub case: Arc<Case>,
    pub model: Arc<Model>,
    pub names: Arc<[String]>,
    pub crew: Crew,
}

/// A component of this process, and what belongs to it.
pub struct Here {
    ground: Ground,
    component: Component,
    recorder: Option<Recorder>,
    /// Why the recording could not be written any more, until it is ended.
    unwritten: Option<String>,
    machine: Machine,
    /// As it was before the last window.
    machine_before: Option<Machine>,
    /// What the program failed with inside.
    lost: Option<String>,
    work: Arc<Work>,
    told: LastOutcome,
    /// The next step panics: so that tests can see what becomes of it.
    pub panics: bool,
}

/// What is taken from a window while it is computed.
struct Watched {
    machine: Machine,
    series: Option<StepSeries>,
    took: Duration,
}

impl Here {
    /// Goes on from `start`.
    pub fn new(py: Python<'_>, start: &Snapshot, limits: Limits, crew: Crew) -> PyResult<Self> {
        let Snapshot { model, state, case, machine, .. } = start;
        let component = case
            .component(Arc::clone(model), Arc::clone(state), limits)
            .map_err(|e| errors::refusal(py, e))?;
        let names = model.driven.iter().map(|d| d.name.clone()).collect();
        let (case, model) = (Arc::clone(case), Arc::clone(model));
        let ground = Ground { case, model, names, crew };
        Ok(Self::of(ground, component, machine.clone()))
    }

    fn of(ground: Ground, component: Component, machine: Machine) -> Self {
        let (recorder, unwritten, machine_before, lost) = (None, None, None, None);
        let (work, told, panics) = (Arc::default(), LastOutcome::default(), false);
        Self {
            ground,
            component,
            recorder,
            unwritten,
            machine,
            machine_before,
            lost,
            work,
            told,
            panics,
        }
    }

    pub fn work(&self) -> &Arc<Work> {
        &self.work
    }

    pub fn told(&self) -> &LastOutcome {
        &self.told
    }

    pub fn ground(&self) -> &Ground {
        &self.ground
    }

    pub fn component(&self) -> &Component {
        &self.component
    }

    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    pub fn is_lost(&self) -> bool {
        self.lost.is_some()
    }

    fn check_sound(&self, py: Python<'_>) -> PyResult<()> {
        match &self.lost {
            None => Ok(()),
            Some(why) => {
                let text = format!("{why}; restore a saved state, or open the case again");
                Err(errors::error::<Lost>(py, "lost", text))
            }
        }
    }

    pub fn zones(&self, py: Python<'_>) -> PyResult<Vec<ZoneResult>> {
        let Ground { case, model, crew, .. } = &self.ground;
        let (state, zones) = (self.component.state(), track::zones(&case.plan));
        crew.run(py, || component::measure(model, state, &zones))
    }

    /// What the machine of the case asks of the next step.
    pub fn asked_by_machine(&self, series: bool, zones: bool) -> Asked {
        let (model, state) = (&self.ground.model, self.component.state());
        Asked {
            motions: self.machine.motions(model, state),
            loads: Vec::new(),
            t1_ns: Some(state.time_ns + model.stepping.step_ns),
            by_machine: true,
            series,
            zones,
        }
    }

    pub fn window(&mut self, py: Python<'_>, asked: &Asked) -> PyResult<Py<Outcome>> {
        self.check_sound(py)?;
        self.ground.crew.expect_free(py)?;
        if let Some(recorder) = &self.recorder {
            recorder.check_process(py, "window")?;
            if asked.t1_ns.is_none() {
                recorder.check_redo(py, &self.component)?;
            }
        }
        let before = self.component.save();
        let machine_before = match (&asked.t1_ns, &self.machine_before) {
            (None, Some(machine)) => machine.clone(),
            _ => self.machine.clone(),
        };
        let model = &self.ground.model;
        let series = asked.series.then(|| StepSeries::begin(model));
        let machine = machine_before.clone();
        let mut watched = Watched { machine, series, took: Duration::ZERO };
        let computed = self.compute(py, asked, &mut watched);
        let (result, raised) = computed.inspect_err(|lost| self.lose(py, lost, &before))?;
        let mut outcome = match (result, raised.as_ref()) {
            (Ok(outcome), _) => outcome,
            (Err(_), Some(raised)) => return Err(raised.clone_ref(py)),
            (Err(e), None) => return Err(errors::refusal(py, e)),
        };
        let is_discarded = outcome.status == WindowStatus::Discard;
        self.machine = if is_discarded { machine_before.clone() } else { watched.machine };
        self.machine_before = Some(machine_before);
        if asked.zones && !is_discarded {
            outcome.zones = self.zones(py)?;
        }
        let recorded = self.take_down(py, asked, &outcome);
        let names = Arc::clone(&self.ground.names);
        // Of what was taken back there is nothing to tell.
        let steps = watched
            .series
            .map(|steps| if outcome.steps > 0 { steps } else { StepSeries::default() });
        let series = steps.map(|steps| Py::new(py, Series::new(steps, &names))).transpose()?;
        let trouble = match &outcome.error {
            Some(e) => Some(Trouble { code: e.code().into(), text: e.to_string() }),
            // A window without trouble is taken back where it was stopped within its first step.
            None if is_discarded || outcome.status == WindowStatus::Early => {
                Some(stopped(py, raised.as_ref()))
            }
            None => None,
        };
        let wall_s = watched.took.as_secs_f64();
        let outcome = Outcome { inner: outcome, trouble, wall_s, names, series };
        let outcome = Py::new(py, outcome)?;
        *enter(&self.told) = Some(outcome.clone_ref(py));
        if let Some(raised) = raised {
            return Err(raised);
        }
        // Who makes errors of warnings has one.
        recorded?;
        Ok(outcome)
    }

    /// What came of the window, and what was raised meanwhile.
    fn compute(
        &mut self,
        py: Python<'_>,
        asked: &Asked,
        watched: &mut Watched,
    ) -> PyResult<(Result<component::WindowResult, Refusal>, Option<PyErr>)> {
        let Ground { model, crew, .. } = &self.ground;
        let panics = std::mem::take(&mut self.panics);
        let (component, turn) = (&mut self.component, Turn::until(Arc::clone(&self.work.is_over)));
        attend(py, crew, &turn, |turn| {
            let mut at_work = AtWork { watched, model, by_machine: asked.by_machine, panics, turn };
            let begin = Instant::now();
            let result = match asked.t1_ns {
                Some(t1) => component.advance_observed(t1, asked.window(), &mut at_work),
                None => component.redo_observed(asked.window(), &mut at_work),
            };
            at_work.watched.took = begin.elapsed();
            result
        })
    }

    /// Records a window, where there is a recording.
    fn take_down(
        &mut self,
        py: Python<'_>,
        asked: &Asked,
        outcome: &component::WindowResult,
    ) -> PyResult<()> {
        let Some(recorder) = &mut self.recorder else { return Ok(()) };
        let component = &self.component;
        let record = || recorder.window(component, asked.kind(), &asked.window(), outcome);
        py.detach(record).or_else(|why| self.give_recording_up(py, &why))
    }

    /// A file that cannot be written any more is no reason to lose what was computed.
    fn give_recording_up(&mut self, py: Python<'_>, why: &ballast_mcap::Error) -> PyResult<()> {
        self.recorder = None;
        self.unwritten = Some(why.to_string());
        errors::warn(py, format!("{why}; the simulation goes on unrecorded"))
    }

    /// The program failed inside.
    fn lose(&mut self, py: Python<'_>, why: &PyErr, before: &Arc<state::State>) {
        self.lost = Some(why.value(py).to_string());
        if self.recorder.take().is_some() {
            let ns = before.time_ns;
            self.unwritten =
                Some(format!("recording: it ends at {ns} ns, where the program failed inside"));
        }
        *enter(&self.told) = None;
        // It was the state of this model a moment ago.
        let _ = self.component.recover(Arc::clone(before));
    }

    pub fn save(&self) -> Snapshot {
        Snapshot {
            model: self.component.shared_model(),
            state: self.component.save(),
            case: Arc::clone(&self.ground.case),
            machine: self.machine.clone(),
            penetration: Some(self.component.limits().penetration),
        }
    }

    pub fn restore(&mut self, py: Python<'_>, saved: &Snapshot) -> PyResult<()> {
        if self.recorder.is_some() {
            let expected = "no open recording, whose time cannot jump; stop_recording first";
            return Err(errors::refused(py, "recording", "restore", expected, "one"));
        }
        let model = self.component.shared_model();
        let is_its = Arc::ptr_eq(&model, &saved.model) || *model == *saved.model;
        if !is_its && !Parameters::are_only_difference(&model, &saved.model) {
            let expected = "one of this case and seed";
            return Err(errors::refused(
                py,
                "state_invalid",
                "state",
                expected,
                "one of another model",
            ));
        }
        let (own, its) = (&self.ground.case.plan, &saved.case.plan);
        // How long runs last, and what they write, is another matter, but for the time that the withdrawal is given.
        if (&own.tines, &own.sleepers, &own.tamping) != (&its.tines, &its.sleepers, &its.tamping) {
            let withdrawn = own
                .tamping
                .zip(its.tamping)
                .map(|(own, its)| TampingPlan { withdrawal: own.withdrawal, ..its });
            let alike = (&its.tines, &its.sleepers, &withdrawn);
            let found = if (&own.tines, &own.sleepers, &own.tamping) == alike {
                "one of another withdrawal (`tamping.withdrawal_s`; if it is not given, what the run leaves)"
            } else {
                "one of another machine on the same bed"
            };
            return Err(errors::refused(py, "state_invalid", "state", "one of this case", found));
        }
        let Solver { max_iterations: iterations, tolerance, .. } = saved.model.solver;
        let penetration = saved.penetration.unwrap_or(self.component.limits().penetration);
        let parameters = Parameters { iterations, tolerance, penetration };
        let restored = self.component.restore(Arc::clone(&saved.state));
        restored
            .and_then(|()| self.component.set_parameters(&parameters))
            .map_err(|e| errors::refusal(py, e))?;
        self.lost = None;
        *enter(&self.told) = None;
        (self.machine, self.machine_before) = (saved.machine.clone(), None);
        Ok(())
    }

    /// Sets parameters for all windows from now on, and for a redo of the last one.
    pub fn set_parameters(&mut self, py: Python<'_>, ask: &SetParameters) -> PyResult<()> {
        self.check_sound(py)?;
        ask.apply(&mut self.component).map(drop).map_err(|fault| errors::fault(py, &fault))
    }

    pub fn fork(&self, py: Python<'_>) -> PyResult<Self> {
        self.check_sound(py)?;
        let fork = Self::of(self.ground.clone(), self.component.fork(), self.machine.clone());
        // The last window can be redone in it, too.
        *enter(&fork.told) = enter(&self.told).as_ref().map(|outcome| outcome.clone_ref(py));
        Ok(Self { machine_before: self.machine_before.clone(), ..fork })
    }

    pub fn record(&mut self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        self.check_sound(py)?;
        if self.recorder.is_some() || self.unwritten.is_some() {
            let expected = "no open recording; stop_recording first";
            return Err(errors::refused(py, "recording", "record", expected, "one"));
        }
        let (case, component) = (&self.ground.case, &self.component);
        let recorder = py.detach(|| Recorder::create(path, case, component));
        self.recorder = Some(recorder.map_err(|e| errors::file(py, e))?);
        Ok(())
    }

    pub fn stop_recording(&mut self, py: Python<'_>) -> PyResult<()> {
        if let Some(why) = self.unwritten.take() {
            return Err(errors::file(py, why));
        }
        let Some(recorder) = self.recorder.take() else { return Ok(()) };
        recorder.check_process(py, "stop_recording")?;
        py.detach(|| recorder.finish()).map_err(|e| errors::file(py, e))
    }
}

/// Sees to what is taken from a window, and ends it when its turn is over, within a step if need be.
struct AtWork<'a, 't> {
    watched: &'a mut Watched,
    model: &'a Model,
    by_machine: bool,
    panics: bool,
    turn: &'a Turn<'t>,
}

impl StepObserver for AtWork<'_, '_> {
    fn cancelled(&mut self) -> Option<StopReason> {
        self.turn.is_over_within_step().then_some(StopReason::Early)
    }

    fn step_finished(
        &mut self,
        state: &state::State,
        report: &StepReport,
    ) -> ControlFlow<StopReason> {
        assert!(!self.panics, "a failure that was asked for");
        if let Some(series) = &mut self.watched.series {
            series.take(state, report);
        }
        if self.by_machine {
            self.watched.machine.observe(self.model, state, report);
        }
        if self.turn.is_over() {
            return ControlFlow::Break(StopReason::Early);
        }
        ControlFlow::Continue(())
    }
}

/// What has ended a window that nothing was wrong with.
fn stopped(py: Python<'_>, raised: Option<&PyErr>) -> Trouble {
    let name = raised.and_then(|e| e.get_type(py).name().ok());
    let by = name.map_or("`stop` or `close`".into(), |name| name.to_string());
    Trouble { code: "stopped".into(), text: format!("{by} has ended it") }
}
