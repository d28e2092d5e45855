//! Backup of the index of a results file at the last checkpoint, in a separate small file.
//!
//! HDF5 updates its indices in place, and a flush is many writes. A crash between them can leave an inconsistent index,
//! which makes old frames unreadable although their data are intact. Therefore a checkpoint copies everything but the
//! data: indices, headers, tables. Restoring the copy restores the file of the checkpoint.
//! Contract: compressed chunks are written only once; a backup is complete before it replaces the previous one. The backup
//! exists from the first checkpoint until the results are closed.

use crate::error::{Fault, FaultInFile, Result, hdf5 as hdf5_error, io};
use crate::seal::{self, SealFormat};
use hdf5::{Dataset, File, Group};
use std::collections::BTreeMap;
use std::fs;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const FORMAT: SealFormat = SealFormat { name: "ballast-results-index-backup", version: 1 };
/// Maximum depth of groups: those of results are three deep, and a cyclic link would never end.
const MAX_DEPTH: u32 = 8;

/// Address and size in bytes of the compressed chunks in the file, by dataset.
#[derive(Debug, Default)]
pub(crate) struct IndexBackup {
    chunks: BTreeMap<String, Vec<[u64; 2]>>,
}

impl IndexBackup {
    /// Writes a backup of `file`, which is at `path` and flushed.
    pub fn write(&mut self, path: &Path, file: &File) -> Result<()> {
        self.find(file, MAX_DEPTH).map_err(hdf5_error(path, "chunks"))?;
        let mut source = fs::File::open(path).map_err(io(path, "open"))?;
        // The data that the backup refers to must be on the disk.
        source.sync_all().map_err(io(path, "synchronise"))?;
        let size = source.metadata().map_err(io(path, "read"))?.len();
        let mut image = size.to_le_bytes().to_vec();
        for [from, to] in self.gaps(size) {
            image.extend(from.to_le_bytes());
            image.extend((to - from).to_le_bytes());
            source.seek(SeekFrom::Start(from)).map_err(io(path, "read"))?;
            let read = Read::by_ref(&mut source).take(to - from).read_to_end(&mut image);
            let read = read.map_err(io(path, "read"))? as u64;
            if read != to - from {
                return Err(Fault::new("size", format!("{size} bytes"), from + read).in_file(path));
            }
        }
        seal::write(&backup_path(path), &FORMAT, &image)
    }

    /// Finds the new chunks in a group and at most `depth` levels of subgroups.
    fn find(&mut self, group: &Group, depth: u32) -> hdf5::Result<()> {
        for dataset in group.datasets()? {
            if !dataset.filters().is_empty() {
                let known = self.chunks.entry(dataset.name()).or_default();
                known.extend(chunks_from(&dataset, known.len()));
            }
        }
        // The tree for viewers has only links to groups elsewhere.
        let groups = group.groups()?.into_iter().filter(|g| !g.name().ends_with("/Assembly"));
        for group in groups {
            let Some(depth) = depth.checked_sub(1) else {
                return Err(format!("{}: groups are nested too deeply", group.name()).into());
            };
            self.find(&group, depth)?;
        }
        Ok(())
    }

    /// Returns the ranges between the chunks, in order.
    fn gaps(&self, size: u64) -> Vec<[u64; 2]> {
        let mut chunks: Vec<[u64; 2]> = self.chunks.values().flatten().copied().collect();
        chunks.sort_unstable();
        let ends = std::iter::once(0).chain(chunks.iter().map(|[at, size]| at + size));
        let starts = chunks.iter().map(|[at, _]| *at).chain([size]);
        ends.zip(starts).map(|(from, to)| [from, to]).filter(|[from, to]| from < to).collect()
    }
}

/// Returns the chunks of a dataset that grows by rows, in their order, from number `first` on.
fn chunks_from(dataset: &Dataset, first: usize) -> Vec<[u64; 2]> {
    let count = dataset.num_chunks().unwrap_or(0);
    (first..count).map_while(|k| dataset.chunk_info(k)).map(|c| [c.addr, c.size]).collect()
}

/// Restores the results at `path` from their backup, if a run was killed before it closed them.
///
/// # Errors
/// A damaged backup, which changes nothing; a file that cannot be written, after which the call may be repeated.
pub(crate) fn restore(path: &Path) -> Result<()> {
    let backup = backup_path(path);
    if !backup.exists() {
        return Ok(());
    }
    let image = seal::read(&backup, &FORMAT)?;
    let damaged = || Fault::new("backup", "sizes that fit", image.len()).in_file(&backup);
    let (size, mut rest) = number(&image).ok_or_else(damaged)?;
    let mut parts = vec![];
    while !rest.is_empty() {
        let (at, after) = number(rest).ok_or_else(damaged)?;
        let (len, after) = number(after).ok_or_else(damaged)?;
        let len =
            usize::try_from(len).ok().filter(|len| *len <= after.len()).ok_or_else(damaged)?;
        parts.push((at, &after[..len]));
        rest = &after[len..];
    }
    let mut file = fs::File::options().write(true).open(path).map_err(io(path, "open"))?;
    for (at, bytes) in parts {
        file.seek(SeekFrom::Start(at)).map_err(io(path, "write"))?;
        file.write_all(bytes).map_err(io(path, "write"))?;
    }
    file.set_len(size).map_err(io(path, "write"))?;
    file.sync_all().map_err(io(path, "synchronise"))
}

/// Removes the backup of a complete or new file.
pub(crate) fn remove(path: &Path) -> Result<()> {
    match fs::remove_file(backup_path(path)) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
            Err(io(path, "remove the backup of")(e))
        }
        _ => Ok(()),
    }
}

fn number(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((u64::from_le_bytes(*number), rest))
}

fn backup_path(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_os_string();
    name.push(".index-backup");
    name.into()
}
