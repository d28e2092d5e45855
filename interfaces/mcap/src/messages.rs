//! Reader of the messages of any MCAP file, complete or truncated, in the order of the file.
//!
//! Cost: memory for one chunk, and as much for its messages. Contract: only messages of valid chunks are returned. At a
//! truncated or damaged place reading ends, and [`MessageReader::truncation`] has the reason. Unknown records, and records
//! at a wrong place, are errors, because they may have been messages. The file's checksum and its numbers of messages and
//! chunks are compared with those that were read.

use crate::chunk::{self, MAX_CHUNK_BYTES, MAX_READ_BYTES};
use crate::error::{Error, Result};
use crate::metadata::{METADATA_NAME, START_ATTACHMENT};
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Topic, encoding and type of the messages of a channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelInfo {
    /// Name of the topic.
    pub topic: String,
    /// Encoding of the messages: `cdr`, `json` or another.
    pub encoding: String,
    /// Name of the type; empty if there is none.
    pub schema: String,
}

/// Message of an MCAP file.
#[derive(Debug, Clone)]
pub struct McapMessage {
    /// Channel of the message.
    pub channel: Arc<ChannelInfo>,
    /// Time of recording, ns.
    pub log_time: u64,
    /// Encoded content.
    pub data: Vec<u8>,
}

/// Early end of the readable part of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Truncation {
    /// Content of the file at the end of the readable part.
    pub reason: String,
    /// True if the file only ends too early, as after a crash of its writer: inside a record, without the end mark. False
    /// if it is damaged.
    pub is_cut: bool,
    /// Number of readable messages.
    pub messages: u64,
    /// Time of the last of them, ns.
    pub last_ns: Option<u64>,
}

impl std::fmt::Display for Truncation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { reason, messages, last_ns, .. } = self;
        let until = last_ns.map_or(String::new(), |t| format!(", up to {t} ns"));
        write!(f, "{reason}; {messages} messages before it are readable{until}")
    }
}

/// Reader of an MCAP file, message by message.
pub struct MessageReader {
    path: PathBuf,
    file: File,
    reader: LinearReader,
    content: ReaderState,
    finished: bool,
    /// Number of returned messages.
    returned: u64,
    last_ns: Option<u64>,
    truncation: Option<Truncation>,
}

/// Content of the file read so far.
#[derive(Default)]
struct ReaderState {
    profile: Option<String>,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Arc<ChannelInfo>>,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    attachments: BTreeMap<String, Vec<u8>>,
    /// Memory of names, metadata and attachments, which outlive a chunk, bytes.
    permanent_bytes: u64,
    waiting: VecDeque<McapMessage>,
    /// True after the end of the data section.
    complete: bool,
    /// Kind of the last record outside of chunks; 0 before the first.
    last: u8,
    /// MessageReader and chunks so far.
    messages: u64,
    chunks: u32,
}

impl MessageReader {
    /// Opens a file.
    ///
    /// # Errors
    /// A file that cannot be opened, or is no MCAP file.
    pub fn open(path: &Path) -> Result<Self> {
        if path.metadata().is_ok_and(|what| !what.is_file()) {
            // Opening a pipe would block until a writer opens it.
            return Err(Error::unsuitable(path, "recording", "a file", "a folder or a pipe"));
        }
        let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_emit_chunks(true)
            .with_validate_data_section_crc(true)
            .with_record_length_limit(MAX_CHUNK_BYTES as usize);
        let mut messages = Self {
            path: path.into(),
            file,
            reader: LinearReader::new_with_options(options),
            content: ReaderState::default(),
            finished: false,
            returned: 0,
            last_ns: None,
            truncation: None,
        };
        while messages.content.profile.is_none() && !messages.finished {
            messages.read_more()?;
        }
        match messages.content.profile {
            Some(_) => Ok(messages),
            None => {
                let found = messages.truncation.map_or("something else".into(), |end| end.reason);
                Err(Error::damaged(path, "start", "an MCAP file", found))
            }
        }
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the metadata record `name` of the part that has been read.
    pub fn metadata(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        self.content.metadata.get(name)
    }

    /// Returns the attachment `name` of the part that has been read.
    pub fn attachment(&self, name: &str) -> Option<&[u8]> {
        self.content.attachments.get(name).map(|data| &data[..])
    }

    /// Reason of an early end of reading, if there is one.
    pub fn truncation(&self) -> Option<&Truncation> {
        self.truncation.as_ref()
    }

    /// Reads up to the next message, without returning it.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn read_to_first(&mut self) -> Result<()> {
        while self.content.waiting.is_empty() && !self.finished {
            self.read_more()?;
        }
        Ok(())
    }

