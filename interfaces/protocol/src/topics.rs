//! Messages of recordings and live views, with their topics.

use crate::messages::{
    AdvanceReply, Clock, Header, PoseStamped, TFMessage, Time, Transform, TransformStamped, Twist,
    TwistStamped, WORLD, WrenchStamped,
};
use crate::topic_message::{TopicMessage, topic_part};
use crate::{MessageError, visualization};
use ballast::math::Vec3;
use ballast::model::{Model, Role};
use ballast::state::State;

/// Topic of transforms that do not change.
pub const STATIC: &str = "/tf_static";
/// Topic of the point cloud of grains.
pub const STONES: &str = "/stones";
/// Topic of polyhedra and force arrows.
pub const SCENE: &str = "/scene";

/// Returns the topic of a zone of the bed.
pub fn zone_topic(zone: &str) -> String {
    format!("/ballast/zone/{}", topic_part(zone))
}

/// Returns the messages of a state without a window: static transforms, clock, transforms, poses and twists.
///
/// # Errors
/// A message that CDR cannot represent.
pub fn start_messages(model: &Model, state: &State) -> Result<Vec<TopicMessage>, MessageError> {
    Ok([static_transforms(model, state)?, configuration(model, state)?].concat())
}

/// Returns the transforms of floor and walls, which do not change.
fn static_transforms(model: &Model, state: &State) -> Result<Vec<TopicMessage>, MessageError> {
    let fixed = (0..model.driven.len()).filter(|d| model.driven[*d].role == Role::Boundary);
    let transforms = fixed.map(|d| transform(model, state, d)).collect();
    Ok(vec![TopicMessage::of(STATIC, state.time_ns, &TFMessage { transforms })?])
}

/// Returns clock, transforms, poses and twists of tools and sleepers.
fn configuration(model: &Model, state: &State) -> Result<Vec<TopicMessage>, MessageError> {
    let time = state.time_ns;
    let tools: Vec<usize> =
        (0..model.driven.len()).filter(|d| model.driven[*d].role != Role::Boundary).collect();
    let transforms = tools.iter().map(|&d| transform(model, state, d)).collect();
    let mut messages = vec![
        TopicMessage::of("/clock", time, &Clock { clock: Time::from_ns(time) })?,
        TopicMessage::of("/tf", time, &TFMessage { transforms })?,
    ];
    for d in tools {
        let b = model.grains.len() + d;
        let name = topic_part(&model.driven[d].name);
        let header = Header::world(time);
        let pose = PoseStamped { header: header.clone(), pose: state.pose(b).into() };
        messages.push(TopicMessage::of(format!("/{name}/pose"), time, &pose)?);
        let twist =
            Twist { linear: state.velocity[b].into(), angular: state.angular_velocity[b].into() };
        let twist = TwistStamped { header, twist };
        messages.push(TopicMessage::of(format!("/{name}/twist"), time, &twist)?);
    }
    Ok(messages)
}

fn transform(model: &Model, state: &State, d: usize) -> TransformStamped {
    let pose = state.pose(model.grains.len() + d);
    TransformStamped {
        header: Header { stamp: Time::from_ns(state.time_ns), frame_id: WORLD.into() },
        child_frame_id: model.driven[d].name.clone(),
        transform: Transform {
            translation: pose.position.into(),
            rotation: pose.orientation.into(),
        },
    }
}

/// Returns the messages of a window that has led to `state`: configuration, reactions, zones, solver, energy and hash.
///
/// # Errors
/// A message that CDR cannot represent.
pub fn window_messages(
    model: &Model,
    state: &State,
    reply: &AdvanceReply,
) -> Result<Vec<TopicMessage>, MessageError> {
    let time = state.time_ns;
    let mut messages = configuration(model, state)?;
    for body in &reply.bodies {
        let name = topic_part(&body.body);
        let tool = model.driven_index(&body.body).map(|d| model.driven[d].role);
        if tool != Some(Role::Boundary) {
            let wrench = WrenchStamped { header: Header::world(time), wrench: body.mean };
            messages.push(TopicMessage::of(format!("/{name}/wrench"), time, &wrench)?);
        }
        messages.push(TopicMessage::of(format!("/{name}/impulse"), time, body)?);
    }
    for zone in &reply.zones {
        messages.push(TopicMessage::of(zone_topic(&zone.zone), time, zone)?);
    }
    for squeeze in &reply.squeezes {
        let topic = format!("/ballast/squeeze/{}", topic_part(&squeeze.pair));
        messages.push(TopicMessage::of(topic, time, squeeze)?);
    }
    messages.push(TopicMessage::of("/ballast/solver", time, &reply.solver)?);
    messages.push(TopicMessage::of("/ballast/energy", time, &reply.energy)?);
    messages.push(TopicMessage::of("/ballast/hash", time, &reply.hash)?);
    Ok(messages)
}

/// Returns the point cloud of a state.
///
/// # Errors
/// A state too large for a message.
pub fn stones_message(model: &Model, state: &State) -> Result<TopicMessage, MessageError> {
    TopicMessage::of(STONES, state.time_ns, &visualization::grain_cloud(model, state))
}

/// Returns the polyhedra of a state with force arrows; without `has_grains`, those of tines and sleepers.
///
/// # Errors
/// A state too large for a message.
pub fn scene_message(
    model: &Model,
    state: &State,
    forces: &[Vec3],
    has_grains: bool,
) -> Result<TopicMessage, MessageError> {
    let scene = match has_grains {
        true => visualization::scene(model, state, forces),
        false => visualization::bodies(model, state, forces),
    };
    TopicMessage::of(SCENE, state.time_ns, &scene)
}
