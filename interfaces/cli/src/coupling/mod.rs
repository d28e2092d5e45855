//! Commands that serve a component over Zenoh and inspect served ones.

pub mod args;
pub mod describe;
pub mod doctor;
mod host;
mod log;
pub mod serve;
mod served_checkpoint;
mod served_recording;
pub mod top;
