//! Heads and lengths of records.
//!
//! Contract: no length within a record is trusted before it has been compared with that of the record.

use crate::chunk::MAX_READ_BYTES;
use mcap::records::op;
use std::fs::File;
use std::io::Read;

/// Size of kind and length, which precede every record, bytes.
pub(crate) const RECORD_HEAD: usize = 9;
/// Length above which a record is skipped if its content is not needed, bytes.
const MAX_READ_RECORD_BYTES: u64 = MAX_READ_BYTES as u64;
/// Size of the first content that is read of a longer record, bytes: up to the name of an attachment.
const START_BYTES: u64 = 64;

/// Kind and length of a record; of a long one also the first bytes of its content.
pub(crate) struct RecordHead {
    /// Bytes of the file; fewer than a head at its end.
    pub bytes: Vec<u8>,
}

impl RecordHead {
    /// Reads the head at the current position of a file.
    pub fn read(file: &File) -> std::io::Result<Self> {
        let mut head = Self { bytes: Vec::with_capacity(RECORD_HEAD) };
        file.take(RECORD_HEAD as u64).read_to_end(&mut head.bytes)?;
        if head.is_long() {
            file.take(START_BYTES).read_to_end(&mut head.bytes)?;
        }
        Ok(head)
    }

    /// Kind of the record; 0 at the end of the file.
    pub fn kind(&self) -> u8 {
        self.bytes.first().copied().unwrap_or_default()
    }

    /// Length of the content according to the head, bytes.
    pub fn length(&self) -> u64 {
        let length = self.bytes.get(1..).and_then(<[u8]>::first_chunk);
        length.map_or(0, |length| u64::from_le_bytes(*length))
    }

    /// True if the record is skipped where its content is not needed.
    pub fn is_long(&self) -> bool {
        self.length() > MAX_READ_RECORD_BYTES
    }

    /// Length of the content that has not been read, bytes.
    pub fn rest(&self) -> u64 {
        self.length().saturating_sub(self.bytes.len().saturating_sub(RECORD_HEAD) as u64)
    }

    /// True if the content has a text `name` after `before` bytes.
    pub fn is_named(&self, before: usize, name: &str) -> bool {
        let text = [&(name.len() as u32).to_le_bytes()[..], name.as_bytes()].concat();
        self.bytes.get(RECORD_HEAD + before..).is_some_and(|content| content.starts_with(&text))
    }
}

/// True if a record is an index of messages: a channel, a length in bytes, and that many bytes of times and offsets.
pub(crate) fn is_index(data: &[u8]) -> bool {
    let split = data.get(2..).and_then(|rest| rest.split_first_chunk());
    split.is_some_and(|(length, entries)| {
        u32::from_le_bytes(*length) as usize == entries.len() && entries.len().is_multiple_of(16)
    })
}

/// Returns `None` if a text of the record claims to be longer than the record. The library allocates the claimed length
/// before it compares, and expects the checksum of an attachment without a check.
pub(crate) fn texts_fit(kind: u8, data: &[u8]) -> Option<()> {
    // Bytes before the texts, number of texts, true if a map follows, and minimum number of bytes at the end.
    let (before, texts, has_map, after) = match kind {
        op::HEADER => (0, 2, false, 0),
        op::SCHEMA => (2, 2, false, 4),
        op::CHANNEL => (4, 2, true, 0),
        op::CHUNK => (28, 1, false, 8),
        op::ATTACHMENT => (16, 2, false, 12),
        op::METADATA => (0, 1, true, 0),
        _ => return Some(()),
    };
    let mut rest = data.get(before..)?;
    for _ in 0..texts {
        rest = after_text(rest)?;
    }
    if has_map {
        let (length, entries) = rest.split_first_chunk()?;
        let end = entries.len().checked_sub(u32::from_le_bytes(*length) as usize)?;
        rest = entries;
        while rest.len() > end {
            rest = after_text(after_text(rest)?)?;
        }
    }
    (rest.len() >= after).then_some(())
}

/// Returns the bytes after a text, which has its length in four bytes before it.
fn after_text(bytes: &[u8]) -> Option<&[u8]> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.get(u32::from_le_bytes(*length) as usize..)
}
