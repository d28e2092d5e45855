//! What the keys mean together: sizes that fit, bodies that do not collide, times that divide.
//!
//! Each check leaves out what rests on keys that are wrong already.

mod bed;
mod collision;
mod machine;
mod names;
mod slips;
mod time;

pub use bed::bed;
pub use collision::collisions;
pub use machine::machine;
pub use names::names;
pub use slips::slips;
pub use time::{run, step_ns};
