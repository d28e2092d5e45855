//! Messages of a window in a recording.

use ballast::model::Model;
use ballast::state::State;
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, WindowRecord};
use ballast_protocol::{MessageError, TopicMessage, topics};

/// Topic of the records of windows.
pub(crate) const STEP: &str = "/ballast/step";

/// Topic of solver parameters, which apply from the next window on.
pub(crate) const PARAMETERS: &str = "/ballast/parameters";

/// Returns all messages of a window; the last one is its [`WindowRecord`].
pub(crate) fn window_messages(
    model: &Model,
    state: &State,
    request: &AdvanceRequest,
    reply: &AdvanceReply,
) -> Result<Vec<TopicMessage>, MessageError> {
    let mut messages = topics::window_messages(model, state, reply)?;
    let record = WindowRecord::of(request.clone(), reply)?;
    messages.push(TopicMessage::of(STEP, state.time_ns, &record)?);
    Ok(messages)
}
