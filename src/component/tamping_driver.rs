//! The tamping cycle of a case as a driver.

use super::{
    Component, Driver, Interpolation, Knot, LoadInput, LoadKnot, LoadWaveform, MotionInput,
    Refusal, Waveform, WindowInputs,
};
use crate::drive::Load;
use crate::math::{Pose, Vec3};
use crate::model::Model;
use crate::state::{DriverState, State};
use crate::step::StepReport;
use crate::track::{TampingCycle, TampingState};
use std::sync::Arc;

/// Driver that moves tines and sleepers through a tamping cycle, and plates, one step per window.
///
/// The motion of a step depends on the forces of the steps before it, so that a window of several steps is refused.
#[derive(Debug, Clone)]
pub struct TampingDriver {
    cycle: Arc<TampingCycle>,
    state: TampingState,
}

impl TampingDriver {
    /// Builds the driver of a cycle that has not begun.
    pub fn new(cycle: impl Into<Arc<TampingCycle>>) -> Self {
        Self { cycle: cycle.into(), state: TampingState::default() }
    }

    /// Returns the cycle.
    pub fn cycle(&self) -> &TampingCycle {
        &self.cycle
    }
}

impl Driver for TampingDriver {
    type Error = Refusal;

    fn inputs(
        &mut self,
        component: &Component,
        end_ns: u64,
    ) -> Result<Option<WindowInputs>, Refusal> {
        let (model, state) = (component.model(), component.state());
        let now_ns = state.time_ns;
        let step_ns = model.stepping.step_ns;
        let nearest_ns = now_ns.saturating_add(step_ns);
        if end_ns != nearest_ns {
            return Err(Refusal::Time {
                now_ns,
                step_ns,
                nearest_ns: [nearest_ns; 2],
                found_ns: end_ns,
            });
        }
        let mut motions = Vec::new();
        self.cycle.positions(model, state, &self.state, |d, position| {
            let from = state.imposed(model, d);
            let (velocity, angular_velocity) = (Vec3::zeros(), Vec3::zeros());
            let knot = |time_ns, pose| Knot { time_ns, pose, velocity, angular_velocity };
            let knots = vec![knot(now_ns, from), knot(end_ns, Pose { position, ..from })];
            let waveform = Waveform { interpolation: Interpolation::Linear, knots };
            let body = model.driven[d].name.clone();
            motions.push(MotionInput { body, waveform, allow_jump: false });
        });
        let mut loads = Vec::new();
        self.cycle.loads(model, now_ns, |d, force| {
            let load = Load { force, torque: Vec3::zeros() };
            let knots =
                vec![LoadKnot { time_ns: now_ns, load }, LoadKnot { time_ns: end_ns, load }];
            let waveform = LoadWaveform { is_held: true, knots };
            loads.push(LoadInput { body: model.driven[d].name.clone(), waveform });
        });
        Ok(Some(WindowInputs { motions, loads }))
    }

    fn observe(&mut self, model: &Model, state: &State, report: &StepReport) {
        self.cycle.observe(model, report, state, &mut self.state);
    }

    fn save(&self) -> DriverState {
        self.cycle.encode(&self.state)
    }

    fn restore(&mut self, saved: &DriverState) -> Result<(), Refusal> {
        self.state = self.cycle.decode(saved)?;
        Ok(())
    }
}
