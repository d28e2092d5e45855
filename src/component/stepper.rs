//! The component: steps of a window, redo, save, restore and fork.

use super::limits::Limits;
use super::refusal::Refusal;
use super::result::{ResultAccumulator, WindowEnd, WindowResult, WindowStatus};
use super::state_pool::StatePool;
use super::waveform::Twist;
use super::window::{WindowInputsRef, WindowPlan};
use crate::cancel::StopReason;
use crate::contact_recheck::penetration_beyond;
use crate::drive::{Load, SpeedLimit, StepInputs};
use crate::error::{Cause, Error};
use crate::math::Pose;
use crate::model::Model;
use crate::observe::{SqueezeMeter, SqueezeRule, Zone};
use crate::state::State;
use crate::step::{ForceCheck, StepObserver, StepReport, advance};
use crate::window_memory::WindowMemory;
use crate::workspace::Workspace;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Duration over which reactions are averaged, ns: within half a vibration a single force says little, a longer mean lags.
const MOVING_AVERAGE_NS: u64 = 4_000_000;

/// Model that is advanced in windows: the only thing that calls a step.
#[derive(Debug)]
pub struct Component {
    pub(super) model: Arc<Model>,
    pub(super) limits: Limits,
    zones: Arc<[Zone]>,
    squeezes: Arc<SqueezeRule>,
    /// Shared and never written to: a step writes into another state, so that saved states need no copy.
    pub(super) state: Arc<State>,
    /// The beginning of the last window, and its end, ns.
    last: Option<(Arc<State>, u64)>,
    state_pool: StatePool,
    workspace: Workspace,
    speed_limit: SpeedLimit,
}

impl Component {
    /// Builds a component at `state`.
    ///
    /// # Errors
    /// A model or a state that cannot be advanced.
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

    /// Returns the component with `zones`, which are measured at the end of each window.
    pub fn with_zones(mut self, zones: Vec<Zone>) -> Self {
        self.zones = zones.into();
        self
    }

    /// Returns the component with a squeeze rule, whose tine pairs are followed through their squeezes.
    pub fn with_squeezes(mut self, rule: SqueezeRule) -> Self {
        self.squeezes = Arc::new(rule);
        self
    }

    /// Returns the model with the present parameters.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Returns the limits of inputs.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Returns the model, shared: changed parameters make another model.
    pub fn shared_model(&self) -> Arc<Model> {
        Arc::clone(&self.model)
    }

    /// Returns the state at the end of the last window.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Returns the buffers of the last computed step, with contacts, gaps and normals; the state may have changed since.
    pub fn workspace(&self) -> &Workspace {
        &self.workspace
    }

    /// Returns the twist with which the next cubic motion of driven body `d` has to begin, see [`State::end_twist`].
    pub fn twist(&self, d: usize) -> Option<Twist> {
        self.state.end_twist(d)
    }

    /// Returns the simulated time, ns.
    pub fn now_ns(&self) -> u64 {
        self.state.time_ns
    }

    /// Returns the requested beginning and end of the last window, ns, which [`Component::redo`] computes again.
    pub fn last_window(&self) -> Option<[u64; 2]> {
        self.last.as_ref().map(|(before, t1)| [before.time_ns, *t1])
    }

