//! A case file, read and with the command line's choices applied.

use crate::args::{Overrides, ScheduleName};
use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::files::read_text;
use ballast::track::plan::Plan;
use clap::ValueEnum;
use std::collections::BTreeMap;
use std::path::Path;

/// No case file is this long.
const LIMIT: u64 = 16 << 20;

/// The note in a checkpoint that says which run of a served component it is of.
pub const RUN_ID: &str = "run_id";

/// What the command line changes in a case.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Choices {
    pub schedule: Option<ScheduleName>,
    pub seed: Option<u64>,
}

impl From<&Overrides> for Choices {
    fn from(args: &Overrides) -> Self {
        Self { schedule: args.schedule, seed: args.seed }
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
    let text = read_text(path, LIMIT)?;
    parse(text, &path.display().to_string(), choices, console)
}

/// Reads a case from its text; `name` is what messages call the file.
pub fn parse(text: String, name: &str, choices: &Choices, console: Console) -> Outcome<Case> {
    let read = ballast_scenario::read_case(&text, name)
        .map_err(|errors| Failure::InvalidCase(errors.to_string()))?;
    for warning in &read.warnings {
        console.warning(&warning.to_string());
    }
    let mut plan = read.plan;
    if let Some(schedule) = choices.schedule {
        plan.run.solver.schedule = schedule.into();
    }
    if let Some(seed) = choices.seed {
        plan.bed.seed = seed;
    }
    Ok(Case { plan, text, choices: *choices })
}

impl Case {
    /// Steps of the whole run.
    pub fn steps(&self) -> u64 {
        self.plan.run.duration_ns / self.plan.run.stepping.step_ns.max(1)
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

impl Choices {
    /// As notes of a checkpoint.
    pub fn notes(&self) -> BTreeMap<String, String> {
        let schedule = self.schedule.map(|s| ("schedule".to_string(), s.name()));
        let seed = self.seed.map(|seed| ("seed".to_string(), seed.to_string()));
        schedule.into_iter().chain(seed).collect()
    }

    /// From the notes of a checkpoint.
    pub fn from_notes(notes: &BTreeMap<String, String>) -> Outcome<Self> {
        let unknown = |key: &str, value: &str| {
            Failure::Incompatible(format!(
                "the checkpoint was made with {key} {value:?}, unknown here"
            ))
        };
        let schedule = notes
            .get("schedule")
            .map(|name| ScheduleName::from_str(name, false).map_err(|_| unknown("schedule", name)));
        let seed = notes.get("seed").map(|text| text.parse().map_err(|_| unknown("seed", text)));
        Ok(Self { schedule: schedule.transpose()?, seed: seed.transpose()? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_survive_a_checkpoint() {
        let names = ScheduleName::value_variants().iter().copied().map(Some);
        for schedule in names.chain([None]) {
            for seed in [None, Some(u64::MAX)] {
                let choices = Choices { schedule, seed };
                assert_eq!(Choices::from_notes(&choices.notes()).unwrap(), choices);
            }
        }
        let notes = BTreeMap::from([("schedule".to_string(), "random".to_string())]);
        assert_eq!(Choices::from_notes(&notes).unwrap_err().code(), 6);
    }
}
