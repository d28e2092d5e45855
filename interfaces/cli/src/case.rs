//! A case file, read and with the command line's choices applied.

use crate::args::Overrides;
use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::files::read_case;
use ballast::component::{Component, Limits};
use ballast::model::Model;
use ballast::state::State;
use ballast::track;
use ballast::track::plan::Plan;
use ballast_hdf5::checkpoint::{Checkpoint, Kind};
use ballast_mcap::recording::Windows;
pub use ballast_scenario::Choices;
use ballast_scenario::LONGEST_CASE;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// The note in a checkpoint that says which run of a served component it is of.
pub const RUN_ID: &str = "run_id";

impl From<&Overrides> for Choices {
    fn from(args: &Overrides) -> Self {
        Self { schedule: args.schedule.map(Into::into), seed: args.seed }
    }
}

/// A case, ready to be prepared and run.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    pub plan: Plan,
    /// The file's text, kept in checkpoints.
    pub text: String,
    pub choices: Choices,
}

/// Reads a case file; warnings go to the console.
pub fn load(path: &Path, choices: &Choices, console: Console) -> Outcome<Case> {
    let text = read_case(path, LONGEST_CASE)?;
    parse(text, &path.display().to_string(), choices, console)
}

/// The case of a recording of ours: that in the file, or the one that is given, with what the recorded run chose
/// where `choices` say nothing else.
pub fn recorded(
    windows: &Windows,
    given: Option<&Path>,
    choices: Choices,
    console: Console,
) -> Outcome<Case> {
    let meta = windows.meta();
    let choices = choices.or(Choices::from_notes(&meta.choices)?);
    match given {
        Some(path) => load(path, &choices, console),
        None => {
            // Whoever ran it was warned.
            let name = format!("{}, its case", windows.path().display());
            if meta.case_text.len() as u64 > LONGEST_CASE {
                let size = meta.case_text.len();
                let text = format!("{name}: expected at most {LONGEST_CASE} bytes, found {size}");
                return Err(Failure::InvalidCase(text));
            }
            read(meta.case_text.clone(), &name, &choices, |_| {})
        }
    }
}

/// Reads a case from its text; `name` is what messages call the file.
pub fn parse(text: String, name: &str, choices: &Choices, console: Console) -> Outcome<Case> {
    read(text, name, choices, |warning| console.warning(warning))
}

fn read(text: String, name: &str, choices: &Choices, warn: impl Fn(&str)) -> Outcome<Case> {
    let read = ballast_scenario::read_case(&text, name)?;
    for warning in &read.warnings {
        warn(&warning.to_string());
    }
    let mut plan = read.plan;
    choices.apply(&mut plan);
    Ok(Case { plan, text, choices: *choices })
}

impl Case {
    /// Steps of the whole run.
    pub fn steps(&self) -> u64 {
        self.plan.run.duration_ns / self.plan.run.stepping.step_ns.max(1)
    }

    /// The case as a component at `state`, which follows the squeezes of its tines.
    pub fn component(&self, model: Arc<Model>, state: State) -> Outcome<Component> {
        let squeezes = track::squeezes(&self.plan, &model).map_err(|e| self.invalid(e))?;
        let component = Component::new(model, state, Limits::default());
        Ok(component.map_err(|e| self.invalid(e))?.with_squeezes(squeezes))
    }

    /// The case cannot be run.
    pub fn invalid(&self, what: impl std::fmt::Display) -> Failure {
        Failure::InvalidCase(format!("{}: {what}", self.plan.name))
    }

    /// A checkpoint of a run of it, with the caller's notes.
    pub fn checkpoint(
        &self,
        model: &Model,
        state: &State,
        extra: BTreeMap<String, String>,
    ) -> Checkpoint {
        let scene = (model.clone(), state.clone());
        ballast_beds::checkpoint(&self.plan, &self.text, Kind::Run, scene, extra)
    }

    /// Name, key of the bed and text, for recordings.
    pub fn names(&self) -> [String; 3] {
        [self.plan.name.clone(), self.bed_key(), self.text.clone()]
    }

    /// What the prepared bed depends on, as a short text.
    pub fn bed_key(&self) -> String {
        ballast_scenario::content_key(&self.plan)
    }

    /// Mean size of the grains by number: what penetrations are compared with, m.
    pub fn grain_size(&self) -> f64 {
        self.plan.bed.grains.mean_size()
    }

    /// Steps per period of the vibration; 1 without one.
    pub fn steps_per_period(&self) -> usize {
        let frequency = self.plan.tamping.map_or(0.0, |t| t.vibration.frequency);
        if frequency <= 0.0 {
            return 1;
        }
        (1.0 / (frequency * self.plan.run.stepping.h())).round().clamp(1.0, 1e6) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_that_is_not_known_is_of_another_version() {
        let notes = [("schedule".to_string(), "random".to_string())].into();
        assert_eq!(Failure::from(Choices::from_notes(&notes).unwrap_err()).code(), 6);
    }
}
