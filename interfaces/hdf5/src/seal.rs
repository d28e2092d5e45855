//! Sealed files, in which any changed byte is detected.
//!
//! A sealed file has a block of 512 bytes in front of its content, mostly an HDF5 file: the format's name and
//! version, the number of bytes that follow and their BLAKE3 digest, as text. HDF5 programs skip it. A file that grows in
//! place has such a block at its end, once it is complete ([`put_at_end`]); HDF5 programs do not read beyond their end.
//! Contract: the digest is checked before the HDF5 library reads a byte, because the library may crash on a damaged file.

use crate::error::{Error, Fault, FaultInFile, Result, io};
use crate::replace::replace;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Size of the smallest user block of HDF5, bytes.
const BLOCK: usize = 512;

pub(crate) struct SealFormat {
    pub name: &'static str,
    pub version: u32,
}

fn block(format: &SealFormat, bytes: u64, digest: &blake3::Hash) -> [u8; BLOCK] {
    let text =
        format!("{} {}\nbytes {bytes}\nblake3 {}\n", format.name, format.version, digest.to_hex());
    let mut block = [b'\n'; BLOCK];
    block[..text.len()].copy_from_slice(text.as_bytes());
    block
}

/// Returns the seal of the remaining `bytes` of `reader`, in constant memory.
fn block_of(
    mut reader: impl Read,
    bytes: u64,
    format: &SealFormat,
    path: &Path,
) -> Result<[u8; BLOCK]> {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(&mut reader).map_err(io(path, "read"))?;
    Ok(block(format, bytes, &hasher.finalize()))
}

/// Replaces `path` by a sealed file with this content.
pub(crate) fn write(path: &Path, format: &SealFormat, image: &[u8]) -> Result<()> {
    replace(path, &[&header(format, image), image])
}

/// Returns a sealed file with this content as bytes.
pub(crate) fn bytes(format: &SealFormat, image: &[u8]) -> Vec<u8> {
    [&header(format, image)[..], image].concat()
}

fn header(format: &SealFormat, image: &[u8]) -> [u8; BLOCK] {
    block(format, image.len() as u64, &blake3::hash(image))
}

/// Opens a file for reading; refuses a pipe, which would block until a writer opens it.
fn open(path: &Path) -> Result<File> {
    if path.metadata().is_ok_and(|what| !what.is_file()) {
        return Err(Fault::new("path", "a file", "a folder or a pipe").in_file(path));
    }
    File::open(path).map_err(io(path, "open"))
}

/// Checks the seal of `path`; returns the size of the file.
///
/// Memory does not depend on the sizes that the file claims.
pub(crate) fn check(path: &Path, format: &SealFormat) -> Result<u64> {
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

/// Returns the content of a sealed file after checking the seal.
pub(crate) fn read(path: &Path, format: &SealFormat) -> Result<Vec<u8>> {
    check(path, format)?;
    let mut file = open(path)?;
    let mut content = vec![];
    let read =
        file.seek(SeekFrom::Start(BLOCK as u64)).and_then(|_| file.read_to_end(&mut content));
    read.map_err(io(path, "read"))?;
    Ok(content)
}

/// Seals a complete file at its end.
pub(crate) fn put_at_end(path: &Path, format: &SealFormat) -> Result<()> {
    let mut file = File::options().read(true).append(true).open(path).map_err(io(path, "open"))?;
    let size = file.metadata().map_err(io(path, "read"))?.len();
    let seal = block_of(&file, size, format, path)?;
    file.write_all(&seal).map_err(io(path, "write"))?;
    file.sync_all().map_err(io(path, "synchronise"))
}

/// Checks the seal at the end of `path`; returns false if there is none, as in an unfinished file.
pub(crate) fn check_at_end(path: &Path, format: &SealFormat) -> Result<bool> {
    let Some((mut file, size, found)) = end_of(path, format)? else { return Ok(false) };
    file.rewind().map_err(io(path, "read"))?;
    compare(&found, &block_of(file.take(size), size, format, path)?, path)?;
    Ok(true)
}

/// Removes the seal at the end of `path`, if there is one, so that the file can grow.
pub(crate) fn take_from_end(path: &Path, format: &SealFormat) -> Result<()> {
    let Some((_, size, _)) = end_of(path, format)? else { return Ok(()) };
    let file = File::options().write(true).open(path).map_err(io(path, "open"))?;
    file.set_len(size).map_err(io(path, "write"))
}

/// Opens a file with a seal at its end; returns the size of the content and the seal.
fn end_of(path: &Path, format: &SealFormat) -> Result<Option<(File, u64, Vec<u8>)>> {
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
    // The seal has the expected values, the content the found ones.
    Err(Fault::new("checksum", found, expected).in_file(path))
}

/// Returns the number of bytes that a header claims.
fn claim(header: &[u8], format: &SealFormat, path: &Path) -> Result<u64> {
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

/// Describes a file without a seal.
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

/// First bytes of HDF5 files.
const HDF5: &[u8] = b"\x89HDF";

/// Returns true if a file begins like an HDF5 file.
pub(crate) fn is_hdf5(path: &Path) -> Result<bool> {
    Ok(start_of(path)?.starts_with(HDF5))
}

/// Returns the first bytes of a file.
pub(crate) fn start_of(path: &Path) -> Result<Vec<u8>> {
    let file = open(path)?;
    let mut start = vec![];
    file.take(64).read_to_end(&mut start).map_err(io(path, "read"))?;
    Ok(start)
}

/// Writes a new seal on a file whose content was deliberately changed by another program.
pub(crate) fn reseal(path: &Path, format: &SealFormat) -> Result<()> {
    let mut file = File::options().read(true).write(true).open(path).map_err(io(path, "open"))?;
    file.seek(SeekFrom::Start(BLOCK as u64)).map_err(io(path, "read"))?;
    let size = file.metadata().map_err(io(path, "read"))?.len();
    let header = block_of(&file, size.saturating_sub(BLOCK as u64), format, path)?;
    file.rewind().and_then(|()| file.write_all(&header)).map_err(io(path, "write"))
}
