//! The file: chunks, channels, definitions.
//!
//! Contract: what is written depends on the entries alone; no clock is read. Chunks are small and go to
//! the system whole, so that a killed program leaves a readable file.

use crate::entry::Entry;
use crate::error::{Error, Result};
use crate::meta::{self, Meta};
use crate::window::STATIC;
use mcap::Attachment;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Bytes of messages after which a chunk is closed: what a killed run may lose, at most.
const CHUNK: usize = 64 << 10;

/// What makes rosbag2 give a message to those who come late: durability 1, transient local.
const LATCHED: &str = "- history: 3
  depth: 0
  reliability: 1
  durability: 1
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: 1
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
";

type Sink = NoSeek<BufWriter<File>>;

/// A recording that is being written.
pub struct Writer {
    path: PathBuf,
    inner: mcap::Writer<Sink>,
    channels: BTreeMap<String, Channel>,
    /// Bytes since the last chunk was closed.
    waiting: usize,
}

struct Channel {
    id: u16,
    kind: &'static str,
    sequence: u32,
}

impl Writer {
    /// Starts a file; what was there is replaced. Without `meta` it is a recording of no run of ours.
    ///
    /// # Errors
    /// The system refuses.
    pub fn create(path: &Path, meta: Option<&Meta>) -> Result<Self> {
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
            // Workers would make the bytes depend on the machine.
            .compression_threads(0)
            .chunk_size(None)
            // A chunk is put together in memory: never half of one on the disk.
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::new(file)))
            .map_err(|e| failed(path, e))?;
        let mut writer = Self { path: path.into(), inner, channels: BTreeMap::new(), waiting: 0 };
        if let Some(meta) = meta {
            let record = Metadata { name: meta::NAME.into(), metadata: meta.entries() };
            writer.inner.write_metadata(&record).map_err(|e| failed(path, e))?;
            writer.inner.flush().map_err(|e| failed(path, e))?;
        }
        Ok(writer)
    }

    /// Appends a file under a name.
    ///
    /// # Errors
    /// The system refuses.
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
    /// The system refuses; a topic that has another type already.
    pub fn write(&mut self, entry: &Entry) -> Result<()> {
        let id = self.channel(entry)?;
        let Some(channel) = self.channels.get_mut(&entry.topic) else { return Ok(()) };
        let header = MessageHeader {
            channel_id: id,
            sequence: channel.sequence,
            log_time: entry.time_ns,
            publish_time: entry.time_ns,
        };
        channel.sequence = channel.sequence.wrapping_add(1);
        self.inner
            .write_to_known_channel(&header, &entry.bytes)
            .map_err(|e| failed(&self.path, e))?;
        self.waiting += entry.bytes.len();
        if self.waiting >= CHUNK {
            self.waiting = 0;
            self.inner.flush().map_err(|e| failed(&self.path, e))?;
        }
        Ok(())
    }

    /// Number of the entry's channel, which is declared if it is new.
    fn channel(&mut self, entry: &Entry) -> Result<u16> {
        if let Some(known) = self.channels.get(&entry.topic) {
            if known.kind == entry.kind {
                return Ok(known.id);
            }
            return Err(Error::unsuitable(&self.path, &entry.topic, known.kind, entry.kind));
        }
        let schema = self.inner.add_schema(entry.kind, "ros2msg", (entry.schema)().as_bytes());
        let schema = schema.map_err(|e| failed(&self.path, e))?;
        let metadata = match entry.topic == STATIC {
            true => BTreeMap::from([("offered_qos_profiles".to_string(), LATCHED.to_string())]),
            false => BTreeMap::new(),
        };
        let id = self.inner.add_channel(schema, &entry.topic, "cdr", &metadata);
        let id = id.map_err(|e| failed(&self.path, e))?;
        self.channels.insert(entry.topic.clone(), Channel { id, kind: entry.kind, sequence: 0 });
        Ok(id)
    }

    /// Writes index and end, and brings the file to the disk.
    ///
    /// # Errors
    /// The system refuses; the file was removed or replaced meanwhile.
    pub fn finish(mut self) -> Result<()> {
        self.inner.finish().map_err(|e| failed(&self.path, e))?;
        let mut sink = self.inner.into_inner().into_inner();
        sink.flush().map_err(|e| Error::io(&self.path, "write", e))?;
        let file = sink.get_ref();
        file.sync_all().map_err(|e| Error::io(&self.path, "bring to the disk", e))?;
        // A file that was removed takes all that is written to it, and is gone when it is closed.
        if !is_at(file, &self.path).map_err(|e| Error::io(&self.path, "look at", e))? {
            let (expected, found) =
                ("the file that was begun", "that another file, or none, lies there now");
            return Err(Error::unsuitable(&self.path, "recording", expected, found));
        }
        Ok(())
    }
}

/// Whether an open file is the one that lies at `path`.
fn is_at(file: &File, path: &Path) -> std::io::Result<bool> {
    match path.metadata() {
        Ok(there) => Ok(is_one(&file.metadata()?, &there)),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => Ok(false),
        Err(e) => Err(e),
    }
}

#[cfg(unix)]
fn is_one(a: &std::fs::Metadata, b: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

/// An open file cannot be removed there.
#[cfg(not(unix))]
fn is_one(_: &std::fs::Metadata, _: &std::fs::Metadata) -> bool {
    true
}

fn failed(path: &Path, error: mcap::McapError) -> Error {
    let source = match error {
        mcap::McapError::Io(source) => source,
        other => std::io::Error::other(other),
    };
    Error::io(path, "write", source)
}
