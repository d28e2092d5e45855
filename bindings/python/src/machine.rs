//! Tamping cycle of the case, which moves tines and sleepers.

use ballast::component::{Interpolation, Knot, MotionInput, Waveform};
use ballast::math::{Pose, Vec3};
use ballast::model::Model;
use ballast::state::State;
use ballast::step::StepReport;
use ballast::track::plan::Plan;
use ballast::track::{TampingCycle, TampingPhase};
use std::sync::Arc;

/// Tamping cycle and its memory: forces of the last vibration period, progress of lowering and closing.
#[derive(Clone)]
pub struct Machine {
    cycle: Arc<TampingCycle>,
    /// Copied on write: windows with other motions share it.
    memory: Arc<Vec<f64>>,
}

impl Machine {
    /// Returns the cycle of `plan` at the start of a run.
    pub fn new(plan: &Plan, model: &Model) -> Result<Self, ballast::Error> {
        let cycle = Arc::new(TampingCycle::new(plan, model)?);
        Ok(Self { cycle, memory: Arc::default() })
    }

    /// Returns the cycle with another memory.
    ///
    /// # Errors
    /// The memory does not belong to this cycle.
    pub fn with_memory(self, memory: Vec<f64>) -> Result<Self, ballast::Error> {
        self.cycle.check_memory(&memory)?;
        Ok(Self { memory: Arc::new(memory), ..self })
    }

    /// Returns the memory.
    pub fn memory(&self) -> &[f64] {
        &self.memory
    }

    /// Returns the phase at a time, s.
    pub fn phase(&self, time_s: f64) -> TampingPhase {
        self.cycle.phase(time_s)
    }

    /// Returns the cycle.
    pub fn cycle(&self) -> &TampingCycle {
        &self.cycle
    }

    /// Returns the motions of the step after `state`.
    pub fn motions(&self, model: &Model, state: &State) -> Vec<MotionInput> {
        let mut motions = Vec::new();
        let now = state.time_ns;
        let end = now + model.stepping.step_ns;
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

    /// Updates the memory with the step that led to `state`.
    pub fn observe(&mut self, model: &Model, state: &State, report: &StepReport) {
        self.cycle.observe(model, report, state, Arc::make_mut(&mut self.memory));
    }
}
