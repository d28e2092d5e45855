//! States that nobody needs any more: memory for those to come.

use crate::state::State;
use std::sync::Arc;

/// Steps go from one state to another. With these kept, windows of any length ask the system for no memory:
/// one is written to by the next step, the other was left by the last.
#[derive(Debug, Default)]
pub(super) struct StatePool(Vec<State>);

impl StatePool {
    const MOST: usize = 2;

    /// A state to write to, with nothing in it that is of use.
    pub fn take(&mut self) -> State {
        self.0.pop().unwrap_or_default()
    }

    /// Keeps the memory of a state, if nobody else holds it.
    pub fn keep(&mut self, state: Arc<State>) {
        if self.0.len() < Self::MOST
            && let Ok(state) = Arc::try_unwrap(state)
        {
            self.0.push(state);
        }
    }
}
