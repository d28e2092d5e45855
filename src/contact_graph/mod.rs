//! Contact graph: contacts that share a grain are neighbours and cannot be solved simultaneously.
//!
//! Driven bodies with imposed motion do not couple contacts.

pub mod packing;

pub use packing::{PADDING, Packing};
