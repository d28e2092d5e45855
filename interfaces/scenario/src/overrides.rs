//! Overrides of a case by its caller, stored as notes of checkpoints and recordings.

use ballast::model::Schedule;
use ballast::track::plan::Plan;
use std::collections::BTreeMap;

const SCHEDULE: &str = "schedule";
const SEED: &str = "seed";

/// Values that take the place of a case's own; `None` keeps the case's value. Runs that differ in them are different runs.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CaseOverrides {
    /// Override of `solver.schedule`.
    pub schedule: Option<Schedule>,
    /// Override of `bed.seed`.
    pub seed: Option<u64>,
}

/// Error of an override with an invalid value.
#[derive(Debug, Clone, PartialEq)]
pub struct OverrideError {
    /// Name of the override.
    pub key: &'static str,
    /// Description of the valid values.
    pub expected: String,
    /// Invalid value.
    pub found: String,
}

impl OverrideError {
    fn schedule(found: &str) -> Self {
        let expected = format!("one of {}", Schedule::ALL.map(Schedule::name).join(", "));
        Self { key: SCHEDULE, expected, found: found.into() }
    }

    fn seed(found: &str) -> Self {
        Self { key: SEED, expected: "a whole number".into(), found: found.into() }
    }
}

impl std::fmt::Display for OverrideError {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Self { key, expected, found } = self;
        write!(f, "{key}: expected {expected}, found {found:?}")
    }
}

impl std::error::Error for OverrideError {}

impl CaseOverrides {
    /// Creates overrides from a seed and the name of a schedule.
    ///
    /// # Errors
    /// A name of no schedule.
    pub fn from_names(seed: Option<u64>, schedule: Option<&str>) -> Result<Self, OverrideError> {
        let schedule_of =
            |name| Schedule::from_name(name).ok_or_else(|| OverrideError::schedule(name));
        Ok(Self { schedule: schedule.map(schedule_of).transpose()?, seed })
    }

    /// Applies the overrides to the plan of a case.
    pub fn apply(&self, plan: &mut Plan) {
        if let Some(schedule) = self.schedule {
            plan.run.solver.schedule = schedule;
        }
        if let Some(seed) = self.seed {
            plan.bed.seed = seed;
        }
    }

    /// Returns these overrides, completed by those of `other`.
    pub fn or(self, other: Self) -> Self {
        Self { schedule: self.schedule.or(other.schedule), seed: self.seed.or(other.seed) }
    }

    /// Converts the overrides to notes of a checkpoint or recording.
    pub fn to_notes(&self) -> BTreeMap<String, String> {
        let schedule = self.schedule.map(|s| (SCHEDULE.to_string(), s.name().to_string()));
        let seed = self.seed.map(|seed| (SEED.to_string(), seed.to_string()));
        schedule.into_iter().chain(seed).collect()
    }

    /// Creates overrides from the notes of a checkpoint or recording; ignores other notes.
    ///
    /// # Errors
    /// An invalid schedule or seed.
    pub fn from_notes(notes: &BTreeMap<String, String>) -> Result<Self, OverrideError> {
        let seed = notes.get(SEED).map(|s| s.parse().map_err(|_| OverrideError::seed(s)));
        Self::from_names(seed.transpose()?, notes.get(SCHEDULE).map(String::as_str))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overrides_survive_conversion_to_notes() {
        for schedule in Schedule::ALL.map(Some).into_iter().chain([None]) {
            for seed in [None, Some(u64::MAX)] {
                let overrides = CaseOverrides { schedule, seed };
                assert_eq!(CaseOverrides::from_notes(&overrides.to_notes()).unwrap(), overrides);
            }
        }
        for (key, value) in [(SCHEDULE, "random"), (SEED, "-1")] {
            let notes = BTreeMap::from([(key.to_string(), value.to_string())]);
            let error = CaseOverrides::from_notes(&notes).unwrap_err();
            let text = error.to_string();
            assert!(text.starts_with(key) && text.ends_with(&format!("found {value:?}")), "{text}");
        }
    }
}
