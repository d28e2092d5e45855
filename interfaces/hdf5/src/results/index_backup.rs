//! What a results file was at the last checkpoint, in a small file beside it.
//!
//! HDF5 changes its indices where they are, and a flush is many writes. A program that is killed among them can leave
//! an index half new, and with it frames of long ago out of reach, though their data lie there untouched. So a
//! checkpoint keeps a copy of all but the data: indices, headers, tables. Put back, it makes the file what it was.
//! Contract: compressed chunks are written once and never again; what is kept is complete before it replaces what was
//! kept before. The file beside is there from the first checkpoint until results are closed.

use crate::error::{Fault, Result, hdf5 as hdf5_error, io};
use crate::seal::{self, Format};
use hdf5::{Dataset, File, Group};
use std::collections::BTreeMap;
use std::fs;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

const FORMAT: Format = Format { name: "ballast-results-index-backup", version: 1 };
/// Groups within groups: ours are three deep, and a link that leads back up would never end.
const MAX_DEPTH: u32 = 8;

/// Where chunks of compressed data lie in the file: address and size in bytes, by dataset.
#[derive(Debug, Default)]
pub(crate) struct IndexBackup {
    chunks: BTreeMap<String, Vec<[u64; 2]>>,
}

impl IndexBackup {
    /// Keeps what `file`, at `path` and flushed, is now.
    pub fn keep(&mut self, path: &Path, file: &File) -> Result<()> {
        self.find(file, MAX_DEPTH).map_err(hdf5_error(path, "chunks"))?;
        let mut source = fs::File::open(path).map_err(io(path, "open"))?;
        // What the copy refers to has to outlast the machine as well as the program.
        source.sync_all().map_err(io(path, "bring to the disk"))?;
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
        seal::write(&beside(path), &FORMAT, &image)
    }

    /// Finds the chunks that are new, in groups within groups at most so deep.
    fn find(&mut self, group: &Group, deepest: u32) -> hdf5::Result<()> {
        for dataset in group.datasets()? {
            if !dataset.filters().is_empty() {
                let known = self.chunks.entry(dataset.name()).or_default();
                known.extend(chunks_from(&dataset, known.len()));
            }
        }
        // The tree that viewers list is links to what has its place elsewhere.
        let groups = group.groups()?.into_iter().filter(|g| !g.name().ends_with("/Assembly"));
        for group in groups {
            let Some(deepest) = deepest.checked_sub(1) else {
                return Err(format!("{}: expected no groups so deep", group.name()).into());
            };
            self.find(&group, deepest)?;
        }
        Ok(())
    }

    /// What lies between the chunks, in order.
    fn gaps(&self, size: u64) -> Vec<[u64; 2]> {
        let mut chunks: Vec<[u64; 2]> = self.chunks.values().flatten().copied().collect();
        chunks.sort_unstable();
        let ends = std::iter::once(0).chain(chunks.iter().map(|[at, size]| at + size));
        let starts = chunks.iter().map(|[at, _]| *at).chain([size]);
        ends.zip(starts).map(|(from, to)| [from, to]).filter(|[from, to]| from < to).collect()
    }
}

/// Chunks of a dataset that grows by rows, in their order, from number `first` on.
fn chunks_from(dataset: &Dataset, first: usize) -> Vec<[u64; 2]> {
    let count = dataset.num_chunks().unwrap_or(0);
    (first..count).map_while(|k| dataset.chunk_info(k)).map(|c| [c.addr, c.size]).collect()
}

/// Makes the results at `path` again what they were when last kept, if a run was killed before it closed them.
///
/// # Errors
/// The copy is damaged: nothing was changed then. The operating system refuses: it may be tried again.
pub(crate) fn restore(path: &Path) -> Result<()> {
    let beside = beside(path);
    if !beside.exists() {
        return Ok(());
    }
    let image = seal::read(&beside, &FORMAT)?;
    let damaged = || Fault::new("kept parts", "sizes that fit", image.len()).in_file(&beside);
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
    file.sync_all().map_err(io(path, "bring to the disk"))
}

/// Removes what was kept: the file is whole, or begins anew.
pub(crate) fn forget(path: &Path) -> Result<()> {
    match fs::remove_file(beside(path)) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(io(path, "tidy up beside")(e)),
        _ => Ok(()),
    }
}

fn number(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let (number, rest) = bytes.split_first_chunk()?;
    Some((u64::from_le_bytes(*number), rest))
}

fn beside(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_os_string();
    name.push(".index-backup");
    name.into()
}
