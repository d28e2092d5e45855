//! The program as a component of a larger model, over Zenoh: serving, and looking at what is served.

pub mod args;
pub mod describe;
pub mod doctor;
mod host;
pub mod serve;
mod served_checkpoint;
mod served_recording;
pub mod top;
