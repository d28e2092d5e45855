//! The messages of any MCAP file, in the order of the file, whole or cut short.
//!
//! Cost: memory for one chunk, and as much for its messages. Contract: only messages of sound chunks are given; where
//! the file is cut short or damaged, reading ends, and [`Messages::lost`] says why. Nothing is passed over: a record
//! that is not known, or stands where none of its kind belongs, may have been messages. What the file says of its own
//! contents, checksum and numbers of messages and chunks, is compared with what was read.

use crate::chunk::{self, LARGEST};
use crate::error::{Error, Result};
use crate::meta;
use crate::recording::START;
use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most bytes that are asked of the system at once.
const BITE: usize = 1 << 20;

/// Where messages of one kind go.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    pub topic: String,
    /// `cdr`, `json` and others.
    pub encoding: String,
    /// Name of the type; empty without one.
    pub schema: String,
}

/// A message.
#[derive(Debug, Clone)]
pub struct Message {
    pub channel: Arc<Channel>,
    /// ns.
    pub log_time: u64,
    pub data: Vec<u8>,
}

/// The end of a file that is not as its beginning promised.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Lost {
    /// What was found instead of more.
    pub reason: String,
    /// The file only ends too early, as one does whose writer was killed: in a record, and without the mark that
    /// closes it. DefaultEndpoint it is damaged.
    pub is_cut: bool,
    /// Messages before it.
    pub kept: u64,
    /// Latest time among them, ns.
    pub last_ns: Option<u64>,
}

impl std::fmt::Display for Lost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { reason, kept, last_ns, .. } = self;
        let until = last_ns.map_or(String::new(), |t| format!(", up to {t} ns"));
        write!(f, "{reason}; {kept} messages before it can be used{until}")
    }
}

/// Reads a file message by message.
pub struct Messages {
    path: PathBuf,
    file: File,
    reader: LinearReader,
    content: Content,
    over: bool,
    kept: u64,
    last_ns: Option<u64>,
    lost: Option<Lost>,
}

/// What is known of the file so far.
#[derive(Default)]
struct Content {
    profile: Option<String>,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Arc<Channel>>,
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    attachments: BTreeMap<String, Vec<u8>>,
    /// Bytes of names, metadata and attachments: what stays in memory after the chunk at hand.
    held: u64,
    waiting: VecDeque<Message>,
    /// The end of the messages was seen.
    complete: bool,
    /// Kind of the last record outside of chunks; 0 before the first.
    last: u8,
    /// Messages and chunks so far.
    messages: u64,
    chunks: u32,
}

