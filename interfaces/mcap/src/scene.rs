//! Point clouds and scenes of a state in a recording.

use crate::topic_message::TopicMessage;
use ballast::math::Vec3;
use ballast::model::Model;
use ballast::state::State;
use ballast_protocol::{MessageError, visualization};

/// Returns the point cloud of a state, and with `whole` the scene, which is many times larger.
///
/// # Errors
/// A state too large for a message.
pub fn pictures(
    model: &Model,
    state: &State,
    forces: &[Vec3],
    whole: bool,
) -> Result<Vec<TopicMessage>, MessageError> {
    let time = state.time_ns;
    let mut messages =
        vec![TopicMessage::of("/stones", time, &visualization::grain_cloud(model, state))?];
    if whole {
        let scene = visualization::scene(model, state, forces);
        messages.push(TopicMessage::of("/scene", time, &scene)?);
    }
    Ok(messages)
}
