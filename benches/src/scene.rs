//! What is measured: a case from its bed or from a checkpoint of a run, or a neutral sample.

use super::args::Start;
use ballast::drive::StepInputs;
use ballast::math::Pose;
use ballast::model::Model;
use ballast::state::State;
use ballast::step::{StepReport, step};
use ballast::track::plan::Plan;
use ballast::workspace::Workspace;
use ballast_hdf5::checkpoint::{self, Kind};
use ballast_scenario::sample::Sample;
use ballast_session::Reporter;
use ballast_session::beds;
use ballast_session::case::{self, Case, CaseOverrides};
use ballast_session::files::read_sample;
use ballast_session::machine::{self, Machine};
use ballast_session::profile::Profile;
use ballast_session::{Failure, Outcome};
use std::path::Path;

/// A model, where it begins, and what moves its bodies.
pub struct Scene {
    pub name: String,
    pub model: Model,
    pub state: State,
    pub mover: Mover,
    /// Steps of the whole run.
    pub steps: u64,
}

/// Who moves the bodies.
pub enum Mover {
    /// The machine of the case.
    Machine(Box<Machine>),
    /// Nobody: they stay where they are.
    Nobody(Vec<Pose>),
}

impl Scene {
    /// Reads a case, or a sample where the file is one.
    pub fn load(path: &Path, start: &Start, console: &dyn Reporter) -> Outcome<Self> {
        if path.extension().is_some_and(|e| e == "json") {
            return Self::of_sample_from(path, start);
        }
        let case = case::load(path, &CaseOverrides::from(&start.overrides), console)?;
        let (mut model, state) = match &start.from {
            Some(from) => at_checkpoint(&case, from)?,
            None => beds::scene(&case, &start.beds.beds, console)?,
        };
        if let Some(schedule) = start.overrides.schedule {
            model.solver.schedule = schedule.into();
        }
        let cycle = machine::cycle(&case, &model, &state)?;
        let mover = Mover::Machine(Box::new(Machine::new(cycle, &model)));
        Ok(Self { name: case.plan.name.clone(), model, state, mover, steps: case.steps() })
    }

    fn of_sample_from(path: &Path, start: &Start) -> Outcome<Self> {
        if start.from.is_some() || start.overrides.seed.is_some() {
            let text = format!(
                "{}: a sample has neither beds nor checkpoints: expected no --from and no --seed",
                path.display()
            );
            return Err(Failure::Usage(text));
        }
        let mut scene = Self::of_sample(path)?;
        if let Some(schedule) = start.overrides.schedule {
            scene.model.solver.schedule = schedule.into();
        }
        Ok(scene)
    }

    /// Reads a sample; nothing moves in it but grains.
    pub fn of_sample(path: &Path) -> Outcome<Self> {
        let Sample { model, state, steps, .. } = read_sample(path)?;
        let mover = Mover::Nobody(state.driven_poses(&model));
        let name = path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        Ok(Self { name, model, state, mover, steps })
    }

    /// What the scene is, for notes.
    pub fn describe(&self) -> String {
        let (grains, step) = (self.model.grains.len(), self.state.step);
        format!("{}, {grains} grains, from step {step} of {}", self.name, self.steps)
    }

    /// Where the imposed bodies are to be at the end of the step from `state` `[nd]`.
    pub fn targets(&self) -> Vec<Pose> {
        match &self.mover {
            Mover::Nobody(still) => still.clone(),
            Mover::Machine(machine) => {
                let mut targets = Vec::new();
                machine.cycle.targets(&self.model, &self.state, &mut targets);
                targets
            }
        }
    }
}

impl Mover {
    /// Takes a step of `model`.
    pub fn step(
        &self,
        model: &Model,
        state: &mut State,
        workspace: &mut Workspace,
        watch: &mut Profile,
    ) -> Outcome<StepReport> {
        match self {
            Mover::Machine(machine) => Ok(machine.step(model, state, workspace, watch)?.0),
            Mover::Nobody(still) => {
                let inputs = StepInputs::from_targets(still);
                Ok(step(model, state, &inputs, workspace, watch)?)
            }
        }
    }
}

/// Model and state of a run of `case` that stopped at the checkpoint `from`.
fn at_checkpoint(case: &Case, from: &Path) -> Outcome<(Model, State)> {
    let kept = checkpoint::read(from)?;
    if kept.kind != Kind::Run {
        let what = format!("it is a {}, expected the checkpoint of a run", kept.kind.name());
        return Err(Failure::at(from, what));
    }
    let (found, expected) = (&kept.key, case.bed_key());
    if *found != expected {
        return Err(Failure::Mismatch(format!(
            "{}: it is of a run of {:?} on the bed {found}; expected one of {:?} on the bed {expected}",
            from.display(),
            kept.case_name,
            case.plan.name
        )));
    }
    // The bed says nothing of how it is moved and solved.
    let ran = Case::parse(kept.case_text, &kept.case_name)?.plan;
    let moved = |Plan { sleepers, tines, tamping, run, .. }: &Plan| {
        (sleepers.clone(), tines.clone(), *tamping, run.stepping, run.restitution)
    };
    if moved(&ran) != moved(&case.plan) {
        return Err(Failure::Mismatch(format!(
            "{}: expected a run with machine, time step and restitution of the case, found another",
            from.display()
        )));
    }
    let model = Model { solver: case.plan.run.solver, ..kept.model };
    Ok((model, kept.state))
}
