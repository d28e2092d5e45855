//! What moves the bodies of a session: the machine of the case, or a recording.
//!
//! Contract: both lead through the same step of the core; what a recording of the machine is replayed to is
//! the machine's own state, bit for bit.

use crate::case::{self, Case};
use crate::exit::{Failure, Outcome};
use crate::memory::Memory;
use crate::playback::Playback;
use crate::profile::Profile;
use ballast::component::{Component, Refusal, StopReason, WindowInputsRef};
use ballast::math::Pose;
use ballast::model::Model;
use ballast::state::State;
use ballast::step::{Phase, StepObserver, StepReport};
use ballast::track::{TampingCycle, TampingPhase};
use ballast::workspace::Workspace;
use ballast_mcap::verify::Keeper as _;
use ballast_session::machine::CycleStepper;
use std::borrow::Cow;
use std::ops::ControlFlow;
use std::sync::Arc;

/// A model that is stepped, and who steps it.
pub struct Engine {
    source: Source,
}

enum Source {
    Machine {
        model: Box<Model>,
        state: Box<State>,
        workspace: Box<Workspace>,
        machine: Box<CycleStepper>,
    },
    Recording {
        component: Box<Component>,
        playback: Box<Playback>,
        memory: Box<Memory>,
    },
}

/// A step that was taken.
pub struct Stepped {
    pub report: StepReport,
    /// Time before the step, ns.
    pub t0_ns: u64,
    /// Imposed pose of each driven body before and after the step `[nd]`.
    pub imposed: Vec<[Pose; 2]>,
}

impl Engine {
    /// The case's machine at `state`.
    pub fn machine(model: Model, state: State, cycle: TampingCycle) -> Self {
        let machine = Box::new(CycleStepper::new(cycle, &model));
        let (model, state, workspace) = (Box::new(model), Box::new(state), Box::default());
        Self { source: Source::Machine { model, state, workspace, machine } }
    }

    /// A recording that moves the bodies from `state` on.
    pub fn recording(
        case: &Case,
        model: Model,
        state: State,
        cycle: TampingCycle,
        playback: Playback,
    ) -> Outcome<Self> {
        let memory = Box::new(Memory::new(&cycle, &state, playback.is_of_the_machine()));
        let component = case::component(case, Arc::new(model), state)?;
        let (component, playback) = (Box::new(component), Box::new(playback));
        Ok(Self { source: Source::Recording { component, playback, memory } })
    }

    pub fn model(&self) -> &Model {
        match &self.source {
            Source::Machine { model, .. } => model,
            Source::Recording { component, .. } => component.model(),
        }
    }

    /// The state; what the machine remembers is in [`Engine::whole_state`].
    pub fn state(&self) -> &State {
        match &self.source {
            Source::Machine { state, .. } => state,
            Source::Recording { component, .. } => component.state(),
        }
    }

    pub fn workspace(&self) -> &Workspace {
        match &self.source {
            Source::Machine { workspace, .. } => workspace,
            Source::Recording { component, .. } => component.workspace(),
        }
    }

