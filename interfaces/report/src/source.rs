//! Sources of a report: the files of a run.

use ballast::math::Pose;
use ballast::model::Model;
use ballast::observe::lost_grains;
use ballast::state::State;
use ballast::track::{self, TampingPhase};
use ballast_hdf5::checkpoint::{self, Kind};
use ballast_hdf5::results::{ResultsReader, ResultsTable};
use ballast_session::Reporter;
use ballast_session::case::{self, Case, CaseOverrides};
use ballast_session::record::{Column, StepRow};
use ballast_session::recorder::{self, STEPS, TOGETHER, ZONES};
use ballast_session::run_files::RunFiles;
use ballast_session::summary::{RunSummary, SummarySettings};
use ballast_session::{Failure, Result};
use serde_json::Value;
use std::path::Path;

/// Distance of a picture from the end of a phase that counts as its end, over the length of the phase.
const END_TOLERANCE: f64 = 0.2;

/// Contents of the files of a run.
pub struct ReportSource {
    /// Case of the run.
    pub case: Case,
    /// Model in the checkpoint.
    pub model: Model,
    /// State of the last checkpoint, at which the report ends.
    pub state: State,
    /// Number of steps recorded after the checkpoint by a killed run.
    pub beyond: usize,
    /// Rows of the table `steps`.
    pub rows: Vec<StepRow>,
    /// Rows of the table `zones`: time and compactness of each zone.
    pub zones: Vec<Vec<f64>>,
    /// Frames up to the checkpoint.
    pub frames: Vec<ReportFrame>,
    /// RunSummary up to the checkpoint.
    pub summary: RunSummary,
    /// Program that wrote the results.
    pub program: String,
    /// Key of the bed.
    pub bed_key: String,
    /// Hash of the state in the checkpoint.
    pub state_hash: String,
    /// Timings of the process that finished the run; `None` for unfinished runs.
    pub timing: Option<Value>,
}

/// Poses of all bodies at one time.
pub struct ReportFrame {
    /// Time, s.
    pub time: f64,
    /// Phase of the cycle.
    pub phase: TampingPhase,
    /// Poses of the bodies `[nb]`.
    pub poses: Vec<Pose>,
}

impl ReportSource {
    /// Reads the files of a run.
    ///
    /// # Errors
    /// Files that are missing, damaged or of different runs.
    pub fn open(files: &RunFiles, console: &dyn Reporter) -> Result<Self> {
        let (results, at) = (files.results(), files.checkpoint());
        if !results.exists() && at.exists() && case::is_served(&checkpoint::read(&at)?) {
            let what = "no such file, since a served run writes no results; record it with `ballast serve --record FILE` and \
                        run `ballast replay FILE`";
            return Err(Failure::at(&results, what));
        }
        let reader = ResultsReader::open(&results)?;
        if !at.exists() {
            let what = "no such file, but the shapes of the bodies are in it; replays and runs killed before their first checkpoint \
                 have none";
            return Err(Failure::at(&at, what));
        }
        let stored = checkpoint::read(&at)?;
        if stored.kind != Kind::Run {
            return Err(Failure::at(
                &at,
                format!("expected the checkpoint of a run, found a {}", stored.kind.name()),
            ));
        }
        let state_hash = format!("{:032x}", ballast_hdf5::state_hash(&stored.model, &stored.state));
        let choices = CaseOverrides::from_notes(&stored.extra)?;
        let case = case::parse(stored.case_text, &stored.case_name, &choices, console)?;
        let (steps, zones) = (reader.table(STEPS)?, reader.table(ZONES)?);
        if let Some(what) = recorder::of_another_run(&reader, &steps, &case, &stored.state)? {
            return Err(Failure::at(&results, format!("{what}; {TOGETHER}")));
        }
        let mut summary = RunSummary::new(SummarySettings::for_case(&case, &stored.model));
        recorder::check_tables(&results, &case, &stored.model, &steps, &zones)?;
        let (model, state) = (&stored.model, &stored.state);
        let done = summary.take_tables(&steps, &zones, state.step) as usize;
        let beyond = steps.steps.len().saturating_sub(done);
        let table = |table: &ResultsTable, rows: usize| -> Vec<Vec<f64>> {
            table.rows.chunks_exact(table.columns.len()).take(rows).map(<[f64]>::to_vec).collect()
        };
        let rows: Vec<StepRow> = table(&steps, done).into_iter().map(StepRow).collect();
        let upto = zones.steps.iter().filter(|step| **step <= state.step).count();
        let measured = recorder::compactness(model, state, &track::zones(&case.plan));
        let mut zones = table(&zones, upto);
        // The state lies between two outputs, or the case has no output.
        if zones.last().is_none_or(|row| row[0] < state.time()) {
            summary.take_zones(&measured);
            zones.push([vec![state.time()], measured].concat());
        }
        summary.lost = Some(lost_grains(model, state));
        let frames = frames(&reader, &rows, state, &results)?;
        // After a resume the summary may belong to an earlier state.
        let summary_file = files.read_summary().filter(|file| file["state_hash"] == state_hash);
        let timing = summary_file.map(|mut summary| summary["timing"].take());
        Ok(Self {
            program: reader.metadata("program")?,
            bed_key: reader.metadata("key")?,
            case,
            model: stored.model,
            state: stored.state,
            beyond,
            rows,
            zones,
            frames,
            summary,
            state_hash,
            timing,
        })
    }

    /// Returns the last frame of a phase with a title, "End of" only if it is near the end of a finished phase.
    pub fn end_of(&self, phase: TampingPhase) -> Option<(String, &ReportFrame)> {
        let frame = self.frames.iter().rev().find(|frame| frame.phase == phase)?;
        let times =
            || self.rows.iter().filter(|row| row.phase() == phase).map(|r| r.get(Column::Time));
        let (first, last) = (times().next()?, times().next_back()?);
        let is_over = self.rows.last().is_some_and(|row| row.phase() != phase);
        let is_near = last - frame.time <= END_TOLERANCE * (last - first);
        let where_in = if is_over && is_near { "End of" } else { "In" };
        Some((format!("{where_in} the {}, {:.3} s", phase.name(), frame.time), frame))
    }
}

/// Returns the files of the run in a folder, or of the run that a file belongs to.
///
/// # Errors
/// A path that belongs to no run.
pub fn run_files(path: &Path) -> Result<RunFiles> {
    if path.is_dir() {
        return RunFiles::of_run_folder(path);
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

fn frames(
    reader: &ResultsReader,
    rows: &[StepRow],
    state: &State,
    path: &Path,
) -> Result<Vec<ReportFrame>> {
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
        // The first frame precedes the first step.
        let row = step.checked_sub(1).and_then(|k| rows.get(k as usize));
        let phase = row.map_or(TampingPhase::Waiting, StepRow::phase);
        frames.push(ReportFrame { time, phase, poses });
    }
    Ok(frames)
}
