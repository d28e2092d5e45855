//! Chunks: unpacked whole, checked, and walked record by record.
//!
//! Contract: a chunk that lies about its size, its sum or its records is refused; what it may unpack to is
//! limited before anything is unpacked.

use mcap::records::ChunkHeader;
use std::borrow::Cow;
use std::io::Read;

/// Most bytes that a chunk or a record may hold.
pub(crate) const LARGEST: u64 = 256 << 20;

/// The records of a chunk, as bytes.
pub(crate) fn unpack<'a>(header: &ChunkHeader, data: &'a [u8]) -> Result<Cow<'a, [u8]>, String> {
    if header.uncompressed_size > LARGEST {
        return Err(format!("a chunk of {} bytes, more than {LARGEST}", header.uncompressed_size));
    }
    let size = header.uncompressed_size;
    let content = match &header.compression[..] {
        "" => Cow::Borrowed(data),
        "zstd" => {
            let decoder = zstd::stream::read::Decoder::new(data).map_err(|e| e.to_string())?;
            Cow::Owned(read(decoder, size)?)
        }
        "lz4" => {
            let decoder = lz4::Decoder::new(data).map_err(|e| e.to_string())?;
            Cow::Owned(read(decoder, size)?)
        }
        other => {
            let expected = "\"\", \"zstd\" or \"lz4\"";
            return Err(format!("how a chunk is packed: expected {expected}, found {other:?}"));
        }
    };
    if content.len() as u64 != size {
        return Err(format!("a chunk of {} bytes that claims {size}", content.len()));
    }
    let sum = header.uncompressed_crc;
    // Without one there is nothing to compare.
    let found = if sum == 0 { 0 } else { crc32fast::hash(&content) };
    if found != sum {
        return Err(format!("checksum of a chunk: expected {sum:08x}, found {found:08x}"));
    }
    Ok(content)
}

/// At most `size` bytes; one more is read to notice that there are more.
fn read(decoder: impl Read, size: u64) -> Result<Vec<u8>, String> {
    let mut content = Vec::new();
    let mut limited = decoder.take(size + 1);
    limited
        .read_to_end(&mut content)
        .map_err(|e| format!("a chunk that cannot be unpacked: {e}"))?;
    Ok(content)
}

/// Kind and content of each record.
pub(crate) fn records(mut content: &[u8]) -> impl Iterator<Item = Result<(u8, &[u8]), String>> {
    std::iter::from_fn(move || {
        if content.is_empty() {
            return None;
        }
        let Some((head, rest)) = content.split_first_chunk::<9>() else {
            content = &[];
            return Some(Err("a chunk that ends within a record".into()));
        };
        let mut length = [0; 8];
        length.copy_from_slice(&head[1..]);
        let length = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX);
        let Some((body, rest)) = rest.split_at_checked(length) else {
            content = &[];
            return Some(Err("a chunk that ends within a record".into()));
        };
        content = rest;
        Some(Ok((head[0], body)))
    })
}
