//! The track: sleepers, tines, the tamping cycle, and the bed they work in.

pub mod plan;
