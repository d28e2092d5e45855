//! Results of a run: a row per step, zones and geometry per frame, and the figures of the summary.

use crate::case::Case;
use crate::record::{self, TrackedBody};
use crate::run_files::RunFiles;
use crate::summary::{RunSummary, SummarySettings, Targets};
use crate::{Failure, Result};
use ballast::model::Model;
use ballast::observe::{self, Zone};
use ballast::state::State;
use ballast::step::StepReport;
use ballast::track::plan::Plan;
use ballast::track::{self, TampingPhase};
use ballast::workspace::Workspace;
use ballast_hdf5::results::{
    self, BackgroundWriter, ResultsMetadata, ResultsReader, ResultsTable, ResultsWriter,
};
use std::path::Path;

/// Name of the table of steps, see [`record`].
pub const STEPS: &str = "steps";
/// Name of the table of the compactness of the zones.
pub const ZONES: &str = "zones";
/// Maximum number of frames and rows in the queue of the file.
const MAX_QUEUED: usize = 64;

/// Hint for a checkpoint without the results of its run.
pub const TOGETHER: &str =
    "put the checkpoint beside its own run's results, or run its case again with another --out";

/// Recorder of the results of a run.
pub struct Recorder {
    zones: Vec<Zone>,
    tracked: Vec<TrackedBody>,
    results: BackgroundWriter,
    /// True if the case has frames.
    frames: bool,
    summary: RunSummary,
}

impl Recorder {
    /// Creates the results of a run that starts at `state`.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn create(files: &RunFiles, case: &Case, model: &Model, state: &State) -> Result<Self> {
        let meta = ResultsMetadata {
            case_name: case.plan.name.clone(),
            case_text: case.text.clone(),
            key: case.bed_key(),
            program: concat!("ballast ", env!("CARGO_PKG_VERSION")).into(),
        };
        let writer = ResultsWriter::create(files.results(), model, &meta)?;
        let mut recorder = Self::open(writer, case, model)?;
        recorder.summary = recorder.summary.starting_at(state);
        Ok(recorder)
    }

    /// Opens the results of a run at `state` and removes later records.
    ///
    /// # Errors
    /// Results that are missing, damaged or of another run.
    pub fn reopen(files: &RunFiles, case: &Case, model: &Model, state: &State) -> Result<Self> {
        Self::taken_up(files, case, model, state).map_err(|e| e.with(&format!("; {TOGETHER}")))
    }

    fn taken_up(files: &RunFiles, case: &Case, model: &Model, state: &State) -> Result<Self> {
        let path = files.results();
        // Before anything reads the file.
        results::mend(&path)?;
        let reader = ResultsReader::open(&path)?;
        let (steps, zones) = (reader.table(STEPS)?, reader.table(ZONES)?);
        // Before anything is cut off.
        if let Some(what) = of_another_run(&reader, &steps, case, state)? {
            return Err(Failure::at(&path, what));
        }
        check_tables(&path, case, model, &steps, &zones)?;
        drop(reader);
        let writer = ResultsWriter::append_to(&path, model, state.step)?;
        let mut recorder = Self::open(writer, case, model)?;
        recorder.summary.take_tables(&steps, &zones, state.step);
        Ok(recorder)
    }

    fn open(writer: ResultsWriter, case: &Case, model: &Model) -> Result<Self> {
        let zones = track::zones(&case.plan);
        let tracked = record::tracked(model);
        let summary = RunSummary::new(SummarySettings::for_case(case, model));
        let mut results = BackgroundWriter::new(writer, MAX_QUEUED);
        declare(&mut results, STEPS, &record::columns(&tracked))?;
        declare(&mut results, ZONES, &zone_columns(&zones))?;
        let frames = case.plan.run.output_ns > 0;
        Ok(Self { zones, tracked, results, frames, summary })
    }

    /// Records a step.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn step(
        &mut self,
        model: &Model,
        state: &State,
        report: &StepReport,
        phase: TampingPhase,
    ) -> Result {
        let coordination = observe::coordination(model, state);
        let h = model.stepping.h();
        let row = record::row(h, state, report, phase, &coordination, &self.tracked);
        self.results.append(STEPS, state.step, &row.0)?;
        self.summary.take_step(&row);
        Ok(())
    }

    /// Records the zones, and the geometry if the case has frames.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn observe(&mut self, model: &Model, state: &State, workspace: &Workspace) -> Result {
        let compactness = compactness(model, state, &self.zones);
        self.summary.take_zones(&compactness);
        let mut row = vec![state.time()];
        row.extend(compactness);
        self.results.append(ZONES, state.step, &row)?;
        if self.frames {
            self.results.frame(model, state, workspace)?;
        }
        Ok(())
    }

    /// Adds the final state to the summary. The end may lie between two frames, so no record is made, as in a run that
    /// continues.
    pub fn observe_end(&mut self, model: &Model, state: &State) {
        self.summary.take_zones(&compactness(model, state, &self.zones));
        self.summary.lost = Some(observe::lost_grains(model, state));
    }

    /// Writes all records to the file, so that a kill loses none of them.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn secure(&mut self) -> Result {
        Ok(self.results.secure()?)
    }

    /// Zones of the case.
    pub fn zones(&self) -> &[Zone] {
        &self.zones
    }

    /// Summary of the steps so far.
    pub fn summary(&self) -> &RunSummary {
        &self.summary
    }
}