impl Messages {
    /// Opens a file.
    ///
    /// # Errors
    /// The system refuses; the file does not begin as an MCAP file does.
    pub fn open(path: &Path) -> Result<Self> {
        if path.metadata().is_ok_and(|what| !what.is_file()) {
            // A pipe would be waited for until somebody writes to it.
            return Err(Error::unsuitable(path, "recording", "a file", "a folder or a pipe"));
        }
        let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_emit_chunks(true)
            .with_validate_data_section_crc(true)
            .with_record_length_limit(LARGEST as usize);
        let mut messages = Self {
            path: path.into(),
            file,
            reader: LinearReader::new_with_options(options),
            content: Content::default(),
            over: false,
            kept: 0,
            last_ns: None,
            lost: None,
        };
        while messages.content.profile.is_none() && !messages.over {
            messages.read_on()?;
        }
        match messages.content.profile {
            Some(_) => Ok(messages),
            None => {
                let found = messages.lost.map_or("something else".into(), |lost| lost.reason);
                Err(Error::damaged(path, "start", "an MCAP file", found))
            }
        }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Named entries of the file, as far as it has been read.
    pub fn metadata(&self, name: &str) -> Option<&BTreeMap<String, String>> {
        self.content.metadata.get(name)
    }

    /// A named attachment, as far as the file has been read.
    pub fn attachment(&self, name: &str) -> Option<&[u8]> {
        self.content.attachments.get(name).map(|data| &data[..])
    }

    /// Why reading ended before the end of the recording, if it did.
    pub fn lost(&self) -> Option<&Lost> {
        self.lost.as_ref()
    }

    /// Reads up to the first message.
    ///
    /// # Errors
    /// The system refuses.
    pub fn read_to_first(&mut self) -> Result<()> {
        while self.content.waiting.is_empty() && !self.over {
            self.read_on()?;
        }
        Ok(())
    }

    /// The next message; `None` at the end, or where the file is lost.
    ///
    /// # Errors
    /// The system refuses.
    #[allow(clippy::should_implement_trait)]
    pub fn next(&mut self) -> Result<Option<Message>> {
        self.read_to_first()?;
        let message = self.content.waiting.pop_front();
        if let Some(message) = &message {
            self.kept += 1;
            self.last_ns = self.last_ns.max(Some(message.log_time));
        }
        // The file may have ended while messages were waiting: what was kept is known now.
        if let Some(lost) = &mut self.lost {
            (lost.kept, lost.last_ns) = (self.kept, self.last_ns);
        }
        Ok(message)
    }

    /// Reads a bit further: some bytes, or a record.
    fn read_on(&mut self) -> Result<()> {
        let ended = match self.reader.next_event() {
            Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                let bytes = self.reader.insert(wanted.min(BITE));
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
            // All messages are there: what follows is for those who look for single ones.
            _ if self.content.complete => None,
            Some(Err(mcap::McapError::UnexpectedEof)) if is_closed(&mut self.file) => {
                Some(("a record that claims to go on behind the end of the file".into(), false))
            }
            Some(Err(error)) => {
                Some((reason(&error), matches!(error, mcap::McapError::UnexpectedEof)))
            }
            None => Some(("the file ends without the end of a recording".into(), true)),
        };
        self.over = true;
        let (kept, last_ns) = (self.kept, self.last_ns);
        self.lost = ended.map(|(reason, is_cut)| Lost { reason, is_cut, kept, last_ns });
        Ok(())
    }
}

/// Whether a file has the mark that closes it.
fn is_closed(file: &mut File) -> bool {
    let mut end = [0; mcap::MAGIC.len()];
    let back = -(end.len() as i64);
    let read = file.seek(SeekFrom::End(back)).and_then(|_| file.read_exact(&mut end));
    read.is_ok() && end == *mcap::MAGIC
}

/// What may follow the end of the messages.
const BEHIND: [u8; 8] = [
    op::SCHEMA,
    op::CHANNEL,
    op::STATISTICS,
    op::CHUNK_INDEX,
    op::ATTACHMENT_INDEX,
    op::METADATA_INDEX,
    op::SUMMARY_OFFSET,
    op::FOOTER,
];
/// Kinds from here on are for anyone to define.
const PRIVATE: u8 = 0x80;

/// An error of the file's frame, in words.
fn reason(error: &mcap::McapError) -> String {
    match error {
        mcap::McapError::UnexpectedEof => "the file ends within a record".into(),
        mcap::McapError::BadMagic => "other bytes than those of MCAP".into(),
        mcap::McapError::BadDataCrc { .. } => {
            "other bytes than were written: their checksum does not fit".into()
        }
        other => format!("a record that cannot be read: {other}"),
    }
}

impl Content {
    /// Takes a record of the file, if it stands where it belongs.
    fn record(&mut self, kind: u8, data: &[u8]) -> std::result::Result<(), String> {
        let before = std::mem::replace(&mut self.last, kind);
        let belongs = match kind {
            op::HEADER => before == 0,
            op::SCHEMA | op::CHANNEL => true,
            op::MESSAGE | op::CHUNK | op::ATTACHMENT | op::METADATA | op::DATA_END => {
                !self.complete
            }
            // Without its chunk it is all that is left of it.
            op::MESSAGE_INDEX => !self.complete && [op::CHUNK, kind].contains(&before),
            _ if BEHIND.contains(&kind) => self.complete,
            PRIVATE.. => self.complete || self.takes_private(),
            _ => self.complete,
        };
        if !belongs {
            return Err(stray(kind));
        }
        match kind {
            op::DATA_END => self.complete = true,
            op::STATISTICS => self.compare(data)?,
            op::MESSAGE_INDEX if !is_index(data) => {
                return Err("a record that is no index of messages".into());
            }
            op::HEADER | op::SCHEMA | op::CHANNEL | op::MESSAGE | op::METADATA | op::CHUNK
                if !self.complete =>
            {
                self.take(kind, data)?;
            }
            // Others may be large, and are nobody's here.
            op::ATTACHMENT if self.attachments.is_empty() => self.take(kind, data)?,
            _ => {}
        }
        Ok(())
    }

    /// Compares what was read with what the file says that there is.
    fn compare(&self, data: &[u8]) -> std::result::Result<(), String> {
        // Read by hand: what follows the numbers is a map, which may claim to be of any size.
        let number = |bytes: Option<&[u8]>| {
            bytes.map(|b| b.iter().rev().fold(0, |n, byte| n << 8 | u64::from(*byte)))
        };
        let told = number(data.get(..8)).zip(number(data.get(22..26)));
        let read = (self.messages, u64::from(self.chunks));
        match told {
            Some(told) if told == read => Ok(()),
            Some((messages, chunks)) => Err(format!(
                "{} messages in {} chunks, where {messages} in {chunks} were written",
                read.0, read.1
            )),
            None => Err("a record of numbers that does not hold them".into()),
        }
    }

