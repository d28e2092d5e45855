//! What a recording says about itself: the metadata record `ballast`.

use crate::error::{Error, Result};
use ballast::model::Model;
use ballast_protocol::messages::StateHash;
use std::collections::BTreeMap;
use std::path::Path;

/// Name of the metadata record.
pub(crate) const NAME: &str = "ballast";
/// The format that this crate writes and reads.
const FORMAT: &str = "3";

/// Who moved the bodies of a recorded run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Drive {
    /// The tamping cycle of the case, whose memory is part of the state.
    Case,
    /// A partner: the recorded inputs are all there is.
    Inputs,
}

/// What is needed to compute a recording again.
#[derive(Debug, Clone, PartialEq)]
pub struct Meta {
    /// Program and version.
    pub program: String,
    pub case_name: String,
    /// Key of the bed's content.
    pub case_key: String,
    /// The case file.
    pub case_text: String,
    /// ns.
    pub step_ns: u64,
    pub schedule: String,
    pub drive: Drive,
    /// What the command line changed in the case.
    pub choices: BTreeMap<String, String>,
    /// Hash of the state at the start.
    pub initial_hash: StateHash,
}

const CHOICE: &str = "choice.";

impl Meta {
    /// Of a recording that begins now: of a case by its name, the key of its bed, its text, and what was chosen
    /// in it, with `model`; `initial_hash` fingerprints model and state.
    pub fn of(
        [case_name, case_key, case_text]: [String; 3],
        choices: BTreeMap<String, String>,
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
            choices,
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
        let choices = self.choices.iter().map(|(k, v)| (format!("{CHOICE}{k}"), v.clone()));
        fixed.into_iter().map(|(k, v)| (k.to_string(), v)).chain(choices).collect()
    }

    pub(crate) fn from_entries(path: &Path, entries: &BTreeMap<String, String>) -> Result<Self> {
        let text = |key: &str| {
            entries.get(key).cloned().ok_or_else(|| {
                Error::damaged(path, format!("metadata {NAME:?}, {key}"), "an entry", "none")
            })
        };
        let wrong = |key: &str, expected: &str, found: &str| {
            Error::damaged(
                path,
                format!("metadata {NAME:?}, {key}"),
                expected,
                format!("{found:?}"),
            )
        };
        let format = text("format")?;
        if format != FORMAT {
            let (expected, found) = (FORMAT.into(), format);
            return Err(Error::Version { path: path.into(), expected, found });
        }
        let step = text("step_ns")?;
        let hash = text("initial_hash")?;
        let choice = |(k, v): (&String, &String)| Some((k.strip_prefix(CHOICE)?.into(), v.clone()));
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
            choices: entries.iter().filter_map(choice).collect(),
            initial_hash: hash
                .parse()
                .map_err(|_| wrong("initial_hash", "32 hexadecimal digits", &hash))?,
        })
    }
}
