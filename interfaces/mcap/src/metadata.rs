//! Metadata of a recording: the metadata record `ballast`.

use crate::error::{Error, Result};
use ballast::model::Model;
use ballast_protocol::messages::StateHash;
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the metadata record.
pub(crate) const METADATA_NAME: &str = "ballast";
/// Name of the attachment with the state at the start.
pub(crate) const START_ATTACHMENT: &str = "start.h5";
/// Version of the format that this crate writes and reads.
const FORMAT: &str = "4";

/// Origin of the motions in a recorded run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drive {
    /// Tamping cycle of the case, whose memory is part of the state.
    Case,
    /// Inputs of a partner, which the recording contains.
    Inputs,
}

/// Metadata of a recording: everything that its verification needs besides the windows.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordingMetadata {
    /// Program and version.
    pub program: String,
    /// Name of the case.
    pub case_name: String,
    /// Content key of the bed.
    pub case_key: String,
    /// Text of the case file.
    pub case_text: String,
    /// Time step, ns.
    pub step_ns: u64,
    /// Name of the solver's schedule.
    pub schedule: String,
    /// Origin of the motions.
    pub drive: Drive,
    /// Notes of the overrides of the case.
    pub overrides: BTreeMap<String, String>,
    /// Hash of the state at the start.
    pub initial_hash: StateHash,
}

const OVERRIDE_PREFIX: &str = "override.";

impl RecordingMetadata {
    /// Creates the metadata of a new recording from the identity of its case (name, bed key, text), the notes of its
    /// overrides, its model, and the hash of its initial state.
    pub fn of(
        [case_name, case_key, case_text]: [String; 3],
        overrides: BTreeMap<String, String>,
        model: &Model,
        drive: Drive,
        initial_hash: StateHash,
    ) -> Self {
        Self {
            program: concat!("ballast ", env!("CARGO_PKG_VERSION")).into(),
            case_name,
            case_key,
            case_text,
            step_ns: model.stepping.step_ns,
            schedule: model.solver.schedule.name().into(),
            drive,
            overrides,
            initial_hash,
        }
    }

    pub(crate) fn entries(&self) -> BTreeMap<String, String> {
        let drive = match self.drive {
            Drive::Case => "case",
            Drive::Inputs => "inputs",
        };
        let fixed = [
            ("format", FORMAT.to_string()),
            ("program", self.program.clone()),
            ("case_name", self.case_name.clone()),
            ("case_key", self.case_key.clone()),
            ("case_text", self.case_text.clone()),
            ("step_ns", self.step_ns.to_string()),
            ("schedule", self.schedule.clone()),
            ("drive", drive.to_string()),
            ("initial_hash", self.initial_hash.to_string()),
        ];
        let overrides =
            self.overrides.iter().map(|(k, v)| (format!("{OVERRIDE_PREFIX}{k}"), v.clone()));
        fixed.into_iter().map(|(k, v)| (k.to_string(), v)).chain(overrides).collect()
    }

    pub(crate) fn from_entries(path: &Path, entries: &BTreeMap<String, String>) -> Result<Self> {
        let text = |key: &str| {
            entries.get(key).cloned().ok_or_else(|| {
                Error::damaged(
                    path,
                    format!("metadata {METADATA_NAME:?}, {key}"),
                    "an entry",
                    "none",
                )
            })
        };
        let wrong = |key: &str, expected: &str, found: &str| {
            Error::damaged(
                path,
                format!("metadata {METADATA_NAME:?}, {key}"),
                expected,
                format!("{found:?}"),
            )
        };
        let format = text("format")?;
        if format != FORMAT {
            let expected = FORMAT.into();
            return Err(Error::Version { path: path.into(), expected, found: format });
        }
        let step = text("step_ns")?;
        let hash = text("initial_hash")?;
        let override_of =
            |(k, v): (&String, &String)| Some((k.strip_prefix(OVERRIDE_PREFIX)?.into(), v.clone()));
        Ok(Self {
            program: text("program")?,
            case_name: text("case_name")?,
            case_key: text("case_key")?,
            case_text: text("case_text")?,
            step_ns: step.parse().map_err(|_| wrong("step_ns", "a whole number", &step))?,
            schedule: text("schedule")?,
            drive: match &text("drive")?[..] {
                "case" => Drive::Case,
                "inputs" => Drive::Inputs,
                other => return Err(wrong("drive", "`case` or `inputs`", other)),
            },
            overrides: entries.iter().filter_map(override_of).collect(),
            initial_hash: hash
                .parse()
                .map_err(|_| wrong("initial_hash", "32 hexadecimal digits", &hash))?,
        })
    }
}
