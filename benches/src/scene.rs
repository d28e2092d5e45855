//! Subject of a measurement: a case at its beginning or at a checkpoint of a run, or a neutral sample.

use super::args::StartArgs;
use ballast::drive::{SpeedLimit, StepInputs};
use ballast::math::Pose;
use ballast::model::Model;
use ballast::state::State;
use ballast::step::{StepReport, step};
use ballast::track::TampingCycle;
use ballast::track::plan::Plan;
use ballast::workspace::Workspace;
use ballast_hdf5::checkpoint::{self, Kind};
use ballast_scenario::sample::Sample;
use ballast_session::beds;
use ballast_session::case::{self, Case, CaseOverrides};
use ballast_session::driver::tamping_driver;
use ballast_session::files::read_sample;
use ballast_session::profile::Profile;
use ballast_session::{Failure, Reporter, Result};
use std::path::Path;
use std::sync::Arc;

/// Model, initial state and driver of a measurement.
pub struct BenchScene {
    pub name: String,
    pub model: Model,
    pub state: State,
    pub driver: SceneDriver,
    /// Number of steps of the whole run.
    pub steps: u64,
}

/// Source of the motion of the driven bodies.
pub enum SceneDriver {
    /// Tamping cycle of the case.
    Cycle { cycle: Box<TampingCycle>, speed_limit: SpeedLimit },
    /// Poses that the driven bodies keep `[nd]`.
    Fixed(Vec<Pose>),
}

impl BenchScene {
    /// Reads a case, or a sample if the file is one.
    pub fn load(path: &Path, start: &StartArgs, console: &dyn Reporter) -> Result<Self> {
        if path.extension().is_some_and(|e| e == "json") {
            return Self::sample_at(path, start);
        }
        let case = case::load(path, &CaseOverrides::from(&start.overrides), console)?;
        let (mut model, state) = match &start.from_checkpoint {
            Some(from) => at_checkpoint(&case, from)?,
            None => beds::scene(&case, &start.beds.bed_cache, console)?,
        };
        if let Some(schedule) = start.overrides.schedule {
            model.solver.schedule = schedule.into();
        }
        let cycle = Box::new(tamping_driver(&case, &model, &state)?.cycle().clone());
        let driver = SceneDriver::Cycle { cycle, speed_limit: SpeedLimit::new(&model) };
        Ok(Self { name: case.plan.name.clone(), model, state, driver, steps: case.steps() })
    }

    fn sample_at(path: &Path, start: &StartArgs) -> Result<Self> {
        if start.from_checkpoint.is_some() || start.overrides.seed.is_some() {
            let text = format!(
                "{}: expected neither --from-checkpoint nor --seed, since a sample has no beds and no checkpoints",
                path.display()
            );
            return Err(Failure::Usage(text));
        }
        let mut scene = Self::read_sample(path)?;
        if let Some(schedule) = start.overrides.schedule {
            scene.model.solver.schedule = schedule.into();
        }
        Ok(scene)
    }

    /// Reads a sample, in which only grains move.
    pub fn read_sample(path: &Path) -> Result<Self> {
        let Sample { model, state, steps, .. } = read_sample(path)?;
        let driver = SceneDriver::Fixed(state.imposed_poses(&model));
        let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        Ok(Self { name, model, state, driver, steps })
    }

    /// Returns a description for the notes of a table.
    pub fn describe(&self) -> String {
        let (grains, step) = (self.model.grains.len(), self.state.step);
        format!("{}, {grains} grains, from step {step} of {}", self.name, self.steps)
    }

    /// Returns the prescribed poses at the end of the next step `[nd]`.
    pub fn targets(&self) -> Vec<Pose> {
        match &self.driver {
            SceneDriver::Fixed(poses) => poses.clone(),
            SceneDriver::Cycle { cycle, .. } => {
                let mut targets = Vec::new();
                let tamping = cycle.decode(&self.state.driver).unwrap_or_default();
                cycle.targets(&self.model, &self.state, &tamping, &mut targets);
                targets
            }
        }
    }
}

impl SceneDriver {
    /// Advances `state` by one step of `model`.
    pub fn step(
        &self,
        model: &Model,
        state: &mut State,
        workspace: &mut Workspace,
        watch: &mut Profile,
    ) -> Result<StepReport> {
        match self {
            SceneDriver::Cycle { cycle, speed_limit } => {
                let mut tamping = cycle.decode(&state.driver)?;
                let mut targets = Vec::new();
                cycle.targets(model, state, &tamping, &mut targets);
                let speed_limit = Some(speed_limit);
                let inputs = StepInputs { speed_limit, ..StepInputs::from_targets(&targets) };
                let report = step(model, state, &inputs, workspace, watch)?;
                cycle.observe(model, &report, state, &mut tamping);
                state.driver = Arc::new(cycle.encode(&tamping));
                Ok(report)
            }
            SceneDriver::Fixed(poses) => {
                let inputs = StepInputs::from_targets(poses);
                Ok(step(model, state, &inputs, workspace, watch)?)
            }
        }
    }
}

/// Reads model and state of a run of `case` from the checkpoint `from`.
fn at_checkpoint(case: &Case, from: &Path) -> Result<(Model, State)> {
    let stored = checkpoint::read(from)?;
    if stored.kind != Kind::Run {
        let what = format!("expected the checkpoint of a run, found a {}", stored.kind.name());
        return Err(Failure::at(from, what));
    }
    let (found, expected) = (&stored.key, case.bed_key());
    if *found != expected {
        return Err(Failure::Mismatch(format!(
            "{}: expected a checkpoint of {:?} on the bed {expected}, found one of {:?} on the bed {found}",
            from.display(),
            case.plan.name,
            stored.case_name
        )));
    }
    // The key of the bed does not depend on motions and solver.
    let stored_plan = Case::parse(stored.case_text, &stored.case_name)?.plan;
    let motion = |Plan { sleepers, tines, plates, tamping, run, .. }: &Plan| {
        (sleepers.clone(), tines.clone(), plates.clone(), *tamping, run.stepping, run.restitution)
    };
    if motion(&stored_plan) != motion(&case.plan) {
        return Err(Failure::Mismatch(format!(
            "{}: expected a run with the machine, time step and restitution of the case, found another",
            from.display()
        )));
    }
    let model = Model { solver: case.plan.run.solver, ..stored.model };
    Ok((model, stored.state))
}
