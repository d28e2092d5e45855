//! Checks of keys against each other: sizes that fit, bodies that do not collide, times that are whole steps.
//!
//! Each check skips values that depend on keys with errors.

mod bed;
mod collision;
mod machine;
mod names;
mod plates;
mod plausibility;
mod time;

pub use bed::bed;
pub use collision::collisions;
pub use machine::machine;
pub use names::names;
pub use plates::plates;
pub use plausibility::plausibility;
pub use time::{run, step_ns};
