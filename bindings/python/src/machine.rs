//! The machine of the case: what moves tines and sleepers where no partner does.

use ballast::component::{Interpolation, Knot, MotionInput, Waveform};
use ballast::math::{Pose, Vec3};
use ballast::model::Model;
use ballast::state::State;
use ballast::step::StepReport;
use ballast::track::plan::Plan;
use ballast::track::{TampingCycle, TampingPhase};
use std::sync::Arc;

/// The machine, and what it remembers: forces of the last vibration period, how far it has lowered and closed.
#[derive(Clone)]
pub struct Machine {
    cycle: Arc<TampingCycle>,
    /// Shared until it changes: windows that others move keep it.
    memory: Arc<Vec<f64>>,
}

impl Machine {
    /// The machine of `plan` as it is at the start of a run.
    pub fn new(plan: &Plan, model: &Model) -> Result<Self, ballast::Error> {
        let cycle = Arc::new(TampingCycle::new(plan, model)?);
        Ok(Self { cycle, memory: Arc::default() })
    }

    /// The same machine with another memory.
    ///
    /// # Errors
    /// A memory that is not one of its own.
    pub fn with_memory(self, memory: Vec<f64>) -> Result<Self, ballast::Error> {
        self.cycle.check_memory(&memory)?;
        Ok(Self { memory: Arc::new(memory), ..self })
    }

    /// What it remembers.
    pub fn memory(&self) -> &[f64] {
        &self.memory
    }

    pub fn phase(&self, time_s: f64) -> TampingPhase {
        self.cycle.phase(time_s)
    }

    pub fn cycle(&self) -> &TampingCycle {
        &self.cycle
    }

    /// The motions of the step after `state`.
    pub fn motions(&self, model: &Model, state: &State) -> Vec<MotionInput> {
        let mut motions = Vec::new();
        let (now, end) = (state.time_ns, state.time_ns + model.stepping.step_ns);
        self.cycle.place(model, now, &self.memory, |d, position| {
            let from = state.imposed(model, d);
            let knot = |time_ns, pose| Knot {
                time_ns,
                pose,
                velocity: Vec3::zeros(),
                angular_velocity: Vec3::zeros(),
            };
            let knots = vec![knot(now, from), knot(end, Pose { position, ..from })];
            let waveform = Waveform { interpolation: Interpolation::Linear, knots };
            motions.push(MotionInput {
                body: model.driven[d].name.clone(),
                waveform,
                allow_jump: false,
            });
        });
        motions
    }

    /// Takes the step that has led to `state`.
    pub fn observe(&mut self, model: &Model, state: &State, report: &StepReport) {
        self.cycle.observe(model, report, state, Arc::make_mut(&mut self.memory));
    }
}
