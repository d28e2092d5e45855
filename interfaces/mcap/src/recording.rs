//! Reader of the windows of a recording.

use crate::chunk::MAX_CHUNK_BYTES;
use crate::error::{Error, Result};
use crate::messages::{McapMessage, MessageReader, Truncation};
use crate::metadata::RecordingMetadata;
use crate::summary_section;
use crate::window::{PARAMETERS, STEP};
use ballast_protocol::from_cdr;
use ballast_protocol::messages::{SolverParameters, WindowRecord};
use std::path::Path;

/// Topics that verification does not compare.
const SKIPPED_TOPICS: [&str; 3] = ["/stones", "/scene", "/log"];

/// Window of a recording.
#[derive(Debug, Clone)]
pub struct RecordedWindow {
    /// Solver parameters that were set before this window.
    pub parameters: Option<SolverParameters>,
    /// Request and reply of the window.
    pub record: WindowRecord,
    /// Messages at the window's end, in order, without pictures and log; the last one is the record.
    pub messages: Vec<McapMessage>,
    /// Messages before it with another time: those of the recording's start.
    pub before: Vec<McapMessage>,
}

/// Reader of a recording, window by window.
pub struct WindowReader {
    messages: MessageReader,
    meta: RecordingMetadata,
    /// Messages of the unfinished window.
    open: Vec<McapMessage>,
    /// Memory of these messages, bytes.
    open_bytes: u64,
    parameters: Option<SolverParameters>,
    /// True after the first window.
    is_begun: bool,
}

/// Returns true if a file is a recording of Ballast.
///
/// # Errors
/// A file that cannot be read, or is no MCAP file.
pub fn is_recording(path: &Path) -> Result<bool> {
    let mut messages = MessageReader::open(path)?;
    messages.read_to_first()?;
    Ok(messages.metadata().is_some())
}

impl WindowReader {
    /// Opens a recording.
    ///
    /// # Errors
    /// A file that cannot be read, is no recording of Ballast, or has another version of the format.
    pub fn open(path: &Path) -> Result<Self> {
        let mut messages = MessageReader::open(path)?;
        messages.read_to_first()?;
        let Some(entries) = messages.metadata() else {
            let expected = "a recording of Ballast";
            return Err(Error::unsuitable(path, "metadata", expected, "none"));
        };
        let meta = RecordingMetadata::from_entries(path, entries)?;
        Ok(Self {
            messages,
            meta,
            open: Vec::new(),
            open_bytes: 0,
            parameters: None,
            is_begun: false,
        })
    }

    /// Metadata of the recording.
    pub fn meta(&self) -> &RecordingMetadata {
        &self.meta
    }

    /// Checkpoint at which the recording starts; `None` if it starts with the case.
    pub fn start(&self) -> Option<&[u8]> {
        self.messages.start()
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        self.messages.path()
    }

    /// Time of the last message according to the file, ns. A hint for estimates of remaining time only.
    pub fn end_time_hint_ns(&self) -> Option<u64> {
        summary_section::end_time_ns(self.path())
    }

    /// Reason of an early end of reading, if there is one. Messages of an unfinished window are then not returned.
    pub fn truncation(&self) -> Option<&Truncation> {
        self.messages.truncation()
    }

    /// Returns the next window; `None` after the last complete one.
    ///
    /// # Errors
    /// A file or record that cannot be read; records out of order; messages after the last window of a complete file.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Result<Option<RecordedWindow>> {
        while let Some(message) = self.messages.next()? {
            let path = self.messages.path();
            if message.channel.topic == PARAMETERS {
                let set = from_cdr(&message.data)
                    .map_err(|e| Error::message(path, PARAMETERS, message.log_time, e))?;
                self.parameters = Some(set);
                continue;
            }
            if SKIPPED_TOPICS.contains(&&message.channel.topic[..]) {
                continue;
            }
            if message.channel.topic != STEP {
                self.open_bytes += (size_of::<McapMessage>() + message.data.len()) as u64;
                if self.open_bytes > MAX_CHUNK_BYTES {
                    let place = format!("{} at {} ns", message.channel.topic, message.log_time);
                    let expected = format!("a window of at most {MAX_CHUNK_BYTES} bytes");
                    return Err(Error::damaged(path, place, expected, "a larger one"));
                }
                self.open.push(message);
                continue;
            }
            let record: WindowRecord = from_cdr(&message.data)
                .map_err(|e| Error::message(path, STEP, message.log_time, e))?;
            let end = u64::try_from(record.t1_ns).ok();
            if end != Some(message.log_time) || record.t0_ns > record.t1_ns {
                let place = format!("{STEP}, window {}", record.seq);
                let expected = format!("a window that ends at {} ns", message.log_time);
                let found = format!("{} to {} ns", record.t0_ns, record.t1_ns);
                return Err(Error::damaged(path, place, expected, found));
            }
            let mut messages = std::mem::take(&mut self.open);
            self.open_bytes = 0;
            messages.push(message);
            let (messages, before) = messages.into_iter().partition(|m| Some(m.log_time) == end);
            let parameters = self.parameters.take();
            self.is_begun = true;
            return Ok(Some(RecordedWindow { parameters, record, messages, before }));
        }
        // A recording that ended before its first window has only the messages of its start.
        let is_empty =
            !self.is_begun && self.open.windows(2).all(|pair| pair[0].log_time == pair[1].log_time);
        match self.open.first() {
            Some(message) if self.truncation().is_none() && !is_empty => {
                let place = format!("{} at {} ns", message.channel.topic, message.log_time);
                let expected = format!("a window of it, closed by {STEP}");
                Err(Error::damaged(self.path(), place, expected, "the end of the file"))
            }
            _ => Ok(None),
        }
    }
}
