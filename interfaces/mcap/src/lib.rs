//! Recordings of Ballast in MCAP files.
//!
//! [`WindowRecorder`] writes requests and replies of a run, window by window; [`messages`] reads any
//! MCAP file, whole or cut short; [`recording`] finds our windows in one, [`motion`] the motion of
//! bodies in any; [`mod@verify`] computes a recording again and names the first difference.
//!
//! Contract: times in a file are simulated; the same run leaves the same bytes. A killed run leaves a
//! file that can be read up to its last whole chunk. No file, however damaged, makes this crate panic or
//! take more memory than a chunk may need, and as much for its messages, and for a window or the poses of a [`motion`],
//! of which knots are made.

pub mod messages;
pub mod motion;
pub mod recording;
pub mod scene;
pub mod verify;

mod chunk;
mod entry;
mod error;
mod meta;
mod told;
mod window;
mod window_recorder;
mod writer;

pub use entry::Entry;
pub use error::{Error, Result};
pub use meta::{Drive, Meta};
pub use verify::verify;
pub use window_recorder::{WindowRecorder, may_become_a_recording};
pub use writer::Writer;
