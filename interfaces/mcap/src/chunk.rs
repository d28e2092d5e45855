//! Records inside a chunk.
//!
//! Contract: no record is passed on before the checksum of its chunk has been compared. The memory for a chunk is limited
//! before it is unpacked.

use mcap::records::op;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::io::Read;

/// Maximum size of a chunk or record, packed and unpacked, bytes.
pub(crate) const MAX_CHUNK_BYTES: u64 = 256 << 20;

/// Maximum number of bytes of one read.
pub(crate) const MAX_READ_BYTES: usize = 1 << 20;

/// Calls `take` with kind and content of each record in the chunk record `chunk`, which must have no bytes after its data.
pub(crate) fn for_each_record(
    chunk: &[u8],
    mut take: impl FnMut(u8, &[u8]) -> Result<(), String>,
) -> Result<(), String> {
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true)
        .with_prevalidate_chunk_crcs(true)
        .with_record_length_limit(MAX_CHUNK_BYTES as usize);
    let mut reader = LinearReader::new_with_options(options);
    let length = (chunk.len() as u64).to_le_bytes();
    let mut source = (&[op::CHUNK][..]).chain(&length[..]).chain(chunk);
    while let Some(event) = reader.next_event() {
        match event.map_err(|e| format!("a chunk that cannot be unpacked: {e}"))? {
            LinearReadEvent::ReadRequest(wanted) => {
                let buffer = reader.insert(wanted.min(MAX_READ_BYTES));
                let read = source.read(buffer).map_err(|e| e.to_string())?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { data, opcode } => take(opcode, data)?,
        }
    }
    Ok(())
}
