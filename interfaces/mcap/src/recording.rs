//! Our windows in a recording of ours.

use crate::chunk::LARGEST;
use crate::error::{Error, Result};
use crate::messages::{Lost, Message, Messages};
use crate::meta::{self, Meta};
use crate::told;
use crate::window::{PARAMETERS, STEP};
use ballast_protocol::from_cdr;
use ballast_protocol::messages::{SolverParameters, WindowRecord};
use std::path::Path;

/// What is told beside the numbers: nobody computes it again, and pictures are large.
const ASIDE: [&str; 3] = ["/stones", "/scene", "/log"];

/// Name of the attachment that holds the state at the beginning.
pub(crate) const START: &str = "start.h5";

/// A window as it was recorded.
#[derive(Debug, Clone)]
pub struct Window {
    /// Set before this window.
    pub parameters: Option<SolverParameters>,
    pub record: WindowRecord,
    /// The messages of the window's end, in order, without pictures and log; the record itself comes last.
    pub messages: Vec<Message>,
    /// Those before it that are of another time: of the recording's start.
    pub before: Vec<Message>,
}

/// Reads a recording window by window.
pub struct Windows {
    messages: Messages,
    meta: Meta,
    /// Messages of the window that is not closed yet.
    open: Vec<Message>,
    /// Memory that they take.
    open_bytes: u64,
    parameters: Option<SolverParameters>,
    /// Whether a window was given.
    is_begun: bool,
}

/// Whether a file says that it is a recording of ours.
///
/// # Errors
/// The system refuses; it is no MCAP file.
pub fn is_ours(path: &Path) -> Result<bool> {
    let mut messages = Messages::open(path)?;
    messages.read_to_first()?;
    Ok(messages.metadata(meta::NAME).is_some())
}

impl Windows {
    /// Opens a recording.
    ///
    /// # Errors
    /// The system refuses; it is no MCAP file, or none of ours; its format is not known.
    pub fn open(path: &Path) -> Result<Self> {
        let mut messages = Messages::open(path)?;
        messages.read_to_first()?;
        let Some(entries) = messages.metadata(meta::NAME) else {
            let expected = "a recording of windows of ours";
            return Err(Error::unsuitable(path, "metadata", expected, "none"));
        };
        let meta = Meta::from_entries(path, entries)?;
        let (open, open_bytes, parameters, is_begun) = (Vec::new(), 0, None, false);
        Ok(Self { messages, meta, open, open_bytes, parameters, is_begun })
    }

    pub fn meta(&self) -> &Meta {
        &self.meta
    }

    /// The checkpoint from which the recording goes on, where it does not begin at the case's beginning.
    pub fn start(&self) -> Option<&[u8]> {
        self.messages.attachment(START)
    }

    pub fn path(&self) -> &Path {
        self.messages.path()
    }

    /// Where the file says that its last message is, ns. Nothing is to depend on it but the time that is left.
    pub fn told_end_ns(&self) -> Option<u64> {
        told::end_ns(self.path())
    }

    /// Why reading ended early, if it did. Messages of a window that was not closed are lost then.
    pub fn lost(&self) -> Option<&Lost> {
        self.messages.lost()
    }

    /// The next window; `None` after the last whole one.
    ///
    /// # Errors
    /// The system refuses; a record that cannot be read, or out of order; a whole file whose last messages no window has.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Result<Option<Window>> {
        while let Some(message) = self.messages.next()? {
            let path = self.messages.path();
            if message.channel.topic == PARAMETERS {
                let set = from_cdr(&message.data)
                    .map_err(|e| Error::message(path, PARAMETERS, message.log_time, e))?;
                self.parameters = Some(set);
                continue;
            }
            if ASIDE.contains(&&message.channel.topic[..]) {
                continue;
            }
            if message.channel.topic != STEP {
                self.open_bytes += (size_of::<Message>() + message.data.len()) as u64;
                if self.open_bytes > LARGEST {
                    let place = format!("{} at {} ns", message.channel.topic, message.log_time);
                    let expected = format!("a window of at most {LARGEST} bytes");
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
            return Ok(Some(Window { parameters, record, messages, before }));
        }
        // Of a recording that was ended before its first window there is the beginning alone.
        let is_empty =
            !self.is_begun && self.open.windows(2).all(|pair| pair[0].log_time == pair[1].log_time);
        match self.open.first() {
            Some(message) if self.lost().is_none() && !is_empty => {
                let place = format!("{} at {} ns", message.channel.topic, message.log_time);
                let expected = format!("a window of it, closed by {STEP}");
                Err(Error::damaged(self.path(), place, expected, "the end of the file"))
            }
            _ => Ok(None),
        }
    }
}
