//! Recordings of Ballast in MCAP files.
//!
//! [`WindowRecorder`] writes requests and replies of a run, window by window. [`messages`] reads any MCAP file, complete or
//! truncated, [`recording`] the windows of a recording, [`motion`] the motion of bodies in any file. [`mod@verify`]
//! recomputes a recording and returns the first difference.
//!
//! Contract: times in a file are simulated; the same run gives the same bytes. A crash leaves a file that is readable up
//! to its last complete chunk. No file, however damaged, makes this crate panic. Memory is limited to a chunk, as much for
//! its messages, and as much for a window or the poses of a [`motion`].

pub mod messages;
pub mod motion;
pub mod recording;
pub mod verify;

mod chunk;
mod error;
mod metadata;
mod other_format;
mod record;
mod summary_section;
mod window;
mod window_recorder;
mod writer;

pub use ballast_protocol::TopicMessage;
pub use error::{Error, Result};
pub use metadata::{Drive, RecordingMetadata};
pub use verify::verify;
pub use window_recorder::{WindowRecorder, may_become_a_recording};
pub use writer::McapWriter;
