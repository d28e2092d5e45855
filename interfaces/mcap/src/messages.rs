//! Reader of the messages of any MCAP file, complete or truncated, in the order of the file.
//!
//! Cost: memory for one chunk, and as much for its messages. Contract: only messages of valid chunks are returned. At a
//! truncated or damaged place reading ends, and [`MessageReader::truncation`] has the reason. Unknown records, and records
//! at a wrong place, are errors, because they may have been messages. The file's checksum and its numbers of messages and
//! chunks are compared with those that were read. Long records that are not needed are skipped without reading them; the
//! checksum of their file is not compared.

use crate::chunk::{self, MAX_CHUNK_BYTES, MAX_READ_BYTES};
use crate::error::{Error, Result};
use crate::metadata::{METADATA_NAME, START_ATTACHMENT};
use crate::other_format::{describe_file, describe_folder};
use crate::record::{RecordHead, is_index, texts_fit};
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
    /// True if the next byte of the file is the first of a record.
    is_at_head: bool,
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
    /// Metadata of a recording of Ballast.
    metadata: Option<BTreeMap<String, String>>,
    /// Checkpoint at which a recording of Ballast starts.
    start: Option<Vec<u8>>,
    /// Memory of names, metadata and checkpoint, which outlive a chunk, bytes.
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
            return Err(Error::unsuitable(path, "recording", "a file", describe_folder(path)));
        }
        let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
        let mut start = Vec::new();
        let read = (&file).take(mcap::MAGIC.len() as u64).read_to_end(&mut start);
        read.map_err(|e| Error::io(path, "read", e))?;
        if let Some(other) = describe_file(&start) {
            return Err(Error::damaged(path, "start", "an MCAP file", other));
        }
        let mut messages = Self {
            path: path.into(),
            file,
            reader: record_reader(true),
            is_at_head: true,
            content: ReaderState::default(),
            finished: false,
            returned: 0,
            last_ns: None,
            truncation: None,
        };
        messages.insert(&start);
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

    /// Returns the metadata of a recording of Ballast, if the part that has been read has them.
    pub(crate) fn metadata(&self) -> Option<&BTreeMap<String, String>> {
        self.content.metadata.as_ref()
    }

    /// Returns the checkpoint at which a recording of Ballast starts, if the part that has been read has one.
    pub(crate) fn start(&self) -> Option<&[u8]> {
        self.content.start.as_deref()
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
                let read = self.fill(wanted).map_err(|e| Error::io(&self.path, "read", e))?;
                match read {
                    true => return Ok(()),
                    false => Some(inner_end(&mut self.file)),
                }
            }
            Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                self.is_at_head = true;
                match self.content.record(opcode, data) {
                    Ok(()) if opcode != op::FOOTER => return Ok(()),
                    Ok(()) => None,
                    Err(reason) => Some((reason, false)),
                }
            }
            // All messages have been read; the summary serves random access only.
            _ if self.content.complete => None,
            Some(Err(mcap::McapError::UnexpectedEof)) => Some(inner_end(&mut self.file)),
            Some(Err(error)) => Some((reason(&error), false)),
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

    /// Reads some of the `wanted` bytes, or skips a long record that is not needed. Returns false if such a record is longer
    /// than the file.
    fn fill(&mut self, wanted: usize) -> std::io::Result<bool> {
        if !std::mem::take(&mut self.is_at_head) {
            let bytes = self.reader.insert(wanted.min(MAX_READ_BYTES));
            let read = self.file.read(bytes)?;
            self.reader.notify_read(read);
            return Ok(true);
        }
        let head = RecordHead::read(&self.file)?;
        if !head.is_long() || !self.content.skip(&head) {
            self.insert(&head.bytes);
            return Ok(true);
        }
        let end = self.file.stream_position()?.checked_add(head.rest());
        let Some(end) = end.filter(|end| self.file.metadata().is_ok_and(|file| *end <= file.len()))
        else {
            return Ok(false);
        };
        self.file.seek(SeekFrom::Start(end))?;
        self.reader = record_reader(false);
        self.is_at_head = true;
        Ok(true)
    }

    /// Gives bytes of the file to the reader of records; none are the end of the file.
    fn insert(&mut self, bytes: &[u8]) {
        self.reader.insert(bytes.len()).copy_from_slice(bytes);
        self.reader.notify_read(bytes.len());
    }
}

/// Creates a reader of records: of a whole file, whose checksum is compared, or from a record on.
fn record_reader(is_whole: bool) -> LinearReader {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(!is_whole)
        .with_skip_end_magic(true)
        .with_emit_chunks(true)
        .with_validate_data_section_crc(is_whole)
        .with_record_length_limit(MAX_CHUNK_BYTES as usize);
    LinearReader::new_with_options(options)
}

/// Returns the reason of an end within a record, and true if the file was cut: a file with an end mark was not.
fn inner_end(file: &mut File) -> (String, bool) {
    let mut end = [0; mcap::MAGIC.len()];
    let back = -(end.len() as i64);
    let read = file.seek(SeekFrom::End(back)).and_then(|_| file.read_exact(&mut end));
    match read.is_ok() && end == *mcap::MAGIC {
        true => ("record length exceeds the file size".into(), false),
        false => ("the file ends within a record".into(), true),
    }
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
        mcap::McapError::BadMagic => "bytes that are not MCAP".into(),
        mcap::McapError::BadDataCrc { .. } => "bytes that do not match their checksum".into(),
        other => format!("a record that cannot be read: {other}"),
    }
}

impl ReaderState {
    /// Returns true, and counts the record, if the content of a long record is not needed: it is that of another program,
    /// or a message that is longer than any pose.
    fn skip(&mut self, head: &RecordHead) -> bool {
        let (is_open, is_foreign) = (!self.complete, self.may_have_private_records());
        let is_message = head.kind() == op::MESSAGE;
        let may_skip = match head.kind() {
            // Two times precede the name.
            op::ATTACHMENT => is_open && !head.is_named(16, START_ATTACHMENT),
            op::METADATA => is_open && !head.is_named(0, METADATA_NAME),
            op::MESSAGE => is_open && is_foreign && head.length() > MAX_CHUNK_BYTES,
            PRIVATE_KINDS.. => self.complete || is_foreign,
            _ => false,
        };
        if may_skip {
            self.last = head.kind();
            self.messages += u64::from(is_message);
        }
        may_skip
    }

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
            op::ATTACHMENT if self.start.is_none() => self.take(kind, data)?,
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
            Record::Metadata(metadata) if metadata.name == METADATA_NAME => {
                self.hold(record_bytes.len(), 0)?;
                self.metadata = Some(metadata.metadata);
            }
            Record::Attachment { header, data, .. } if header.name == START_ATTACHMENT => {
                self.hold(record_bytes.len(), 0)?;
                self.start = Some(data.into_owned());
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
        self.metadata.is_none()
    }
}

fn misplaced(kind: u8) -> String {
    format!("a record of kind {kind:#04x} at a wrong place")
}
