//! Beds and checkpoints of runs: everything from which a run continues bit for bit, in one sealed file.
//!
//! Reads and writes: model, state, and the case they belong to. Cost: one copy in memory, one pass
//! over the file for its digest. Contract: `read(write(x)) == x` bit for bit; a file that was
//! changed anywhere is refused; a failed `write` leaves the earlier file as it was.

use crate::error::{Error, Fault, FaultInFile, Result, hdf5 as hdf5_error, io};
use crate::image::{self, ColumnSource};
use crate::replace::check_file_kind;
use crate::seal;
use ballast::model::Model;
use ballast::state::State;
use ballast_columns::columns::{self, Column, Data};
use ballast_columns::{ColumnReader, decode, validate};
use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::path::Path;

/// Version of the format that this program writes and reads.
pub const VERSION: u32 = 4;

pub(crate) const FORMAT: seal::SealFormat =
    seal::SealFormat { name: "ballast-checkpoint", version: VERSION };

/// Kind of a checkpoint file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Kind {
    /// Prepared bed, the start of runs.
    Bed,
    /// State of a run that can be resumed.
    Run,
}

impl Kind {
    const ALL: [Kind; 2] = [Kind::Bed, Kind::Run];

    /// Name of the kind in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Kind::Bed => "bed",
            Kind::Run => "run",
        }
    }
}

/// Content of a checkpoint file.
#[derive(Debug, Clone, PartialEq)]
pub struct Checkpoint {
    /// Model of the bed or run.
    pub model: Model,
    /// State of the bed or run.
    pub state: State,
    /// Kind of the file.
    pub kind: Kind,
    /// Name of the case.
    pub case_name: String,
    /// Text of the case file.
    pub case_text: String,
    /// Content key of the bed: equal keys mean equal beds.
    pub key: String,
    /// Notes of the caller.
    pub extra: BTreeMap<String, String>,
}

/// Writes `checkpoint` to `path`, which is replaced only when the new file is on the disk.
///
/// # Errors
/// [`Error::Refused`] for a model or state that could not be stepped (nothing is touched),
/// [`Error::Io`] from the operating system; the earlier file is then unchanged.
pub fn write(path: impl AsRef<Path>, checkpoint: &Checkpoint) -> Result<()> {
    let path = path.as_ref();
    seal::write(path, &FORMAT, &image_of(path, checkpoint)?)
}

/// Checks that `path` is free, or a bed or checkpoint of any version, because [`write()`] replaces any file.
///
/// # Errors
/// [`Error::Refused`] for another file; a file that cannot be read.
pub fn may_become_a_checkpoint(path: impl AsRef<Path>) -> Result<()> {
    check_file_kind(path.as_ref(), "a checkpoint of Ballast", |file| {
        let mut start = vec![];
        let begins = format!("{} ", FORMAT.name);
        let read = file.take(begins.len() as u64).read_to_end(&mut start);
        read.is_ok() && start == begins.as_bytes()
    })
}

/// Returns the bytes that [`write()`] would write, for a part of another file at `path`, which errors name.
///
/// # Errors
/// As for [`write()`].
pub fn to_bytes(path: impl AsRef<Path>, checkpoint: &Checkpoint) -> Result<Vec<u8>> {
    Ok(seal::bytes(&FORMAT, &image_of(path.as_ref(), checkpoint)?))
}

/// Reads the checkpoint in `bytes`.
///
/// # Errors
/// As for [`read`]; they name a temporary file, because HDF5 reads files.
pub fn from_bytes(bytes: &[u8]) -> Result<Checkpoint> {
    let folder = std::env::temp_dir();
    let mut file =
        tempfile::NamedTempFile::new_in(&folder).map_err(io(&folder, "create a file in"))?;
    file.write_all(bytes).map_err(io(file.path(), "write"))?;
    read(file.path())
}

fn image_of(path: &Path, checkpoint: &Checkpoint) -> Result<Vec<u8>> {
    validate::check(&checkpoint.model, &checkpoint.state).map_err(|f| f.refused(path))?;
    let file = image::new_image(path)?;
    let columns = columns::of(&checkpoint.model, &checkpoint.state);
    let fingerprint = format!("{:032x}", ballast_columns::columns_hash(&columns));
    let memory = columns::of_memory(&checkpoint.state);
    for column in columns.iter().chain(&memory).chain(&about(checkpoint, fingerprint)) {
        image::put(&file, path, column)?;
    }
    image::bytes_of(&file, path)
}

fn about(checkpoint: &Checkpoint, fingerprint: String) -> Vec<Column<'static>> {
    let texts = |name, texts| Column { name, width: 1, data: Data::Text(texts) };
    let extra = &checkpoint.extra;
    vec![
        texts("about/format", vec![FORMAT.name.into()]),
        Column { name: "about/version", width: 1, data: Data::U32(vec![VERSION].into()) },
        texts("about/kind", vec![checkpoint.kind.name().into()]),
        texts("about/case_name", vec![checkpoint.case_name.clone()]),
        texts("about/case_text", vec![checkpoint.case_text.clone()]),
        texts("about/key", vec![checkpoint.key.clone()]),
        texts("about/extra_names", extra.keys().cloned().collect()),
        texts("about/extra_values", extra.values().cloned().collect()),
        texts("about/state_hash", vec![fingerprint]),
    ]
}

/// Reads the checkpoint in `path`.
///
/// # Errors
/// [`Error::Version`] for another version of the format; [`Error::Damaged`], with dataset,
/// expected and found, for any other difference from the written file.
pub fn read(path: impl AsRef<Path>) -> Result<Checkpoint> {
    let path = path.as_ref();
    let size = seal::check(path, &FORMAT)?;
    let file = image::open(path).map_err(hdf5_error(path, "content"))?;
    let source = ColumnSource { path, file: &file, size, packed: false };
    check_version(&source)?;
    let model = decode::model(&source)?;
    let state = decode::state(&source, &model)?;
    validate::check(&model, &state).map_err(|f| f.in_file(path))?;
    check_fingerprint(&source, &model, &state)?;
    let names = source.texts("about/extra_names", None)?;
    let values = source.texts("about/extra_values", Some(names.len()))?;
    Ok(Checkpoint {
        kind: source.choice("about/kind", &Kind::ALL, Kind::name)?,
        case_name: source.text("about/case_name")?,
        case_text: source.text("about/case_text")?,
        key: source.text("about/key")?,
        extra: names.into_iter().zip(values).collect(),
        model,
        state,
    })
}

fn check_version(source: &ColumnSource) -> Result<()> {
    let found = (source.text("about/format")?, source.number::<u32>("about/version")?);
    if found == (FORMAT.name.to_string(), VERSION) {
        return Ok(());
    }
    Err(Error::Version {
        path: source.path.into(),
        expected: format!("{} {VERSION}", FORMAT.name),
        found: format!("{} {}", found.0, found.1),
    })
}

fn check_fingerprint(source: &ColumnSource, model: &Model, state: &State) -> Result<()> {
    let expected = source.text("about/state_hash")?;
    let found = format!("{:032x}", ballast_columns::state_hash(model, state));
    if expected == found {
        return Ok(());
    }
    Err(Fault::new("about/state_hash", expected, found).in_file(source.path))
}

/// Seals a file again after a deliberate change of its datasets with another HDF5 program.
///
/// [`read`] still checks the values, and compares them with `about/state_hash`.
#[doc(hidden)]
pub fn reseal(path: impl AsRef<Path>) -> Result<()> {
    seal::reseal(path.as_ref(), &FORMAT)
}
