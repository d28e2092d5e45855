//! Driven bodies that are put on a mount and taken off it.
//!
//! Reads and writes: model and state, whose mounted bodies stand before the other driven ones.

use crate::math::Vec3;
use crate::model::{Model, Mount};
use crate::state::State;

/// Puts driven body `d`, which stands still, on a mount: behind the other mounted ones.
pub(crate) fn put_on_mount(model: &mut Model, state: &mut State, d: usize, mount: Mount) {
    let (first, ng) = (model.mounted_count(), model.grains.len());
    model.driven[d].mount = Some(mount);
    model.driven[first..=d].rotate_right(1);
    let bodies = ng + first..=ng + d;
    state.position[bodies.clone()].rotate_right(1);
    state.orientation[bodies.clone()].rotate_right(1);
    state.velocity[bodies.clone()].rotate_right(1);
    state.angular_velocity[bodies.clone()].rotate_right(1);
    state.mount.push(state.pose(ng + first));
    state.contacts.renumber(|b| match b {
        _ if !bodies.contains(&b) => b,
        _ if b == ng + d => ng + first,
        _ => b + 1,
    });
}

/// Takes mounted body `d` off its mount and puts it, standing still, behind all driven bodies.
pub(super) fn take_off_mount(model: &mut Model, state: &mut State, d: usize) {
    let (body, last) = (model.grains.len() + d, model.body_count() - 1);
    model.driven[d].mount = None;
    model.driven[d..].rotate_left(1);
    state.position[body..].rotate_left(1);
    state.orientation[body..].rotate_left(1);
    state.velocity[body..].rotate_left(1);
    state.angular_velocity[body..].rotate_left(1);
    state.velocity[last] = Vec3::zeros();
    state.mount.remove(d);
    state.contacts.renumber(|b| match b {
        _ if b < body => b,
        _ if b == body => last,
        _ => b - 1,
    });
}