    /// Advances to `t1_ns`.
    ///
    /// # Errors
    /// A refused request; the state is unchanged. A failed step is no error of the call, but the error of the result.
    pub fn advance_to<'a>(
        &mut self,
        t1_ns: u64,
        inputs: impl Into<WindowInputsRef<'a>>,
    ) -> Result<WindowResult, Refusal> {
        self.advance_observed(t1_ns, inputs, &mut ())
    }

    /// Advances to `t1_ns` with an observer that may end the window.
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
        let (steps, plan) = self.planned(t1_ns, &inputs.into())?;
        let before = Arc::clone(&self.state);
        let mut account = ResultAccumulator::new(&model, &before);
        let mut reactions = before.window.reactions.clone();
        let mut squeezes =
            SqueezeMeter::resume(Arc::clone(&self.squeezes), &before.window.squeezes);
        let averaged_steps = (MOVING_AVERAGE_NS / model.stepping.step_ns).max(1) as usize;
        let mut failure = None;
        let mut stopped = None;
        for _ in 0..steps {
            match self.one_step(&plan, observer) {
                Ok(report) => {
                    account.take(&report, &self.state, model.stepping.h());
                    let impulses = report.reactions.iter().map(|r| [r.impulse, r.angular_impulse]);
                    reactions.push(impulses, averaged_steps);
                    squeezes.record(&model, &self.state, &report);
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
            account = ResultAccumulator::new(&model, &before);
            squeezes = SqueezeMeter::resume(Arc::clone(&self.squeezes), &before.window.squeezes);
        }
        let squeeze_results = squeezes.take_outcomes();
        if status != WindowStatus::Discard {
            let twists = plan.twists(self.now_ns());
            let window = WindowMemory { twists, reactions, squeezes: squeezes.into_tracks() };
            Arc::make_mut(&mut self.state).window = Arc::new(window);
        }
        if let Some((old, _)) = self.last.replace((before, t1_ns)) {
            self.state_pool.keep(old);
        }
        let end = WindowEnd {
            model: &model,
            state: &self.state,
            // A discarded window has nothing to measure.
            zones: if status == WindowStatus::Discard { &[] } else { &self.zones },
            squeezes: squeeze_results,
            speed_limit: &self.speed_limit,
        };
        Ok(account.close(status, failure, end))
    }

    /// Checks that a window up to `t1_ns` would be accepted, without computing it.
    ///
    /// # Errors
    /// As for [`Component::advance_to`], and a body that is led too far in the first step.
    pub fn check<'a>(
        &self,
        t1_ns: u64,
        inputs: impl Into<WindowInputsRef<'a>>,
    ) -> Result<(), Refusal> {
        let (_, plan) = self.planned(t1_ns, &inputs.into())?;
        let (model, state) = (&self.model, &self.state);
        Ok(self.speed_limit.check(model, state, &plan.targets(model, state))?)
    }

    /// Returns the number of steps of a window and its checked inputs.
    fn planned<'a>(
        &self,
        t1_ns: u64,
        window: &WindowInputsRef<'a>,
    ) -> Result<(u64, WindowPlan<'a>), Refusal> {
        let (steps, model) = (self.steps_to(t1_ns)?, &self.model);
        let plan = WindowPlan::check(model, &self.state, &self.limits, t1_ns, window)?;
        Ok((steps, plan))
    }

    /// Computes the last window again from its beginning with other inputs, even if it was discarded.
    ///
    /// # Errors
    /// No window to redo, or as for [`Component::advance_to`]; the state is unchanged.
    pub fn redo<'a>(
        &mut self,
        inputs: impl Into<WindowInputsRef<'a>>,
    ) -> Result<WindowResult, Refusal> {
        self.redo_observed(inputs, &mut ())
    }

    /// Computes the last window again with an observer that may end it.
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

    /// Returns the state, which is everything that the next window depends on. It is shared, not copied.
    pub fn save(&self) -> Arc<State> {
        Arc::clone(&self.state)
    }

    /// Sets the state, which has to be one of the same model.
    ///
    /// # Errors
    /// A state that does not fit the model; the component is unchanged.
    pub fn restore(&mut self, state: impl Into<Arc<State>>) -> Result<(), Refusal> {
        let state = state.into();
        state.check(&self.model)?;
        self.state = state;
        self.last = None;
        Ok(())
    }

    /// Sets the state after a panic, and drops buffers that may be half written.
    ///
    /// # Errors
    /// As for [`Component::restore`].
    pub fn recover(&mut self, state: impl Into<Arc<State>>) -> Result<(), Refusal> {
        *self = self.fork();
        self.restore(state)
    }

    /// Returns an independent component at the same state.
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

    /// Returns the number of steps to a time on the grid of steps.
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

    /// Refuses a step that adds more penetration than allowed. Penetration that was there before is accepted, since no
    /// window could be computed otherwise.
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

    /// Computes one step along the waveforms.
    fn one_step(
        &mut self,
        plan: &WindowPlan,
        observer: &mut impl StepObserver,
    ) -> Result<StepReport, Error> {
        let targets = plan.targets(&self.model, &self.state);
        let loads = plan.loads(&self.model, &self.state);
        // Before the step, whose buffers observers read.
        let from_zero = self.solve_from_zero(&targets, &loads, observer)?;
        let speed_limit = Some(&self.speed_limit);
        let inputs =
            StepInputs { targets: &targets, loads: &loads, speed_limit, zero_start: false };
        let mut next = self.state_pool.take();
        let mut report =
            advance(&self.model, &self.state, &mut next, &inputs, &mut self.workspace, observer)?;
        self.expect_shallow()?;
        if let Some(from_zero) = from_zero {
            report.force_check =
                ForceCheck::new(&self.model, &report.reactions, &from_zero.reactions);
        }
        self.state_pool.keep(std::mem::replace(&mut self.state, Arc::new(next)));
        Ok(report)
    }

    /// Solves the step from zero impulses without effect on the state, if its forces are to be checked.
    fn solve_from_zero(
        &mut self,
        targets: &[Pose],
        loads: &[Load],
        observer: &mut impl StepObserver,
    ) -> Result<Option<StepReport>, Error> {
        let interval = u64::from(self.model.solver.force_check_interval);
        if interval == 0 || self.state.step % interval != interval - 1 {
            return Ok(None);
        }
        let inputs = StepInputs { targets, loads, speed_limit: None, zero_start: true };
        let mut end = self.state_pool.take();
        let workspace = &mut self.workspace;
        let report = advance(&self.model, &self.state, &mut end, &inputs, workspace, observer);
        self.state_pool.keep(Arc::new(end));
        match report {
            Ok(report) => Ok(Some(report)),
            Err(Error::Stopped(reason)) => Err(Error::Stopped(reason)),
            // The step itself tells of what it meets, too.
            Err(_) => Ok(None),
        }
    }
}
