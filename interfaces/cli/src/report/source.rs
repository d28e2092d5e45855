//! What a report is made of: the files of a run, read back.

use crate::case::{self, Case, Choices};
use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::files::{RunFiles, read_text};
use crate::record::{self, Row};
use crate::recorder::{STEPS, ZONES};
use crate::summary::{Setting, Summary};
use ballast::math::Pose;
use ballast::model::Model;
use ballast::state::State;
use ballast::track::TampingPhase;
use ballast_hdf5::checkpoint::{self, Kind};
use ballast_hdf5::results::{Reader, Table};
use serde_json::Value;
use std::path::Path;

/// No summary is this long.
const LIMIT: u64 = 1 << 20;

/// A run, as its files tell it.
pub struct Source {
    pub case: Case,
    pub model: Model,
    /// The state of the last checkpoint.
    pub state: State,
    /// One row per step.
    pub rows: Vec<Row>,
    pub zones: Table,
    pub frames: Vec<Frame>,
    pub summary: Summary,
    pub program: String,
    pub bed_key: String,
    pub state_hash: String,
    /// Of the process that ended the run; none for runs that have not ended.
    pub timing: Option<Value>,
}

/// Where all bodies were at a moment.
pub struct Frame {
    /// s.
    pub time: f64,
    pub phase: TampingPhase,
    /// `[nb]`.
    pub poses: Vec<Pose>,
}

impl Source {
    /// Reads the run in a folder, or the one that a file of it belongs to.
    pub fn open(path: &Path, console: Console) -> Outcome<Self> {
        let files = if path.is_dir() { RunFiles::in_folder(path) } else { RunFiles::beside(path) };
        let results = files.results();
        let reader = Reader::open(&results)?;
        let at = files.checkpoint();
        if !at.exists() {
            let what =
                "it is not there, and the shapes of the bodies are in it; a replay leaves none";
            return Err(Failure::at(&at, what));
        }
        let kept = checkpoint::read(&at)?;
        if kept.kind != Kind::Run {
            return Err(Failure::at(
                &at,
                format!("expected a run's, found a {}", kept.kind.name()),
            ));
        }
        let state_hash = format!("{:032x}", ballast_hdf5::state_hash(&kept.model, &kept.state));
        let choices = Choices::from_notes(&kept.extra)?;
        let case = case::parse(kept.case_text, &kept.case_name, &choices, console)?;
        let (steps, zones) = (reader.series(STEPS)?, reader.series(ZONES)?);
        let mut summary = Summary::new(Setting::of(&case, &kept.model));
        check_columns(&results, &steps, &summary)?;
        if zones.columns.len() != summary.setting().zones.len() + 1 {
            let found = format!("{} columns", zones.columns.len());
            let expected = summary.setting().zones.len() + 1;
            return Err(Failure::at(
                &results,
                format!("zones: expected {expected}, found {found}"),
            ));
        }
        summary.take_tables(&steps, &zones, u64::MAX);
        let rows: Vec<Row> =
            steps.rows.chunks_exact(steps.columns.len()).map(|row| Row(row.to_vec())).collect();
        let frames = frames(&reader, &rows, kept.model.body_count(), &results)?;
        let timing = read_text(&files.summary(), LIMIT)
            .ok()
            .and_then(|text| serde_json::from_str::<Value>(&text).ok())
            .map(|mut summary| summary["timing"].take());
        Ok(Self {
            program: reader.about("program")?,
            bed_key: reader.about("key")?,
            case,
            model: kept.model,
            state: kept.state,
            rows,
            zones,
            frames,
            summary,
            state_hash,
            timing,
        })
    }

    /// The last frame of a phase.
    pub fn end_of(&self, phase: TampingPhase) -> Option<&Frame> {
        self.frames.iter().rev().find(|frame| frame.phase == phase)
    }
}

/// Whether the table has the columns that this version writes.
fn check_columns(path: &Path, steps: &Table, summary: &Summary) -> Outcome {
    let expected = record::columns(&summary.setting().followed);
    if steps.columns == expected {
        return Ok(());
    }
    let differs = steps.columns.iter().zip(&expected).position(|(a, b)| a != b);
    let at = differs.unwrap_or(steps.columns.len().min(expected.len()));
    let column = |columns: &[(String, String)]| {
        columns.get(at).map_or("none".into(), |(name, unit)| format!("`{name}` in `{unit}`"))
    };
    Err(Failure::Incompatible(format!(
        "{}: {STEPS}, column {at}: expected {}, found {}; another version wrote it",
        path.display(),
        column(&expected),
        column(&steps.columns)
    )))
}

fn frames(reader: &Reader, rows: &[Row], bodies: usize, path: &Path) -> Outcome<Vec<Frame>> {
    let times = reader.times()?;
    let mut frames = Vec::with_capacity(times.len());
    for (k, (step, time)) in reader.steps().iter().zip(times).enumerate() {
        let poses = reader.poses(k)?;
        if poses.len() != bodies {
            let what = format!("frame {k}: expected {bodies} bodies, found {}", poses.len());
            return Err(Failure::at(path, what));
        }
        // The first frame is that before the first step.
        let row = step.checked_sub(1).and_then(|k| rows.get(k as usize));
        let phase = row.map_or(TampingPhase::Waiting, Row::phase);
        frames.push(Frame { time, phase, poses });
    }
    Ok(frames)
}
