//! Stepping of a model whose bodies follow the tamping cycle of a case.

use crate::Result;
use crate::case::{self, Case};
use crate::profile::Profile;
use ballast::drive::{SpeedLimit, StepInputs};
use ballast::math::Pose;
use ballast::model::Model;
use ballast::state::State;
use ballast::step::{StepReport, step};
use ballast::track::TampingCycle;
use ballast::workspace::Workspace;

/// Steps a model along a tamping cycle.
pub struct CycleStepper {
    /// Cycle of the case.
    pub cycle: TampingCycle,
    speed_limit: SpeedLimit,
}

impl CycleStepper {
    /// Creates a stepper for the bodies of `model`.
    pub fn new(cycle: TampingCycle, model: &Model) -> Self {
        Self { cycle, speed_limit: SpeedLimit::new(model) }
    }

    /// Takes a step; returns its report and the prescribed poses `[nd]`.
    ///
    /// # Errors
    /// A step that fails or is interrupted.
    pub fn step(
        &self,
        model: &Model,
        state: &mut State,
        workspace: &mut Workspace,
        watch: &mut Profile,
    ) -> Result<(StepReport, Vec<Pose>)> {
        let mut targets = Vec::new();
        self.cycle.targets(model, state, &mut targets);
        let inputs = StepInputs {
            speed_limit: Some(&self.speed_limit),
            ..StepInputs::from_targets(&targets)
        };
        let report = step(model, state, &inputs, workspace, watch)?;
        let mut memory = std::mem::take(&mut state.drive);
        self.cycle.observe(model, &report, state, &mut memory);
        state.drive = memory;
        Ok((report, targets))
    }
}

/// Returns the cycle of a case.
///
/// # Errors
/// A case without a cycle for this model, or a state of another cycle.
pub fn cycle(case: &Case, model: &Model, state: &State) -> Result<TampingCycle> {
    let cycle = TampingCycle::new(&case.plan, model).map_err(|e| case::invalid(case, e))?;
    cycle.check_memory(&state.drive).map_err(|e| case::invalid(case, e))?;
    Ok(cycle)
}
