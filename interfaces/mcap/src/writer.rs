//! Writer of MCAP files: chunks, channels, type definitions.
//!
//! Contract: the bytes depend on the messages alone; no clock is read. Chunks are small and written at once, so that a
//! crash leaves a readable file.

use crate::error::{Error, Result};
use crate::metadata::{METADATA_NAME, RecordingMetadata};
use ballast_protocol::TopicMessage;
use ballast_protocol::topics::STATIC;
use mcap::Attachment;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Size of messages after which a chunk is written, bytes: the maximum that a crash may lose.
const CHUNK_BYTES: usize = 64 << 10;

/// QoS profile with which rosbag2 also sends messages to late subscribers: durability 1, transient local.
const LATCHED_QOS: &str = "- history: 3
  depth: 0
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
";

type McapSink = NoSeek<BufWriter<File>>;

/// Writer of an MCAP file.
pub struct McapWriter {
    path: PathBuf,
    inner: mcap::Writer<McapSink>,
    channels: BTreeMap<String, WriterChannel>,
    /// Size of messages since the last chunk, bytes.
    pending_bytes: usize,
}

struct WriterChannel {
    id: u16,
    kind: &'static str,
    sequence: u32,
}

impl McapWriter {
    /// Creates or replaces a file. Without `meta` it is not a recording of windows.
    ///
    /// # Errors
    /// A file that cannot be written, or that another process writes.
    pub fn create(path: &Path, meta: Option<&RecordingMetadata>) -> Result<Self> {
        let file = File::options().create(true).truncate(false).write(true).open(path);
        let file = file.map_err(|e| Error::io(path, "create", e))?;
        if let Err(TryLockError::WouldBlock) = file.try_lock() {
            let (expected, found) = ("a file that no other process writes", "one in use");
            return Err(Error::unsuitable(path, "recording", expected, found));
        }
        file.set_len(0).map_err(|e| Error::io(path, "empty", e))?;
        let inner = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("ballast ", env!("CARGO_PKG_VERSION")))
            .compression(Some(mcap::Compression::Zstd))
            // Worker threads would make the bytes depend on the machine.
            .compression_threads(0)
            .chunk_size(None)
            // Chunks are assembled in memory, so that no partial chunk is on the disk.
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::new(file)))
            .map_err(|e| failed(path, e))?;
        let mut writer =
            Self { path: path.into(), inner, channels: BTreeMap::new(), pending_bytes: 0 };
        if let Some(meta) = meta {
            let record = Metadata { name: METADATA_NAME.into(), metadata: meta.entries() };
            writer.inner.write_metadata(&record).map_err(|e| failed(path, e))?;
            writer.inner.flush().map_err(|e| failed(path, e))?;
        }
        Ok(writer)
    }

    /// Appends an attachment.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn attach(&mut self, name: &str, time_ns: u64, data: &[u8]) -> Result<()> {
        let attachment = Attachment {
            log_time: time_ns,
            create_time: time_ns,
            name: name.into(),
            media_type: "application/x-hdf5".into(),
            data: data.into(),
        };
        self.inner.attach(&attachment).map_err(|e| failed(&self.path, e))?;
        self.inner.flush().map_err(|e| failed(&self.path, e))
    }

    /// Appends a message.
    ///
    /// # Errors
    /// A file that cannot be written; a topic that has another type already.
    pub fn write(&mut self, message: &TopicMessage) -> Result<()> {
        let id = self.channel(message)?;
        let Some(channel) = self.channels.get_mut(&message.topic) else { return Ok(()) };
        let header = MessageHeader {
            channel_id: id,
            sequence: channel.sequence,
            log_time: message.time_ns,
            publish_time: message.time_ns,
        };
        channel.sequence = channel.sequence.wrapping_add(1);
        self.inner
            .write_to_known_channel(&header, &message.bytes)
            .map_err(|e| failed(&self.path, e))?;
        self.pending_bytes += message.bytes.len();
        if self.pending_bytes >= CHUNK_BYTES {
            self.pending_bytes = 0;
            self.inner.flush().map_err(|e| failed(&self.path, e))?;
        }
        Ok(())
    }

    /// Returns the number of the message's channel, which is declared if it is new.
    fn channel(&mut self, message: &TopicMessage) -> Result<u16> {
        if let Some(known) = self.channels.get(&message.topic) {
            if known.kind == message.kind {
                return Ok(known.id);
            }
            return Err(Error::unsuitable(&self.path, &message.topic, known.kind, message.kind));
        }
        let schema = self.inner.add_schema(message.kind, "ros2msg", (message.schema)().as_bytes());
        let schema = schema.map_err(|e| failed(&self.path, e))?;
        let metadata = match message.topic == STATIC {
            true => BTreeMap::from([("offered_qos_profiles".to_string(), LATCHED_QOS.to_string())]),
            false => BTreeMap::new(),
        };
        let id = self.inner.add_channel(schema, &message.topic, "cdr", &metadata);
        let id = id.map_err(|e| failed(&self.path, e))?;
        self.channels
            .insert(message.topic.clone(), WriterChannel { id, kind: message.kind, sequence: 0 });
        Ok(id)
    }

    /// Writes index and end mark, and synchronises the file with the disk.
    ///
    /// # Errors
    /// A file that cannot be written, or was removed or replaced since its creation.
    pub fn finish(mut self) -> Result<()> {
        self.inner.finish().map_err(|e| failed(&self.path, e))?;
        let mut sink = self.inner.into_inner().into_inner();
        sink.flush().map_err(|e| Error::io(&self.path, "write", e))?;
        let file = sink.get_ref();
        file.sync_all().map_err(|e| Error::io(&self.path, "synchronise", e))?;
        // Writing to a removed file succeeds, but the file is lost when it is closed.
        if !is_at(file, &self.path).map_err(|e| Error::io(&self.path, "inspect", e))? {
            let expected = "the file that was created";
            let found = "another file, or none, at this path";
            return Err(Error::unsuitable(&self.path, "recording", expected, found));
        }
        Ok(())
    }
}

/// True if the open file is the one at `path`.
fn is_at(file: &File, path: &Path) -> std::io::Result<bool> {
    match path.metadata() {
        Ok(there) => Ok(is_same_file(&file.metadata()?, &there)),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(false),
        Err(e) => Err(e),
    }
}

#[cfg(unix)]
fn is_same_file(a: &std::fs::Metadata, b: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

/// True, because an open file cannot be removed on this system.
#[cfg(not(unix))]
fn is_same_file(_: &std::fs::Metadata, _: &std::fs::Metadata) -> bool {
    true
}

fn failed(path: &Path, error: mcap::McapError) -> Error {
    let source = match error {
        mcap::McapError::Io(source) => source,
        other => std::io::Error::other(other),
    };
    Error::io(path, "write", source)
}