    fn take(&mut self, kind: u8, data: &[u8]) -> std::result::Result<(), String> {
        if texts_fit(kind, data).is_none() {
            return Err("a record with a text that does not end within it".into());
        }
        let (kept, record) = (data, mcap::parse_record(kind, data));
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
                let size = |c: &Channel| c.topic.len() + c.encoding.len() + c.schema.len();
                let new = Arc::new(Channel { topic, encoding, schema });
                let more = size(&new);
                let old = self.channels.insert(channel.id, new);
                self.hold(more, old.map_or(0, |channel| size(&channel)))?;
            }
            Record::Message { header, data } => {
                let Some(channel) = self.channels.get(&header.channel_id) else {
                    return Err(format!("a message of the unknown channel {}", header.channel_id));
                };
                self.messages += 1;
                self.waiting.push_back(Message {
                    channel: channel.clone(),
                    log_time: header.log_time,
                    data: data.into_owned(),
                });
            }
            Record::Metadata(metadata) => {
                self.hold(kept.len(), 0)?;
                self.metadata.insert(metadata.name, metadata.metadata);
            }
            Record::Attachment { header, data, .. } if header.name == START => {
                self.hold(kept.len(), 0)?;
                self.attachments.insert(header.name, data.into_owned());
            }
            Record::Chunk { header, data } => {
                self.chunks += 1;
                let whole = self.waiting.len();
                let taken = self.chunk(&header, &data);
                if taken.is_err() {
                    self.waiting.truncate(whole);
                }
                return taken;
            }
            _ => {}
        }
        Ok(())
    }

    /// Notes that `new` bytes have taken the place of `old` ones.
    fn hold(&mut self, new: usize, old: usize) -> std::result::Result<(), String> {
        self.held = (self.held + new as u64).saturating_sub(old as u64);
        match self.held > LARGEST {
            true => Err(format!("more than {LARGEST} bytes of names, metadata and attachments")),
            false => Ok(()),
        }
    }

    fn chunk(
        &mut self,
        header: &mcap::records::ChunkHeader,
        data: &[u8],
    ) -> std::result::Result<(), String> {
        let content = chunk::unpack(header, data)?;
        let mut taken = 0;
        for record in chunk::records(&content) {
            let (kind, body) = record?;
            match kind {
                op::SCHEMA | op::CHANNEL => self.take(kind, body)?,
                op::MESSAGE => {
                    // Empty ones take more here than in the chunk.
                    taken += (size_of::<Message>() + body.len()) as u64;
                    if taken > LARGEST {
                        return Err(format!(
                            "a chunk whose messages take more than {LARGEST} bytes"
                        ));
                    }
                    self.take(kind, body)?;
                }
                PRIVATE.. if self.takes_private() => {}
                _ => return Err(stray(kind)),
            }
        }
        Ok(())
    }

    /// Whether records of a kind that is for anyone to define may stand among the messages: we write none.
    fn takes_private(&self) -> bool {
        !self.metadata.contains_key(meta::NAME)
    }
}

fn stray(kind: u8) -> String {
    format!("a record of kind {kind:#04x} where none belongs")
}

/// Whether a record is an index of messages: a channel, a length in bytes, and that many bytes of times and places.
fn is_index(data: &[u8]) -> bool {
    let split = data.get(2..).and_then(|rest| rest.split_first_chunk());
    split.is_some_and(|(length, entries)| {
        u32::from_le_bytes(*length) as usize == entries.len() && entries.len().is_multiple_of(16)
    })
}

/// `None` if a text of the record claims to go on behind it: the library makes room for what is claimed before it
/// looks what is there, and takes the checksum of an attachment for granted.
fn texts_fit(kind: u8, data: &[u8]) -> Option<()> {
    // Bytes before the texts, their number, whether a map follows, and the bytes that there must be in the end.
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
        rest = behind_text(rest)?;
    }
    if has_map {
        let (length, entries) = rest.split_first_chunk()?;
        let end = entries.len().checked_sub(u32::from_le_bytes(*length) as usize)?;
        rest = entries;
        while rest.len() > end {
            rest = behind_text(behind_text(rest)?)?;
        }
    }
    (rest.len() >= after).then_some(())
}

/// What follows a text: its length in four bytes, and as many bytes.
fn behind_text(bytes: &[u8]) -> Option<&[u8]> {
    let (length, rest) = bytes.split_first_chunk()?;
    rest.get(u32::from_le_bytes(*length) as usize..)
}
