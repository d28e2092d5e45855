//! A case as every face runs it: read, with what its caller chose, and told in checkpoints and recordings.

use ballast::component::{Component, Limits, Refusal};
use ballast::model::Model;
use ballast::state::State;
use ballast::track;
use ballast::track::plan::Plan;
use ballast_hdf5::checkpoint::{Checkpoint, Kind};
use ballast_scenario::{CaseErrors, Choices, Diagnostic};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A case that was read and found sound, ready to be prepared and run.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    pub plan: Plan,
    /// As it was read; kept in checkpoints.
    pub text: String,
    /// What the plan has otherwise than the text.
    pub choices: Choices,
    /// What is allowed but looks like a slip.
    pub warnings: Vec<Diagnostic>,
}

impl Case {
    /// Reads a case from its text; `name` stands for it in messages.
    ///
    /// # Errors
    /// A text that describes no run, with every fault and its place.
    pub fn read(text: String, name: &str) -> Result<Self, CaseErrors> {
        let ballast_scenario::Case { plan, warnings } = ballast_scenario::read_case(&text, name)?;
        Ok(Self { plan, text, choices: Choices::default(), warnings })
    }

    /// The same case with other choices, where some are made.
    pub fn chosen(mut self, choices: Choices) -> Self {
        choices.apply(&mut self.plan);
        self.choices = choices.or(self.choices);
        self
    }

    /// Steps of the whole run.
    pub fn steps(&self) -> u64 {
        self.plan.run.duration_ns / self.plan.run.stepping.step_ns.max(1)
    }

    /// What the prepared bed depends on, as a short text.
    pub fn bed_key(&self) -> String {
        ballast_scenario::content_key(&self.plan)
    }

    /// Name, key of the bed and text, for recordings.
    pub fn names(&self) -> [String; 3] {
        [self.plan.name.clone(), self.bed_key(), self.text.clone()]
    }

    /// The case as a component at `state`, which follows the squeezes of its tines.
    ///
    /// # Errors
    /// A model or a state that is none of the case.
    pub fn component(
        &self,
        model: Arc<Model>,
        state: impl Into<Arc<State>>,
        limits: Limits,
    ) -> Result<Component, Refusal> {
        let squeezes = track::squeezes(&self.plan, &model)?;
        Ok(Component::new(model, state, limits)?.with_squeezes(squeezes))
    }

    /// A checkpoint of a run of it: its choices are notes there, beside the caller's.
    pub fn checkpoint(
        &self,
        model: &Model,
        state: &State,
        mut notes: BTreeMap<String, String>,
    ) -> Checkpoint {
        notes.extend(self.choices.notes());
        self.kept(Kind::Run, (model.clone(), state.clone()), notes)
    }

    pub(crate) fn kept(
        &self,
        kind: Kind,
        (model, state): (Model, State),
        extra: BTreeMap<String, String>,
    ) -> Checkpoint {
        let [case_name, key, case_text] = self.names();
        Checkpoint { model, state, kind, case_name, case_text, key, extra }
    }
}
