//! Named saved states of a component.

use super::error::{ErrorCode, RequestError};
use ballast::component::{Component, Parameters};
use ballast::state::State;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Maximum number of saved states.
pub const MAX_SAVED_STATES: usize = 64;

/// Simulation state together with the solver parameters in force when it was saved.
#[derive(Debug, Clone, PartialEq)]
pub struct SavedState {
    /// State of all bodies and contacts.
    pub state: Arc<State>,
    /// Solver parameters for the windows after the state.
    pub parameters: Parameters,
}

impl SavedState {
    /// Saves the current state of a component.
    pub fn of(component: &Component) -> Self {
        Self { state: component.save(), parameters: component.parameters() }
    }

    pub(super) fn restore_to(self, component: &mut Component) -> Result<(), RequestError> {
        component.restore(self.state)?;
        Ok(component.set_parameters(&self.parameters)?)
    }
}

/// Saved states by name, at most [`MAX_SAVED_STATES`].
#[derive(Debug, Default)]
pub(super) struct SavedStates {
    entries: BTreeMap<String, SavedStateEntry>,
    /// Number of saves since the start of the run.
    save_count: u64,
}

#[derive(Debug)]
struct SavedStateEntry {
    saved: SavedState,
    /// Client that saved it.
    client: String,
    /// Running number of the save; decides which entry is evicted first.
    sequence: u64,
}

impl SavedStates {
    /// Saves a state for `client`. When the store is full, evicts the oldest state of another client.
    pub fn put(&mut self, name: &str, saved: SavedState, client: &str) -> Result<(), RequestError> {
        if self.entries.len() >= MAX_SAVED_STATES && !self.entries.contains_key(name) {
            let others = self.entries.iter().filter(|(_, entry)| entry.client != client);
            let oldest = others.min_by_key(|(_, entry)| entry.sequence).map(|(name, _)| name);
            let Some(oldest) = oldest.cloned() else {
                let found = format!("{} and {name:?}", self.entries.len());
                let expected = format!("at most {MAX_SAVED_STATES}; drop one");
                return Err(RequestError::expected(
                    ErrorCode::TooManyStates,
                    "saved states",
                    expected,
                    found,
                ));
            };
            self.entries.remove(&oldest);
        }
        self.save_count += 1;
        let entry = SavedStateEntry { saved, client: client.into(), sequence: self.save_count };
        self.entries.insert(name.into(), entry);
        Ok(())
    }

    pub fn get(&self, name: &str) -> Result<SavedState, RequestError> {
        let entry = self.entries.get(name).ok_or_else(|| self.unknown_name(name))?;
        Ok(entry.saved.clone())
    }

    pub fn remove(&mut self, name: &str) -> Result<(), RequestError> {
        self.entries.remove(name).map(|_| ()).ok_or_else(|| self.unknown_name(name))
    }

    fn unknown_name(&self, name: &str) -> RequestError {
        let known: Vec<_> = self.entries.keys().collect();
        let found: String = name.chars().take(50).collect();
        let expected = match known[..] {
            [] => "a saved state; there is none".to_string(),
            _ => format!("one of {known:?}"),
        };
        RequestError::expected(ErrorCode::UnknownState, "name", expected, format!("{found:?}"))
    }
}
