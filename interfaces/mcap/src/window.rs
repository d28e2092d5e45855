//! What a window leaves in a recording.

use crate::entry::{Entry, topic_part};
use ballast::model::{Model, Role};
use ballast::state::State;
use ballast_protocol::MessageError;
use ballast_protocol::messages::{
    AdvanceReply, AdvanceRequest, Clock, Header, PoseStamped, TFMessage, Time, Transform,
    TransformStamped, Twist, TwistStamped, WORLD, WindowRecord, WrenchStamped,
};

/// Topic of the records of windows.
pub(crate) const STEP: &str = "/ballast/step";

/// Topic of parameters; they hold from the next window on.
pub(crate) const PARAMETERS: &str = "/ballast/parameters";

pub(crate) fn zone_topic(zone: &str) -> String {
    format!("/ballast/zone/{}", topic_part(zone))
}

/// Topic of transforms that do not change.
pub(crate) const STATIC: &str = "/tf_static";

/// What a recording begins with.
pub(crate) fn start(model: &Model, state: &State) -> Result<Vec<Entry>, MessageError> {
    Ok([statics(model, state)?, configuration(model, state)?].concat())
}

/// Frames of floor and walls, once.
fn statics(model: &Model, state: &State) -> Result<Vec<Entry>, MessageError> {
    let fixed = (0..model.driven.len()).filter(|d| model.driven[*d].role == Role::Boundary);
    let transforms = fixed.map(|d| transform(model, state, d)).collect();
    Ok(vec![Entry::of(STATIC, state.time_ns, &TFMessage { transforms })?])
}

/// Where the tools and sleepers are: clock, transforms, poses, twists.
fn configuration(model: &Model, state: &State) -> Result<Vec<Entry>, MessageError> {
    let time = state.time_ns;
    let tools: Vec<usize> =
        (0..model.driven.len()).filter(|d| model.driven[*d].role != Role::Boundary).collect();
    let transforms = tools.iter().map(|&d| transform(model, state, d)).collect();
    let mut entries = vec![
        Entry::of("/clock", time, &Clock { clock: Time::from_ns(time) })?,
        Entry::of("/tf", time, &TFMessage { transforms })?,
    ];
    for d in tools {
        let b = model.grains.len() + d;
        let name = topic_part(&model.driven[d].name);
        let header = Header::world(time);
        let pose = PoseStamped { header: header.clone(), pose: state.pose(b).into() };
        entries.push(Entry::of(format!("/{name}/pose"), time, &pose)?);
        let twist =
            Twist { linear: state.velocity[b].into(), angular: state.angular_velocity[b].into() };
        let twist = TwistStamped { header, twist };
        entries.push(Entry::of(format!("/{name}/twist"), time, &twist)?);
    }
    Ok(entries)
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

/// Everything that a window leaves; its [`WindowRecord`] comes last and closes it.
pub(crate) fn entries(
    model: &Model,
    state: &State,
    request: &AdvanceRequest,
    reply: &AdvanceReply,
) -> Result<Vec<Entry>, MessageError> {
    let time = state.time_ns;
    let mut entries = configuration(model, state)?;
    for body in &reply.bodies {
        let name = topic_part(&body.body);
        let tool = model.driven_index(&body.body).map(|d| model.driven[d].role);
        if tool != Some(Role::Boundary) {
            let wrench = WrenchStamped { header: Header::world(time), wrench: body.mean };
            entries.push(Entry::of(format!("/{name}/wrench"), time, &wrench)?);
        }
        entries.push(Entry::of(format!("/{name}/impulse"), time, body)?);
    }
    for zone in &reply.zones {
        entries.push(Entry::of(zone_topic(&zone.zone), time, zone)?);
    }
    for squeeze in &reply.squeezes {
        let topic = format!("/ballast/squeeze/{}", topic_part(&squeeze.pair));
        entries.push(Entry::of(topic, time, squeeze)?);
    }
    entries.push(Entry::of("/ballast/solver", time, &reply.solver)?);
    entries.push(Entry::of("/ballast/energy", time, &reply.energy)?);
    entries.push(Entry::of("/ballast/hash", time, &reply.hash)?);
    entries.push(Entry::of(STEP, time, &WindowRecord::of(request.clone(), reply)?)?);
    Ok(entries)
}
