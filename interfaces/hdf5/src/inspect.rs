//! Summary of a file of Ballast.
//!
//! Reads: a checkpoint, which is checked as a whole, or the tables of contents of a results file.

use crate::checkpoint::{self, Checkpoint};
use crate::error::Result;
use crate::results::ResultsReader;
use crate::seal;
use ballast::observe::{StoneStatistics, stone_statistics};
use ballast_columns::state_hash;
use serde_json::{Value, json};
use std::fmt;
use std::path::Path;

/// Summary of a bed, checkpoint or results file.
#[derive(Debug, Clone, PartialEq)]
pub struct FileSummary {
    /// Kind of the file: `bed`, `run` or `results`.
    pub kind: &'static str,
    /// Version of the file's format.
    pub version: u32,
    /// Name of the case.
    pub case_name: String,
    /// Content key of the bed.
    pub key: String,
    /// Number of grains.
    pub grains: u64,
    /// Names of the driven bodies.
    pub driven: Vec<String>,
    /// Last step.
    pub step: Option<u64>,
    /// Simulated time of the last step, s.
    pub time: Option<f64>,
    /// Number of contacts in memory; in beds and checkpoints.
    pub contacts: Option<u64>,
    /// Hash of the state; in beds and checkpoints.
    pub hash: Option<u128>,
    /// Shape and grading of the stones; in beds and checkpoints.
    pub stones: Option<StoneStatistics>,
    /// Number of frames; in results.
    pub frames: Option<u64>,
    /// Name, columns and rows of the tables; in results.
    pub tables: Vec<(String, u64, u64)>,
    /// Size of the file, bytes.
    pub size: u64,
}

/// Returns a summary of the file at `path`.
///
/// # Errors
/// As for [`checkpoint::read`] and [`ResultsReader::open`].
pub fn inspect(path: impl AsRef<Path>) -> Result<FileSummary> {
    let path = path.as_ref();
    if is_results(path)? {
        of_results(path)
    } else {
        Ok(FileSummary::of_checkpoint(path, &checkpoint::read(path)?))
    }
}

/// Returns true if a file is to be read as results: they have no seal at their start, as beds and checkpoints have.
///
/// # Errors
/// A file that cannot be read.
pub fn is_results(path: &Path) -> Result<bool> {
    seal::is_hdf5(path)
}

fn size(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |m| m.len())
}

impl FileSummary {
    /// Summarises a bed or checkpoint that was read from `path`.
    pub fn of_checkpoint(path: &Path, checkpoint: &Checkpoint) -> Self {
        let (model, state) = (&checkpoint.model, &checkpoint.state);
        Self {
            kind: checkpoint.kind.name(),
            version: checkpoint::VERSION,
            grains: model.grains.len() as u64,
            driven: model.driven.iter().map(|d| d.name.clone()).collect(),
            step: Some(state.step),
            time: Some(state.time()),
            contacts: Some(state.contacts.bodies.len() as u64),
            hash: Some(state_hash(model, state)),
            stones: stone_statistics(model),
            frames: None,
            tables: vec![],
            size: size(path),
            case_name: checkpoint.case_name.clone(),
            key: checkpoint.key.clone(),
        }
    }
}

fn of_results(path: &Path) -> Result<FileSummary> {
    let reader = ResultsReader::open(path)?;
    let (grains, driven) = reader.bodies()?;
    let mut tables = vec![];
    let (mut step, mut time) = (reader.steps().last().copied(), reader.times()?.last().copied());
    for name in reader.table_names()? {
        let table = reader.table(&name)?;
        // Tables have more rows than there are frames.
        let at = table.columns.iter().position(|(name, _)| name == "time");
        let row = table.rows.chunks_exact(table.columns.len().max(1)).next_back();
        if let (Some(&last), Some(at), Some(row)) = (table.steps.last(), at, row)
            && step.is_none_or(|step| step < last)
        {
            (step, time) = (Some(last), Some(row[at]));
        }
        tables.push((name, table.columns.len() as u64, table.steps.len() as u64));
    }
    Ok(FileSummary {
        kind: "results",
        version: crate::results::VERSION,
        case_name: reader.metadata("case_name")?,
        key: reader.metadata("key")?,
        grains,
        driven,
        step,
        time,
        contacts: None,
        hash: None,
        stones: None,
        frames: Some(reader.steps().len() as u64),
        tables,
        size: size(path),
    })
}

impl FileSummary {
    /// Converts the summary to JSON, without absent values.
    pub fn to_json(&self) -> Value {
        let mut value = json!({
            "kind": self.kind,
            "version": self.version,
            "case_name": self.case_name,
            "key": self.key,
            "grains": self.grains,
            "driven": self.driven,
            "step": self.step,
            "time_s": self.time,
            "contacts": self.contacts,
            "hash": self.hash.map(|h| format!("{h:032x}")),
            "frames": self.frames,
            "bytes": self.size,
        });
        if self.frames.is_some() {
            let table = |(name, columns, rows): &(String, u64, u64)| json!({ "name": name, "columns": columns, "rows": rows });
            value["tables"] = self.tables.iter().map(table).collect();
        }
        if let Value::Object(map) = &mut value {
            map.retain(|_, v| !v.is_null());
        }
        value
    }
}

impl fmt::Display for FileSummary {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        writeln!(f, "kind      {} (format {})", self.kind, self.version)?;
        writeln!(f, "case      {}", self.case_name)?;
        writeln!(f, "bodies    {} grains, {} driven", self.grains, self.driven.len())?;
        if let (Some(step), Some(time)) = (self.step, self.time) {
            writeln!(f, "time      {time} s, step {step}")?;
        }
        if let Some(contacts) = self.contacts {
            writeln!(f, "contacts  {contacts}")?;
        }
        if let Some(hash) = self.hash {
            writeln!(f, "hash      {hash:032x}")?;
        }
        if let Some(frames) = self.frames {
            writeln!(f, "frames    {frames}")?;
        }
        for (name, columns, rows) in &self.tables {
            writeln!(f, "table     {name}: {columns} columns, {rows} rows")?;
        }
        write!(f, "size      {} bytes", self.size)
    }
}