    /// Returns the next message; `None` at the end of the readable part.
    ///
    /// # Errors
    /// A file that cannot be read.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Result<Option<McapMessage>> {
        self.read_to_first()?;
        let message = self.content.waiting.pop_front();
        if let Some(message) = &message {
            self.returned += 1;
            self.last_ns = self.last_ns.max(Some(message.log_time));
        }
        // The end may have been found before its last messages were returned.
        if let Some(truncation) = &mut self.truncation {
            truncation.messages = self.returned;
            truncation.last_ns = self.last_ns;
        }
        Ok(message)
    }

    /// Reads some bytes, or a record.
    fn read_more(&mut self) -> Result<()> {
        let ended = match self.reader.next_event() {
            Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                let bytes = self.reader.insert(wanted.min(MAX_READ_BYTES));
                let read = self.file.read(bytes).map_err(|e| Error::io(&self.path, "read", e))?;
                self.reader.notify_read(read);
                return Ok(());
            }
            Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                match self.content.record(opcode, data) {
                    Ok(()) if opcode != op::FOOTER => return Ok(()),
                    Ok(()) => None,
                    Err(reason) => Some((reason, false)),
                }
            }
            // All messages have been read; the summary serves random access only.
            _ if self.content.complete => None,
            Some(Err(mcap::McapError::UnexpectedEof)) if is_closed(&mut self.file) => {
                Some(("record length exceeds the file size".into(), false))
            }
            Some(Err(error)) => {
                Some((reason(&error), matches!(error, mcap::McapError::UnexpectedEof)))
            }
            None => Some(("the file ends without an end mark".into(), true)),
        };
        self.finished = true;
        self.truncation = ended.map(|(reason, is_cut)| Truncation {
            reason,
            is_cut,
            messages: self.returned,
            last_ns: self.last_ns,
        });
        Ok(())
    }
}

/// True if a file has an end mark.
fn is_closed(file: &mut File) -> bool {
    let mut end = [0; mcap::MAGIC.len()];
    let back = -(end.len() as i64);
    let read = file.seek(SeekFrom::End(back)).and_then(|_| file.read_exact(&mut end));
    read.is_ok() && end == *mcap::MAGIC
}

/// Kinds of records in the summary section.
const SUMMARY_KINDS: [u8; 8] = [
    op::SCHEMA,
    op::CHANNEL,
    op::STATISTICS,
    op::CHUNK_INDEX,
    op::ATTACHMENT_INDEX,
    op::METADATA_INDEX,
    op::SUMMARY_OFFSET,
    op::FOOTER,
];
/// Size of the fields of a chunk record around the name of its compression, bytes.
const CHUNK_HEAD: usize = 40;
/// First of the kinds that any program may define.
const PRIVATE_KINDS: u8 = 0x80;

/// Describes an error of the MCAP library.
fn reason(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::UnexpectedEof => "the file ends within a record".into(),
        mcap::McapError::BadMagic => "bytes that are not MCAP".into(),
        mcap::McapError::BadDataCrc { .. } => "bytes that do not match their checksum".into(),
        other => format!("a record that cannot be read: {other}"),
    }
}

impl ReaderState {
    /// Takes a record outside of chunks, if its kind may occur at its place.
    fn record(&mut self, kind: u8, data: &[u8]) -> std::result::Result<(), String> {
        let before = std::mem::replace(&mut self.last, kind);
        let is_allowed = match kind {
            op::HEADER => before == 0,
            op::SCHEMA | op::CHANNEL => true,
            op::MESSAGE | op::CHUNK | op::ATTACHMENT | op::METADATA | op::DATA_END => {
                !self.complete
            }
            // An index without its chunk is the rest of a damaged one.
            op::MESSAGE_INDEX => !self.complete && [op::CHUNK, kind].contains(&before),
            _ if SUMMARY_KINDS.contains(&kind) => self.complete,
            PRIVATE_KINDS.. => self.complete || self.may_have_private_records(),
            _ => self.complete,
        };
        if !is_allowed {
            return Err(misplaced(kind));
        }
        match kind {
            op::DATA_END => self.complete = true,
            op::STATISTICS => self.check_statistics(data)?,
            op::MESSAGE_INDEX if !is_index(data) => {
                return Err("an invalid index of messages".into());
            }
            op::HEADER | op::SCHEMA | op::CHANNEL | op::MESSAGE | op::METADATA | op::CHUNK
                if !self.complete =>
            {
                self.take(kind, data)?;
            }
            // Other attachments may be large and are not used.
            op::ATTACHMENT if self.attachments.is_empty() => self.take(kind, data)?,
            _ => {}
        }
        Ok(())
    }

    /// Compares the numbers of messages and chunks with those of the statistics record.
    fn check_statistics(&self, data: &[u8]) -> std::result::Result<(), String> {
        // Not parsed by the library: the map after these numbers may claim any size.
        let number = |bytes: Option<&[u8]>| {
            bytes.map(|b| b.iter().rev().fold(0, |n, byte| n << 8 | u64::from(*byte)))
        };
        let written = number(data.get(..8)).zip(number(data.get(22..26)));
        let read = (self.messages, u64::from(self.chunks));
        match written {
            Some(written) if written == read => Ok(()),
            Some((messages, chunks)) => Err(format!(
                "{} messages in {} chunks, where {messages} in {chunks} were written",
                read.0, read.1
            )),
            None => Err("a statistics record that is too short".into()),
        }
    }

