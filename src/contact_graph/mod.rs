//! Which contacts may be solved at once: two contacts are neighbours when they share a grain.
//!
//! Driven bodies do not couple contacts: their motion is imposed, whatever pushes on them.

pub mod packing;

pub use packing::{PADDING, Packing};