/// Returns why results cannot belong to the run with the checkpoint `state`; `None` if they can.
///
/// # Errors
/// Results that cannot be read.
pub fn of_another_run(
    reader: &ResultsReader,
    steps: &ResultsTable,
    case: &Case,
    state: &State,
) -> Result<Option<String>> {
    if reader.metadata("case_text")? != case.text {
        let (expected, found) = (&case.plan.name, reader.metadata("case_name")?);
        let text =
            format!("expected that of the checkpoint, {expected:?}, found another, {found:?}");
        return Ok(Some(format!("metadata/case_text: {text}")));
    }
    let last = state.step;
    let rows = steps.steps.iter().filter(|step| **step <= last).count();
    if rows as u64 != last {
        return Ok(Some(format!("{STEPS}: expected a row for each of {last} steps, found {rows}")));
    }
    // Runs of one case may have different schedules. Tables of other versions are refused by `check_tables`.
    let kinetic = steps.columns.iter().position(|(name, _)| name == "kinetic");
    let row = rows.checked_sub(1).map(|k| &steps.rows[k * steps.columns.len()..]);
    Ok(match (row, kinetic) {
        (Some(row), Some(at)) if row[at] != state.energy.kinetic => Some(format!(
            "{STEPS}, step {last}, kinetic: expected that of the checkpoint, {} J, found {} J",
            state.energy.kinetic, row[at]
        )),
        _ => None,
    })
}

/// Checks that tables have the columns of this version, by name and unit.
///
/// # Errors
/// A table with other columns.
pub fn check_tables(
    path: &Path,
    case: &Case,
    model: &Model,
    steps: &ResultsTable,
    zones: &ResultsTable,
) -> Result {
    check_columns(path, STEPS, steps, &record::columns(&record::tracked(model)))?;
    check_columns(path, ZONES, zones, &zone_columns(&track::zones(&case.plan)))
}

fn check_columns(
    path: &Path,
    name: &str,
    table: &ResultsTable,
    expected: &[(String, String)],
) -> Result {
    if table.columns == expected {
        return Ok(());
    }
    let differs = table.columns.iter().zip(expected).position(|(a, b)| a != b);
    let at = differs.unwrap_or(table.columns.len().min(expected.len()));
    let shown = |columns: &[(String, String)]| {
        columns.get(at).map_or("none".into(), |(name, unit)| format!("`{name}` in `{unit}`"))
    };
    Err(Failure::Incompatible(format!(
        "{}: {name}, column {at}: expected {}, found {}; another version wrote it",
        path.display(),
        shown(expected),
        shown(&table.columns)
    )))
}

/// Returns the compactness of each zone; NaN for a zone that bodies fill.
pub fn compactness(model: &Model, state: &State, zones: &[Zone]) -> Vec<f64> {
    let measured = |zone| observe::compactness(model, state, zone);
    zones.iter().map(|zone| measured(zone).map_or(f64::NAN, |found| found.compactness)).collect()
}

impl SummarySettings {
    /// Returns the settings of a run of `model`.
    pub fn for_case(case: &Case, model: &Model) -> Self {
        let tracked = record::tracked(model);
        let cycle = track::TampingCycle::new(&case.plan, model).ok();
        let targets = |body: &TrackedBody| {
            let mut tines = cycle.iter().flat_map(|cycle| cycle.tines());
            let tine = tines.find(|tine| tine.body == body.driven)?;
            Some(Targets { depth_z: tine.deep, closing: tine.stroke, direction: tine.direction })
        };
        Self {
            targets: tracked.iter().map(targets).collect(),
            has_tolerance: model.solver.tolerance.is_some(),
            tracked,
            zones: track::zones(&case.plan).into_iter().map(|zone| zone.name).collect(),
            period: steps_per_period(&case.plan),
            grain_size: case.plan.bed.grains.mean_size(),
            traffic: case.plan.tamping.and_then(|t| Some((t.ends()[5], t.traffic?))),
        }
    }
}

/// Returns the number of steps per period of the vibration; 1 without vibration.
fn steps_per_period(plan: &Plan) -> usize {
    let period = plan.tamping.and_then(|t| t.vibration.period());
    period.map_or(1, |period| (period / plan.run.stepping.h()).round().clamp(1.0, 1e6) as usize)
}

fn declare(results: &mut BackgroundWriter, name: &str, columns: &[(String, String)]) -> Result {
    let columns: Vec<(&str, &str)> = columns.iter().map(|(n, u)| (&n[..], &u[..])).collect();
    Ok(results.table(name, &columns)?)
}

/// Returns the columns of the table of zones: time, and compactness of each zone.
fn zone_columns(zones: &[Zone]) -> Vec<(String, String)> {
    let zones = zones.iter().map(|zone| (zone.name.clone(), "1".to_string()));
    std::iter::once(("time".to_string(), "s".to_string())).chain(zones).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_different_column_is_reported() {
        let columns = |names: &[&str]| -> Vec<(String, String)> {
            names.iter().map(|name| (name.to_string(), "s".to_string())).collect()
        };
        let (steps, rows) = (vec![], vec![]);
        let table = ResultsTable { columns: columns(&["time", "phase"]), steps, rows };
        let check = |names| check_columns(Path::new("r"), STEPS, &table, &columns(names));
        assert!(check(&["time", "phase"]).is_ok());
        for (names, said) in [
            (&["time", "kinetic"][..], "column 1: expected `kinetic` in `s`, found `phase` in `s`"),
            (&["time", "phase", "more"], "column 2: expected `more` in `s`, found none"),
            (&["time"], "column 1: expected none, found `phase` in `s`"),
        ] {
            let failure = check(names).unwrap_err();
            assert!(matches!(failure, Failure::Incompatible(_)));
            assert!(failure.to_string().contains(said), "{failure}");
        }
    }
}
