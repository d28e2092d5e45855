//! What a caller changes in a case, beside its text; kept as notes of checkpoints and recordings.

use ballast::model::Schedule;
use ballast::track::plan::Plan;
use std::collections::BTreeMap;

const SCHEDULE: &str = "schedule";
const SEED: &str = "seed";

/// What is changed in a case; runs that differ in these are different runs.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Choices {
    pub schedule: Option<Schedule>,
    pub seed: Option<u64>,
}

/// A choice that is none here.
#[derive(Debug, Clone, PartialEq)]
pub struct UnknownChoice {
    pub key: &'static str,
    pub expected: String,
    pub found: String,
}

impl UnknownChoice {
    fn schedule(found: &str) -> Self {
        let expected = format!("one of {}", Schedule::ALL.map(Schedule::name).join(", "));
        Self { key: SCHEDULE, expected, found: found.into() }
    }

    fn seed(found: &str) -> Self {
        Self { key: SEED, expected: "a whole number".into(), found: found.into() }
    }
}

impl std::fmt::Display for UnknownChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Self { key, expected, found } = self;
        write!(f, "{key}: expected {expected}, found {found:?}")
    }
}

impl std::error::Error for UnknownChoice {}

impl Choices {
    /// As a caller says them, the schedule by its name.
    ///
    /// # Errors
    /// A name that is none of a schedule.
    pub fn named(seed: Option<u64>, schedule: Option<&str>) -> Result<Self, UnknownChoice> {
        let named = |name| Schedule::from_name(name).ok_or_else(|| UnknownChoice::schedule(name));
        Ok(Self { schedule: schedule.map(named).transpose()?, seed })
    }

    /// Changes the plan of a case.
    pub fn apply(&self, plan: &mut Plan) {
        if let Some(schedule) = self.schedule {
            plan.run.solver.schedule = schedule;
        }
        if let Some(seed) = self.seed {
            plan.bed.seed = seed;
        }
    }

    /// These, and where they say nothing, what `other` says.
    pub fn or(self, other: Self) -> Self {
        Self { schedule: self.schedule.or(other.schedule), seed: self.seed.or(other.seed) }
    }

    /// As notes of a checkpoint or recording.
    pub fn notes(&self) -> BTreeMap<String, String> {
        let schedule = self.schedule.map(|s| (SCHEDULE.to_string(), s.name().to_string()));
        let seed = self.seed.map(|seed| (SEED.to_string(), seed.to_string()));
        schedule.into_iter().chain(seed).collect()
    }

    /// From such notes; others beside them do not matter.
    ///
    /// # Errors
    /// A schedule or a seed that is none.
    pub fn from_notes(notes: &BTreeMap<String, String>) -> Result<Self, UnknownChoice> {
        let seed = notes.get(SEED).map(|s| s.parse().map_err(|_| UnknownChoice::seed(s)));
        Self::named(seed.transpose()?, notes.get(SCHEDULE).map(String::as_str))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choices_survive_a_checkpoint() {
        for schedule in Schedule::ALL.map(Some).into_iter().chain([None]) {
            for seed in [None, Some(u64::MAX)] {
                let choices = Choices { schedule, seed };
                assert_eq!(Choices::from_notes(&choices.notes()).unwrap(), choices);
            }
        }
        for (key, value) in [(SCHEDULE, "random"), (SEED, "-1")] {
            let notes = BTreeMap::from([(key.to_string(), value.to_string())]);
            let unknown = Choices::from_notes(&notes).unwrap_err();
            let text = unknown.to_string();
            assert!(text.starts_with(key) && text.ends_with(&format!("found {value:?}")), "{text}");
        }
    }
}