    fn take(&mut self, kind: u8, data: &[u8]) -> std::result::Result<(), String> {
        if texts_fit(kind, data).is_none() {
            return Err("a record with a text that does not end within it".into());
        }
        let record = mcap::parse_record(kind, data);
        let record_bytes = data;
        match record.map_err(|e| format!("a record that cannot be read: {e}"))? {
            Record::Header(header) => self.profile = Some(header.profile),
            Record::Schema { header, .. } => {
                let size = header.name.len();
                let old = self.schemas.insert(header.id, header.name);
                self.hold(size, old.map_or(0, |name| name.len()))?;
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let (topic, encoding) = (channel.topic, channel.message_encoding);
                let size = |c: &ChannelInfo| c.topic.len() + c.encoding.len() + c.schema.len();
                let new = Arc::new(ChannelInfo { topic, encoding, schema });
                let more = size(&new);
                let old = self.channels.insert(channel.id, new);
                self.hold(more, old.map_or(0, |channel| size(&channel)))?;
            }
            Record::Message { header, data } => {
                let Some(channel) = self.channels.get(&header.channel_id) else {
                    return Err(format!("a message of the unknown channel {}", header.channel_id));
                };
                self.messages += 1;
                self.waiting.push_back(McapMessage {
                    channel: channel.clone(),
                    log_time: header.log_time,
                    data: data.into_owned(),
                });
            }
            Record::Metadata(metadata) => {
                self.hold(record_bytes.len(), 0)?;
                self.metadata.insert(metadata.name, metadata.metadata);
            }
            Record::Attachment { header, data, .. } if header.name == START_ATTACHMENT => {
                self.hold(record_bytes.len(), 0)?;
                self.attachments.insert(header.name, data.into_owned());
            }
            Record::Chunk { header, data } => {
                self.chunks += 1;
                let complete_chunks = self.waiting.len();
                // Without bytes after the data, which the format allows.
                let head = CHUNK_HEAD + header.compression.len();
                let chunk = &record_bytes[..head + data.len()];
                let result = self.chunk(header.uncompressed_size, chunk);
                if result.is_err() {
                    self.waiting.truncate(complete_chunks);
                }
                return result;
            }
            _ => {}
        }
        Ok(())
    }

    /// Counts `new` bytes of permanent memory that replace `old` ones.
    fn hold(&mut self, new: usize, old: usize) -> std::result::Result<(), String> {
        self.permanent_bytes = (self.permanent_bytes + new as u64).saturating_sub(old as u64);
        match self.permanent_bytes > MAX_CHUNK_BYTES {
            true => {
                Err(format!("more than {MAX_CHUNK_BYTES} bytes of names, metadata and attachments"))
            }
            false => Ok(()),
        }
    }

    /// Takes the records of a chunk; `unpacked_bytes` is the size that its header claims.
    fn chunk(&mut self, unpacked_bytes: u64, chunk: &[u8]) -> std::result::Result<(), String> {
        if unpacked_bytes > MAX_CHUNK_BYTES {
            return Err(format!("a chunk of {unpacked_bytes} bytes, more than {MAX_CHUNK_BYTES}"));
        }
        let mut message_bytes = 0;
        chunk::for_each_record(chunk, |kind, body| match kind {
            op::SCHEMA | op::CHANNEL => self.take(kind, body),
            op::MESSAGE => {
                // Empty messages take more memory here than in the chunk.
                message_bytes += (size_of::<McapMessage>() + body.len()) as u64;
                if message_bytes > MAX_CHUNK_BYTES {
                    return Err(format!(
                        "a chunk whose messages take more than {MAX_CHUNK_BYTES} bytes"
                    ));
                }
                self.take(kind, body)
            }
            PRIVATE_KINDS.. if self.may_have_private_records() => Ok(()),
            _ => Err(misplaced(kind)),
        })
    }

    /// True if private records may occur among the messages. Recordings of this crate have none.
    fn may_have_private_records(&self) -> bool {
        !self.metadata.contains_key(METADATA_NAME)
    }
}

fn misplaced(kind: u8) -> String {
    format!("a record of kind {kind:#04x} at a wrong place")
}

/// True if a record is an index of messages: a channel, a length in bytes, and that many bytes of times and offsets.
fn is_index(data: &[u8]) -> bool {
    let split = data.get(2..).and_then(|rest| rest.split_first_chunk());
    split.is_some_and(|(length, entries)| {
        u32::from_le_bytes(*length) as usize == entries.len() && entries.len().is_multiple_of(16)
    })
}

/// Returns `None` if a text of the record claims to be longer than the record. The library allocates the claimed length
/// before it compares, and expects the checksum of an attachment without a check.
fn texts_fit(kind: u8, data: &[u8]) -> Option<()> {
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
