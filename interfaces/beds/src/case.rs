//! A case with the caller's overrides, ready to be prepared, run and stored.

use ballast::component::{Component, Limits, Refusal};
use ballast::model::Model;
use ballast::state::State;
use ballast::track;
use ballast::track::plan::Plan;
use ballast_hdf5::checkpoint::{Checkpoint, Kind};
use ballast_scenario::{CaseDiagnostic, CaseErrors, CaseOverrides, CheckedPlan};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Checked case, ready to be prepared and run.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Plan of the scenario, with `overrides` applied.
    pub plan: Plan,
    /// Text of the case file, which checkpoints store.
    pub text: String,
    /// Differences between `plan` and `text`.
    pub overrides: CaseOverrides,
    /// Allowed values that are probably mistakes.
    pub warnings: Vec<CaseDiagnostic>,
}

impl Case {
    /// Parses and checks the text of a case file; `name` stands for the file in messages.
    ///
    /// # Errors
    /// All errors of the text, each with its position.
    pub fn parse(text: String, name: &str) -> Result<Self, CaseErrors> {
        let CheckedPlan { plan, warnings } = ballast_scenario::read_case(&text, name)?;
        Ok(Self { plan, text, overrides: CaseOverrides::default(), warnings })
    }

    /// Returns the case with `overrides` in addition to its present ones.
    pub fn with_overrides(mut self, overrides: CaseOverrides) -> Self {
        overrides.apply(&mut self.plan);
        self.overrides = overrides.or(self.overrides);
        self
    }

    /// Number of steps of the whole run.
    pub fn steps(&self) -> u64 {
        self.plan.run.duration_ns / self.plan.run.stepping.step_ns.max(1)
    }

    /// Content key of the prepared bed: cases with equal keys have equal beds.
    pub fn bed_key(&self) -> String {
        ballast_scenario::content_key(&self.plan)
    }

    /// Name, bed key and text of the case, for recordings and checkpoints.
    pub fn identity(&self) -> [String; 3] {
        [self.plan.name.clone(), self.bed_key(), self.text.clone()]
    }

    /// Creates a component of the case at `state`, which measures the squeezes of its tines.
    ///
    /// # Errors
    /// A model or a state that does not belong to the case.
    pub fn component(
        &self,
        model: Arc<Model>,
        state: impl Into<Arc<State>>,
        limits: Limits,
    ) -> Result<Component, Refusal> {
        let squeezes = track::squeezes(&self.plan, &model)?;
        Ok(Component::new(model, state, limits)?.with_squeezes(squeezes))
    }

    /// Creates a checkpoint of a run of the case, with its overrides as notes in addition to `notes`.
    pub fn checkpoint(
        &self,
        model: &Model,
        state: &State,
        mut notes: BTreeMap<String, String>,
    ) -> Checkpoint {
        notes.extend(self.overrides.to_notes());
        self.checkpoint_of(Kind::Run, model.clone(), state.clone(), notes)
    }

    pub(crate) fn checkpoint_of(
        &self,
        kind: Kind,
        model: Model,
        state: State,
        extra: BTreeMap<String, String>,
    ) -> Checkpoint {
        let [case_name, key, case_text] = self.identity();
        Checkpoint { model, state, kind, case_name, case_text, key, extra }
    }
}
