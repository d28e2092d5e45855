//! The recording of windows that may be redone.

use crate::error::Result;
use crate::tape::Tape;
use ballast::model::Model;
use ballast::state::State;
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, Status};
use std::sync::Arc;

/// A recording whose last window waits until nothing changes it any more.
///
/// Contract: what stands in it is what is computed from its beginning on: windows as they were in the end. A
/// redone window stands there once, one that was cut short as the shorter window that it was, one that was
/// taken back not at all.
pub struct Redoable {
    tape: Tape,
    /// The last window, and the state that it has led to.
    last: Option<Last>,
}

/// A window: what was asked and answered, the model that it was computed with, the state that it has led to.
struct Last {
    request: AdvanceRequest,
    reply: AdvanceReply,
    model: Arc<Model>,
    state: Arc<State>,
}

impl Redoable {
    pub fn new(tape: Tape) -> Self {
        Self { tape, last: None }
    }

    pub fn tape(&mut self) -> &mut Tape {
        &mut self.tape
    }

    /// Takes a window of `model` that has led to `state`; `is_redone`: it takes the place of the last one.
    ///
    /// # Errors
    /// The system refuses.
    pub fn window(
        &mut self,
        model: Arc<Model>,
        is_redone: bool,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
        state: Arc<State>,
    ) -> Result<()> {
        if !is_redone {
            self.settle()?;
        }
        let is_kept = !matches!(reply.status, Status::Discard | Status::Error | Status::Fatal);
        self.last = is_kept.then(|| {
            let (request, reply) = self.tape.repeatable(request, reply);
            Last { request, reply, model, state }
        });
        Ok(())
    }

    /// Writes the last window: nothing changes it any more.
    ///
    /// # Errors
    /// The system refuses.
    pub fn settle(&mut self) -> Result<()> {
        let Some(Last { request, reply, model, state }) = self.last.take() else { return Ok(()) };
        self.tape.window(&model, &state, &request, &reply)
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// The system refuses.
    pub fn finish(mut self) -> Result<()> {
        self.settle()?;
        self.tape.finish()
    }
}