    /// The state with what the machine remembers.
    pub fn whole_state(&self) -> Cow<'_, State> {
        match &self.source {
            Source::Machine { state, .. } => Cow::Borrowed(state),
            Source::Recording { component, memory, .. } => memory.complete(component.state()),
        }
    }

    /// Fingerprint of model and state.
    pub fn hash(&self) -> u128 {
        ballast_hdf5::state_hash(self.model(), &self.whole_state())
    }

    /// The phase of the machine's cycle; `Done` where something else moves the bodies.
    pub fn phase(&self) -> TampingPhase {
        let cycle = match &self.source {
            Source::Machine { machine, .. } => &machine.cycle,
            Source::Recording { playback, memory, .. } if playback.is_of_the_machine() => {
                &memory.cycle
            }
            Source::Recording { .. } => return TampingPhase::Done,
        };
        cycle.phase(self.state().time())
    }

    /// The recording, where there is one.
    pub fn playback(&self) -> Option<&Playback> {
        match &self.source {
            Source::Machine { .. } => None,
            Source::Recording { playback, .. } => Some(playback),
        }
    }

    /// Refuses a recording that cannot lead the bodies through the next step; nothing is computed.
    pub fn expect_a_step(&mut self) -> Outcome {
        let Source::Recording { component, playback, .. } = &mut self.source else { return Ok(()) };
        let [t0_ns, t1_ns] = next_step(component);
        if !playback.reach(t0_ns, t1_ns)? {
            return Err(playback.too_short(t0_ns, component.model().stepping.h()));
        }
        let checked = check_new(component, playback, t1_ns);
        checked.map_err(|e| Failure::at(playback.path(), format!("{e}{}", playback.advice())))
    }

    /// Takes a step; `None` where the recording ends.
    ///
    /// # Errors
    /// [`Failure::Interrupted`] where who was asked to stop did so within the step, which is then not done; others.
    pub fn step(&mut self, watch: &mut Profile) -> Outcome<Option<Stepped>> {
        match &mut self.source {
            Source::Machine { model, state, workspace, machine } => {
                let before = imposed(model, state);
                let t0_ns = state.time_ns;
                let (report, after) = machine.step(model, state, workspace, watch)?;
                let imposed = before.into_iter().zip(after).map(|(a, b)| [a, b]).collect();
                Ok(Some(Stepped { report, t0_ns, imposed }))
            }
            Source::Recording { component, playback, memory } => {
                let before = imposed(component.model(), component.state());
                let [t0_ns, t1_ns] = next_step(component);
                if !playback.reach(t0_ns, t1_ns)? {
                    return Ok(None);
                }
                if let Some(set) = playback.parameters() {
                    let set = component.set_parameters(&set.into());
                    set.map_err(|e| Failure::at(playback.path(), e))?;
                }
                let checked = check_new(component, playback, t1_ns);
                checked.map_err(|e| Failure::at(playback.path(), e))?;
                let model = component.shared_model();
                let (motions, loads) = playback.inputs_of(t0_ns, t1_ns);
                let inputs = WindowInputsRef { motions: &motions, loads: &loads };
                let mut taking = Taking { model: &model, memory, profile: watch, report: None };
                let outcome = component
                    .advance_observed(t1_ns, inputs, &mut taking)
                    .map_err(|e| Failure::at(playback.path(), e))?;
                let report = match (taking.report, outcome.error) {
                    (Some(report), None) => report,
                    (_, Some(why)) => return Err(Failure::at(playback.path(), why)),
                    (None, None) => return Err(ballast::Error::Stopped(StopReason::Early).into()),
                };
                let after = imposed(&model, component.state());
                let imposed = before.into_iter().zip(after).map(|(a, b)| [a, b]).collect();
                Ok(Some(Stepped { report, t0_ns, imposed }))
            }
        }
    }
}

/// Takes what a step of a recording has done.
struct Taking<'a> {
    model: &'a Model,
    memory: &'a mut Memory,
    profile: &'a mut Profile,
    report: Option<StepReport>,
}

impl StepObserver for Taking<'_> {
    fn phase_finished(&mut self, phase: Phase) {
        self.profile.phase_finished(phase);
    }
    fn cancelled(&mut self) -> Option<StopReason> {
        self.profile.cancelled()
    }

    fn step_finished(&mut self, state: &State, report: &StepReport) -> ControlFlow<StopReason> {
        self.memory.observe(self.model, state, report);
        self.report = Some(report.clone());
        ControlFlow::Continue(())
    }
}

/// Looks at the inputs of a recording as a whole, once: the step to `t1_ns` is the first that they lead.
fn check_new(component: &Component, playback: &mut Playback, t1_ns: u64) -> Result<(), Refusal> {
    if playback.has_new_inputs() { component.check(t1_ns, playback.inputs()) } else { Ok(()) }
}

/// When the next step begins and ends, ns.
fn next_step(component: &Component) -> [u64; 2] {
    let t0_ns = component.now_ns();
    [t0_ns, t0_ns.saturating_add(component.model().stepping.step_ns)]
}

/// Where each driven body, or its mount, was told to be `[nd]`.
fn imposed(model: &Model, state: &State) -> Vec<Pose> {
    (0..model.driven.len()).map(|d| state.imposed(model, d)).collect()
}
