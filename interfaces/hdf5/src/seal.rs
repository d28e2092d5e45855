//! Whole files, sealed so that any changed byte is noticed.
//!
//! A sealed file has a block of 512 bytes in front of its content, mostly an HDF5 file: the format's name and
//! version, the number of bytes that follow and their BLAKE3 digest, as text. HDF5 programs skip it. A file that grows in
//! place has such a block at its end, once it is complete ([`put_at_end`]); HDF5 programs do not look behind theirs.
//! Contract: the digest is checked before the HDF5 library sees a byte, which it does not survive
//! unharmed on every damaged file.

use crate::error::{Error, Fault, Result, io};
use crate::replace::replace;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Smallest user block that HDF5 allows.
const BLOCK: usize = 512;

pub(crate) struct Format {
    pub name: &'static str,
    pub version: u32,
}

fn block(format: &Format, bytes: u64, digest: &blake3::Hash) -> [u8; BLOCK] {
    let text =
        format!("{} {}\nbytes {bytes}\nblake3 {}\n", format.name, format.version, digest.to_hex());
    let mut block = [b'\n'; BLOCK];
    block[..text.len()].copy_from_slice(text.as_bytes());
    block
}

/// The block of what `reader` has left, `bytes` long; memory does not depend on that.
fn block_of(
    mut reader: impl Read,
    bytes: u64,
    format: &Format,
    path: &Path,
) -> Result<[u8; BLOCK]> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(&mut reader).map_err(io(path, "read"))?;
    Ok(block(format, bytes, &hasher.finalize()))
}

/// Replaces `path` by a sealed file with this content.
pub(crate) fn write(path: &Path, format: &Format, image: &[u8]) -> Result<()> {
    replace(path, &[&header(format, image), image])
}

/// A sealed file with this content, as bytes.
pub(crate) fn bytes(format: &Format, image: &[u8]) -> Vec<u8> {
    [&header(format, image)[..], image].concat()
}

fn header(format: &Format, image: &[u8]) -> [u8; BLOCK] {
    block(format, image.len() as u64, &blake3::hash(image))
}

/// Opens a file to be read. Anything else is refused: a pipe would be waited for until somebody writes to it.
fn open(path: &Path) -> Result<File> {
    if path.metadata().is_ok_and(|what| !what.is_file()) {
        return Err(Fault::new("path", "a file", "a folder or a pipe").in_file(path));
    }
    File::open(path).map_err(io(path, "open"))
}

/// Checks the seal of `path`; returns the size of the file.
///
/// Streams: memory does not depend on what the file claims.
pub(crate) fn check(path: &Path, format: &Format) -> Result<u64> {
    let mut file = open(path)?;
    let size = file.metadata().map_err(io(path, "read"))?.len();
    let mut found = Vec::with_capacity(BLOCK);
    Read::by_ref(&mut file).take(BLOCK as u64).read_to_end(&mut found).map_err(io(path, "read"))?;
    let claimed = claim(&found, format, path)?;
    let content = size.saturating_sub(BLOCK as u64);
    if claimed != content {
        return Err(
            Fault::new("size", format!("{claimed} bytes after the header"), content).in_file(path)
        );
    }
    compare(&found, &block_of(file, content, format, path)?, path)?;
    Ok(size)
}

/// The content of a sealed file, once the seal is checked.
pub(crate) fn read(path: &Path, format: &Format) -> Result<Vec<u8>> {
    check(path, format)?;
    let mut file = open(path)?;
    let mut content = vec![];
    let read =
        file.seek(SeekFrom::Start(BLOCK as u64)).and_then(|_| file.read_to_end(&mut content));
    read.map_err(io(path, "read"))?;
    Ok(content)
}

/// Seals a complete file at its end.
pub(crate) fn put_at_end(path: &Path, format: &Format) -> Result<()> {
    let mut file = File::options().read(true).append(true).open(path).map_err(io(path, "open"))?;
    let size = file.metadata().map_err(io(path, "read"))?.len();
    let seal = block_of(&file, size, format, path)?;
    file.write_all(&seal).map_err(io(path, "write"))?;
    file.sync_all().map_err(io(path, "bring to the disk"))
}

/// Checks the seal at the end of `path`, and whether it has one: a file that is being written, or whose writer was killed,
/// has none.
pub(crate) fn check_at_end(path: &Path, format: &Format) -> Result<bool> {
    let Some((mut file, size, found)) = end_of(path, format)? else { return Ok(false) };
    file.rewind().map_err(io(path, "read"))?;
    compare(&found, &block_of(file.take(size), size, format, path)?, path)?;
    Ok(true)
}

