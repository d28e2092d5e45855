//! What a report is made of: the files of a run, read back.

use ballast::math::Pose;
use ballast::model::Model;
use ballast::observe::lost_grains;
use ballast::state::State;
use ballast::track::{self, TampingPhase};
use ballast_hdf5::checkpoint::{self, Kind};
use ballast_hdf5::results::{Reader, Table};
use ballast_session::Reporter;
use ballast_session::case::{self, Case, CaseOverrides};
use ballast_session::files::RunFiles;
use ballast_session::record::{Column, Row};
use ballast_session::recorder::{self, STEPS, TOGETHER, ZONES};
use ballast_session::summary::{Setting, Summary};
use ballast_session::{Failure, Outcome};
use serde_json::Value;
use std::path::Path;

/// How near to the end of a phase, over its length, a picture is one of its end.
const NEAR: f64 = 0.2;

/// A run, as its files tell it.
pub struct Source {
    pub case: Case,
    pub model: Model,
    /// The state of the last checkpoint, with which everything here ends.
    pub state: State,
    /// Steps that were recorded after it, by a run that was killed.
    pub beyond: usize,
    /// One row per step.
    pub rows: Vec<Row>,
    /// Time and compactness of each zone, the state's last.
    pub zones: Vec<Vec<f64>>,
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
    /// Reads a run.
    pub fn open(files: &RunFiles, console: &dyn Reporter) -> Outcome<Self> {
        let (results, at) = (files.results(), files.checkpoint());
        if !results.exists() && at.exists() && case::is_served(&checkpoint::read(&at)?) {
            let what = "it is not there, a served run leaves none; `ballast serve --record FILE`, then \
                        `ballast replay FILE`, make one for ParaView and `ballast export`";
            return Err(Failure::at(&results, what));
        }
        let reader = Reader::open(&results)?;
        if !at.exists() {
            let what = "it is not there, and the shapes of the bodies are in it; a replay leaves none, nor does a run that was \
                 killed before its first";
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
        let choices = CaseOverrides::from_notes(&kept.extra)?;
        let case = case::parse(kept.case_text, &kept.case_name, &choices, console)?;
        let (steps, zones) = (reader.series(STEPS)?, reader.series(ZONES)?);
        if let Some(what) = recorder::of_another_run(&reader, &steps, &case, &kept.state)? {
            return Err(Failure::at(&results, format!("{what}; {TOGETHER}")));
        }
        let mut summary = Summary::new(Setting::of(&case, &kept.model));
        recorder::check_tables(&results, &case, &kept.model, &steps, &zones)?;
        let (model, state) = (&kept.model, &kept.state);
        let done = summary.take_tables(&steps, &zones, state.step) as usize;
        let beyond = steps.steps.len().saturating_sub(done);
        let table = |table: &Table, rows: usize| -> Vec<Vec<f64>> {
            table.rows.chunks_exact(table.columns.len()).take(rows).map(<[f64]>::to_vec).collect()
        };
        let rows: Vec<Row> = table(&steps, done).into_iter().map(Row).collect();
        let upto = zones.steps.iter().filter(|step| **step <= state.step).count();
        let measured = recorder::compactness(model, state, &track::zones(&case.plan));
        let mut zones = table(&zones, upto);
        // Between two outputs, or where the case asks for none.
        if zones.last().is_none_or(|row| row[0] < state.time()) {
            summary.take_zones(&measured);
            zones.push([vec![state.time()], measured].concat());
        }
        summary.lost = Some(lost_grains(model, state));
        let frames = frames(&reader, &rows, state, &results)?;
        // That of a run that was gone on with is about an earlier state.
        let told = files.told_summary().filter(|told| told["state_hash"] == state_hash);
        let timing = told.map(|mut summary| summary["timing"].take());
        Ok(Self {
            program: reader.about("program")?,
            bed_key: reader.about("key")?,
            case,
            model: kept.model,
            state: kept.state,
            beyond,
            rows,
            zones,
            frames,
            summary,
            state_hash,
            timing,
        })
    }

    /// The last frame of a phase, and a title for it: an end only where it is near that of a phase that is over.
    pub fn end_of(&self, phase: TampingPhase) -> Option<(String, &Frame)> {
        let frame = self.frames.iter().rev().find(|frame| frame.phase == phase)?;
        let times =
            || self.rows.iter().filter(|row| row.phase() == phase).map(|r| r.get(Column::Time));
        let (first, last) = (times().next()?, times().next_back()?);
        let is_over = self.rows.last().is_some_and(|row| row.phase() != phase);
        let is_near = last - frame.time <= NEAR * (last - first);
        let where_in = if is_over && is_near { "End of" } else { "In" };
        Some((format!("{where_in} the {}, {:.3} s", phase.name(), frame.time), frame))
    }
}

/// The files of the run in a folder, or of the one that a file belongs to.
pub fn of_run(path: &Path) -> Outcome<RunFiles> {
    if path.is_dir() {
        return RunFiles::of_given(path);
    }
    let files = RunFiles::beside(path);
    let known = [files.results(), files.checkpoint(), files.summary()];
    if known.iter().any(|file| file.file_name() == path.file_name()) {
        return Ok(files);
    }
    let names = "results.vtkhdf, checkpoint.h5, summary.json";
    let found = if path.exists() { "another" } else { "nothing" };
    let what = format!("expected the folder of a run or a file of it ({names}), found {found}");
    Err(Failure::at(path, what))
}

fn frames(reader: &Reader, rows: &[Row], state: &State, path: &Path) -> Outcome<Vec<Frame>> {
    let bodies = state.position.len();
    let times = reader.times()?;
    let mut frames = Vec::with_capacity(times.len());
    for (k, (step, time)) in reader.steps().iter().zip(times).enumerate() {
        if *step > state.step {
            break;
        }
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
