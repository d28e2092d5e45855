//! The stepping component: windows of time, inputs as waveforms, redo, save and restore.
//!
//! Reads: a model, a state, inputs of each window. Writes: the state, a [`WindowResult`] per window.
//! Contract: a window is a function. Same state, same inputs: same outcome, bit for bit; how a stretch
//! of time is cut into windows changes nothing. A refused window leaves the state as it was.
//!
//! Every face of the program (library, network, recordings, Python) is to drive this one thing.

mod load;
mod memory;
mod parameters;
mod refusal;
mod result;
mod state_pool;
mod waveform;
mod window;

pub use load::{LoadKnot, LoadWaveform};
pub use memory::{ReactionHistory, is_remembered, left_twist, remembered};
pub use parameters::Parameters;
pub use refusal::Refusal;
pub use result::{
    BodyResult, SolverResult, WindowEnd, WindowResult, WindowStatus, ZoneResult, measure,
};
pub use waveform::{Interpolation, Knot, MAX_KNOT_ROTATION, Twist, Waveform};
pub use window::{LoadInput, MotionInput, WindowInputsRef};

pub use crate::cancel::StopReason;
use crate::contact_recheck::penetration_beyond;
use crate::drive::{SpeedLimit, StepInputs};
use crate::error::{Cause, Error};
use crate::model::Model;
use crate::observe::{SqueezeRule, Zone};
use crate::state::State;
pub use crate::step::{StepCallback, StepObserver};
use crate::step::{StepReport, advance};
use crate::workspace::Workspace;
use memory::WindowMemory;
use result::ResultAccumulator;
use state_pool::StatePool;
use std::ops::ControlFlow;
use std::sync::Arc;
use window::WindowPlan;

/// What a component accepts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// How far apart two windows may be where they join: m, rad, m/s, rad/s.
    pub join_distance: f64,
    pub join_angle: f64,
    pub join_speed: f64,
    pub join_angular_velocity: f64,
    /// How deep a sound step may press bodies into each other, m, beyond what it finds; infinite: any.
    pub penetration: f64,
    /// Whether what was computed is kept when a window cannot be computed to its end; else it is taken back.
    pub keep_partial_window: bool,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            join_distance: 1e-6,
            join_angle: 1e-6,
            join_speed: 1e-3,
            join_angular_velocity: 1e-3,
            penetration: f64::INFINITY,
            keep_partial_window: false,
        }
    }
}

/// A model that is stepped in windows.
#[derive(Debug)]
pub struct Component {
    model: Arc<Model>,
    limits: Limits,
    zones: Arc<[Zone]>,
    squeezes: Arc<SqueezeRule>,
    /// Steps go on in another one: whoever was given a state keeps what it was, and nobody pays for a copy.
    state: Arc<State>,
    /// The beginning of the last window, and its end, ns.
    last: Option<(Arc<State>, u64)>,
    state_pool: StatePool,
    workspace: Workspace,
    speed_limit: SpeedLimit,
}

impl Component {
    /// A component at `state`.
    ///
    /// # Errors
    /// A model or a state that cannot be stepped.
    pub fn new(
        model: Arc<Model>,
        state: impl Into<Arc<State>>,
        limits: Limits,
    ) -> Result<Self, Refusal> {
        let state = state.into();
        model.check()?;
        state.check(&model)?;
        let speed_limit = SpeedLimit::new(&model);
        Ok(Self {
            model,
            limits,
            zones: Arc::new([]),
            squeezes: Arc::default(),
            state,
            last: None,
            state_pool: StatePool::default(),
            workspace: Workspace::default(),
            speed_limit,
        })
    }

    /// The same, measuring `zones` at the end of each window.
    pub fn with_zones(mut self, zones: Vec<Zone>) -> Self {
        self.zones = zones.into();
        self
    }

    /// The same, following the squeezes of the pairs of `rule`. What is known of them is part of the state.
    pub fn with_squeezes(mut self, rule: SqueezeRule) -> Self {
        self.squeezes = Arc::new(rule);
        self
    }

    pub fn model(&self) -> &Model {
        &self.model
    }

    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The model, shared: it stays what it is when parameters change.
    pub fn shared_model(&self) -> Arc<Model> {
        Arc::clone(&self.model)
    }

    pub fn state(&self) -> &State {
        &self.state
    }

    /// Contacts of the last step that was computed, with gaps and normals; the state may be another since.
    pub fn workspace(&self) -> &Workspace {
        &self.workspace
    }

    /// With which twist the next cubic motion of driven body `d`, or of its mount, has to begin: see [`left_twist`].
    pub fn twist(&self, d: usize) -> Option<Twist> {
        left_twist(&self.state, d)
    }

