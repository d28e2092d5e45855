//! Live view of a component in Foxglove: the messages of recordings, sent over WebSocket.
//!
//! Contract: the computing thread hands over a state and never waits; a thread encodes and sends it. A viewer that does
//! not read loses messages, the oldest first. Viewers only watch: nothing that they send changes a run.

mod address;
mod frame_queue;
mod publisher;
mod server;

pub use address::ViewerAddress;
pub use server::{Error, LiveViewServer};