/// Takes the seal off the end of `path`, if it has one, for a file that is to grow.
pub(crate) fn take_from_end(path: &Path, format: &Format) -> Result<()> {
    let Some((_, size, _)) = end_of(path, format)? else { return Ok(()) };
    let file = File::options().write(true).open(path).map_err(io(path, "open"))?;
    file.set_len(size).map_err(io(path, "write"))
}

/// A file with a seal at its end, the size of what comes before, and the seal.
fn end_of(path: &Path, format: &Format) -> Result<Option<(File, u64, Vec<u8>)>> {
    let mut file = open(path)?;
    let size = file.metadata().map_err(io(path, "read"))?.len();
    let Some(size) = size.checked_sub(BLOCK as u64) else { return Ok(None) };
    let mut found = vec![];
    let read = file.seek(SeekFrom::Start(size)).and_then(|_| file.read_to_end(&mut found));
    read.map_err(io(path, "read"))?;
    let is_seal =
        found.starts_with(format!("{} {}\nbytes ", format.name, format.version).as_bytes());
    Ok(is_seal.then_some((file, size, found)))
}

/// Compares two blocks of the same format.
fn compare(found: &[u8], expected: &[u8], path: &Path) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    let digest = |b: &[u8]| String::from_utf8_lossy(b).lines().nth(2).map(str::to_string);
    let [found, expected] = [found, expected].map(|block| digest(block).unwrap_or_default());
    // What the file says of itself is what its content is expected to be.
    Err(Fault::new("checksum", found, expected).in_file(path))
}

/// How many bytes a header says that follow it.
fn claim(header: &[u8], format: &Format, path: &Path) -> Result<u64> {
    let first = format!("{} {}", format.name, format.version);
    let text = String::from_utf8_lossy(header);
    let mut lines = text.lines();
    let line = lines.next().unwrap_or_default();
    let Some(version) = line.strip_prefix(format.name).filter(|v| v.starts_with(' ')) else {
        return Err(Fault::new("header", first, describe(header)).in_file(path));
    };
    if version.trim() != format.version.to_string() {
        let found = line.chars().take(80).collect();
        return Err(Error::Version { path: path.into(), expected: first, found });
    }
    if header.len() < BLOCK {
        let found = format!("{} bytes", header.len());
        return Err(Fault::new("header", format!("{BLOCK} bytes"), found).in_file(path));
    }
    let size = lines.next().and_then(|l| l.strip_prefix("bytes ")).and_then(|n| n.parse().ok());
    size.ok_or_else(|| Fault::new("header", "a size in bytes", describe(header)).in_file(path))
}

/// What a file that is not ours looks like, in words.
fn describe(header: &[u8]) -> String {
    match header {
        [] => "an empty file".into(),
        _ if header.starts_with(HDF5) => "an HDF5 file without our header".into(),
        _ => match std::str::from_utf8(&header[..header.len().min(32)]) {
            Ok(text) => format!("{text:?}"),
            Err(_) => "bytes of another kind of file".into(),
        },
    }
}

/// How files of HDF5 begin.
const HDF5: &[u8] = b"\x89HDF";

/// Whether a file begins as those of HDF5.
pub(crate) fn is_hdf5(path: &Path) -> Result<bool> {
    Ok(start_of(path)?.starts_with(HDF5))
}

/// The first bytes of a file.
pub(crate) fn start_of(path: &Path) -> Result<Vec<u8>> {
    let file = open(path)?;
    let mut start = vec![];
    file.take(64).read_to_end(&mut start).map_err(io(path, "read"))?;
    Ok(start)
}

/// Writes a fresh header on a file whose content was edited on purpose by another program.
pub(crate) fn reseal(path: &Path, format: &Format) -> Result<()> {
    let mut file = File::options().read(true).write(true).open(path).map_err(io(path, "open"))?;
    file.seek(SeekFrom::Start(BLOCK as u64)).map_err(io(path, "read"))?;
    let size = file.metadata().map_err(io(path, "read"))?.len();
    let header = block_of(&file, size.saturating_sub(BLOCK as u64), format, path)?;
    file.rewind().and_then(|()| file.write_all(&header)).map_err(io(path, "write"))
}
