//! Pictures of a state in a recording.

use crate::entry::Entry;
use ballast::math::Vec3;
use ballast::model::Model;
use ballast::state::State;
use ballast_protocol::{MessageError, visualization};

/// Points, see [`pictures::stones`].
///
/// # Errors
/// None for a state of any sensible size.
fn stones(model: &Model, state: &State) -> Result<Entry, MessageError> {
    Entry::of("/stones", state.time_ns, &visualization::grain_cloud(model, state))
}

/// Polyhedra and forces, see [`pictures::scene`].
///
/// # Errors
/// None for a state of any sensible size.
fn scene(model: &Model, state: &State, forces: &[Vec3]) -> Result<Entry, MessageError> {
    Entry::of("/scene", state.time_ns, &visualization::scene(model, state, forces))
}

/// The points, and where it is to be `whole` the polyhedra, which are many times larger.
///
/// # Errors
/// None for a state of any sensible size.
pub fn pictures(
    model: &Model,
    state: &State,
    forces: &[Vec3],
    whole: bool,
) -> Result<Vec<Entry>, MessageError> {
    let mut entries = vec![stones(model, state)?];
    if whole {
        entries.push(scene(model, state, forces)?);
    }
    Ok(entries)
}