    /// Simulated time, ns.
    pub fn now_ns(&self) -> u64 {
        self.state.time_ns
    }

    /// Beginning and end of the last window as they were asked for, ns: what [`Component::redo`] computes again.
    pub fn last_window(&self) -> Option<[u64; 2]> {
        self.last.as_ref().map(|(before, t1)| [before.time_ns, *t1])
    }

    /// Advances to `t1_ns`.
    ///
    /// # Errors
    /// What is wrong with the request; the state is as before. What goes wrong while computing is told
    /// by the outcome's status.
    pub fn advance_to<'a>(
        &mut self,
        t1_ns: u64,
        inputs: impl Into<WindowInputsRef<'a>>,
    ) -> Result<WindowResult, Refusal> {
        self.advance_observed(t1_ns, inputs, &mut ())
    }

    /// The same under the eyes of `watch`, which may end the window.
    ///
    /// # Errors
    /// As for [`Component::advance_to`]; [`Refusal::Cancelled`].
    pub fn advance_observed<'a>(
        &mut self,
        t1_ns: u64,
        inputs: impl Into<WindowInputsRef<'a>>,
        observer: &mut impl StepObserver,
    ) -> Result<WindowResult, Refusal> {
        let (model, limits) = (Arc::clone(&self.model), self.limits);
        let (steps, mut memory, plan) = self.planned(t1_ns, &inputs.into())?;
        let before = Arc::clone(&self.state);
        let mut account = ResultAccumulator::new(&model, before.time_ns);
        let mut failure = None;
        let mut stopped = None;
        for _ in 0..steps {
            match self.one_step(&plan, observer) {
                Ok(report) => {
                    account.take(&report, &self.state, model.stepping.h());
                    memory.recent.take(&report.reactions, model.stepping.step_ns);
                    memory.squeezes.take(&model, &self.state, &report);
                    if let ControlFlow::Break(stop) = observer.step_finished(&self.state, &report) {
                        // What is complete is not early.
                        let is_over = self.now_ns() == t1_ns && stop == StopReason::Early;
                        stopped = (!is_over).then_some(stop);
                        break;
                    }
                }
                Err(Error::Stopped(stop)) => {
                    stopped = Some(stop);
                    break;
                }
                Err(error) => {
                    failure = Some(error);
                    stopped = Some(if limits.keep_partial_window {
                        StopReason::Early
                    } else {
                        StopReason::Discard
                    });
                    break;
                }
            }
        }
        let status = match stopped {
            Some(StopReason::Cancel) => {
                self.state = before;
                return Err(Refusal::Cancelled);
            }
            Some(StopReason::Discard) => WindowStatus::Discard,
            Some(StopReason::Early) if account.steps() == 0 => WindowStatus::Discard,
            Some(StopReason::Early) => WindowStatus::Early,
            None if account.is_sound() => WindowStatus::Ok,
            None => WindowStatus::Warn,
        };
        if status == WindowStatus::Discard {
            self.state = Arc::clone(&before);
            account = ResultAccumulator::new(&model, self.now_ns());
            memory = WindowMemory::read(&self.state, model.driven.len(), &self.squeezes);
        } else {
            memory.twist = plan.twists(self.now_ns());
            memory.write(&mut Arc::make_mut(&mut self.state).drive);
        }
        if let Some((old, _)) = self.last.replace((before, t1_ns)) {
            self.state_pool.keep(old);
        }
        let end = WindowEnd {
            model: &model,
            state: &self.state,
            // What was taken back is nothing to measure.
            zones: if status == WindowStatus::Discard { &[] } else { &self.zones },
            recent: &memory.recent,
            squeezes: memory.squeezes.tell(),
            speed_limit: &self.speed_limit,
        };
        Ok(account.close(status, failure, end))
    }

    /// Whether a window up to `t1_ns` would be begun; nothing is computed, and nothing changes.
    ///
    /// # Errors
    /// As for [`Component::advance_to`], and a body that is led too far in the first step.
    pub fn check<'a>(
        &self,
        t1_ns: u64,
        inputs: impl Into<WindowInputsRef<'a>>,
    ) -> Result<(), Refusal> {
        let (_, _, plan) = self.planned(t1_ns, &inputs.into())?;
        let (model, state) = (&self.model, &self.state);
        Ok(self.speed_limit.check(model, state, &plan.targets(model, state))?)
    }

    /// The steps of a window, what is remembered at its beginning, and its inputs, checked.
    fn planned<'a>(
        &self,
        t1_ns: u64,
        window: &WindowInputsRef<'a>,
    ) -> Result<(u64, WindowMemory, WindowPlan<'a>), Refusal> {
        let (steps, model) = (self.steps_to(t1_ns)?, &self.model);
        let memory = WindowMemory::read(&self.state, model.driven.len(), &self.squeezes);
        let plan = WindowPlan::check(model, &self.state, &memory, &self.limits, t1_ns, window)?;
        Ok((steps, memory, plan))
    }

    /// Computes the last window again from its beginning, with other inputs; also one that was discarded.
    ///
    /// # Errors
    /// There is no window to redo, or as for [`Component::advance_to`]; the state is as before.
    pub fn redo<'a>(
        &mut self,
        inputs: impl Into<WindowInputsRef<'a>>,
    ) -> Result<WindowResult, Refusal> {
        self.redo_observed(inputs, &mut ())
    }

    /// The same; `watch` as in [`Component::advance_observed`].
    ///
    /// # Errors
    /// As for [`Component::redo`]; [`Refusal::Cancelled`].
    pub fn redo_observed<'a>(
        &mut self,
        inputs: impl Into<WindowInputsRef<'a>>,
        observer: &mut impl StepObserver,
    ) -> Result<WindowResult, Refusal> {
        let (before, t1) = self.last.clone().ok_or(Refusal::NothingToRedo)?;
        let after = std::mem::replace(&mut self.state, before);
        let result = self.advance_observed(t1, inputs, observer);
        match &result {
            Ok(_) => self.state_pool.keep(after),
            Err(_) => self.state = after,
        }
        result
    }

    /// Everything that the next window depends on: what [`Component::restore`] needs to go on from here.
    /// It is shared, not copied; the component goes on in another.
    pub fn save(&self) -> Arc<State> {
        Arc::clone(&self.state)
    }

    /// Goes back, or on, to a state of the same model.
    ///
    /// # Errors
    /// A state that does not fit the model; the component is as before.
    pub fn restore(&mut self, state: impl Into<Arc<State>>) -> Result<(), Refusal> {
        let state = state.into();
        state.check(&self.model)?;
        self.state = state;
        self.last = None;
        Ok(())
    }

    /// The same after a panic: buffers that it may have left half written are left behind.
    ///
    /// # Errors
    /// As for [`Component::restore`].
    pub fn recover(&mut self, state: impl Into<Arc<State>>) -> Result<(), Refusal> {
        *self = self.fork();
        self.restore(state)
    }

    /// Another component that goes on from here on its own.
    pub fn fork(&self) -> Self {
        Self {
            model: Arc::clone(&self.model),
            limits: self.limits,
            zones: Arc::clone(&self.zones),
            squeezes: Arc::clone(&self.squeezes),
            state: Arc::clone(&self.state),
            last: self.last.clone(),
            state_pool: StatePool::default(),
            workspace: Workspace::default(),
            speed_limit: self.speed_limit.clone(),
        }
    }

    /// Number of steps to a time on the grid.
    fn steps_to(&self, t1_ns: u64) -> Result<u64, Refusal> {
        let (now, step) = (self.now_ns(), self.model.stepping.step_ns);
        let ahead = t1_ns.saturating_sub(now);
        if ahead > 0 && ahead % step == 0 {
            return Ok(ahead / step);
        }
        let below = now.saturating_add((ahead / step).max(1) * step);
        Err(Refusal::Time {
            now_ns: now,
            step_ns: step,
            // There is none after the last one.
            nearest_ns: [below, below.checked_add(step).unwrap_or(below)],
            found_ns: t1_ns,
        })
    }

    /// Refuses a step that presses bodies into each other deeper than allowed. What it has found so deep is no fault of
    /// it: no window could be computed any more.
    fn expect_shallow(&self) -> Result<(), Error> {
        let limit = self.limits.penetration;
        if limit.is_infinite() {
            return Ok(());
        }
        let pressed = penetration_beyond(limit, &self.model, &self.workspace);
        if pressed == 0.0 {
            return Ok(());
        }
        Err(Error::Step {
            cause: Cause::Penetration,
            time_s: self.state.time(),
            place: "penetration".into(),
            expected: format!("at most {limit:.3e} m"),
            found: format!("{pressed:.3e} m"),
        })
    }

    /// One step along the waveforms.
    fn one_step(
        &mut self,
        plan: &WindowPlan,
        observer: &mut impl StepObserver,
    ) -> Result<StepReport, Error> {
        let targets = plan.targets(&self.model, &self.state);
        let loads = plan.loads(&self.model, &self.state);
        let speed_limit = Some(&self.speed_limit);
        let inputs = StepInputs { targets: &targets, loads: &loads, speed_limit };
        let mut next = self.state_pool.take();
        let report =
            advance(&self.model, &self.state, &mut next, &inputs, &mut self.workspace, observer)?;
        self.expect_shallow()?;
        self.state_pool.keep(std::mem::replace(&mut self.state, Arc::new(next)));
        Ok(report)
    }
}
