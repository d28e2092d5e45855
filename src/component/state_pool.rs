//! Pool of unused states, whose memory later steps reuse.

use crate::state::State;
use std::sync::Arc;

/// Pool of unused states, so that windows of any length allocate no memory.
///
/// One state is written to by the next step, the other was left by the last.
#[derive(Debug, Default)]
pub(super) struct StatePool(Vec<State>);

impl StatePool {
    const MOST: usize = 2;

    /// Takes a state to write to, whose content is undefined.
    pub fn take(&mut self) -> State {
        self.0.pop().unwrap_or_default()
    }

    /// Keeps the memory of a state that is not shared.
    pub fn keep(&mut self, state: Arc<State>) {
        if self.0.len() < Self::MOST
            && let Ok(state) = Arc::try_unwrap(state)
        {
            self.0.push(state);
        }
    }
}
