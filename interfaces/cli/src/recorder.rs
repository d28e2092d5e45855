//! What a run leaves behind while it goes: a row per step, zones and geometry per frame, and the
//! figures of the summary.

use crate::case::Case;
use crate::exit::{Failure, Outcome};
use crate::files::RunFiles;
use crate::record::{self, Followed};
use crate::series::{Row, Series};
use crate::summary::{Setting, Summary};
use ballast::model::Model;
use ballast::observe;
use ballast::state::State;
use ballast::step::StepReport;
use ballast::track;
use ballast::workspace::Workspace;
use ballast_hdf5::results::Writer;

/// The open records of a run.
pub struct Recorder {
    zones: Vec<track::Zone>,
    followed: Vec<Followed>,
    steps: Series,
    zone_rows: Series,
    results: Writer,
    summary: Summary,
}

impl Recorder {
    /// Starts the records of a run.
    pub fn create(files: &RunFiles, case: &Case, model: &Model) -> Outcome<Self> {
        let (zones, followed, setting) = outline(case, model);
        Ok(Self {
            steps: Series::create(&files.steps(), &record::columns(&followed))?,
            zone_rows: Series::create(&files.zones(), &zone_columns(&setting))?,
            results: Writer::create(files.results(), model)?,
            summary: Summary::new(setting),
            zones,
            followed,
        })
    }

    /// Takes the records of a run up after step `last`; later ones are cut off.
    pub fn reopen(files: &RunFiles, case: &Case, model: &Model, last: u64) -> Outcome<Self> {
        let (zones, followed, setting) = outline(case, model);
        let columns = record::columns(&followed);
        let (steps, rows) = Series::reopen(&files.steps(), &columns, last)?;
        if rows.len() as u64 != last {
            let what = format!("expected the rows of {last} steps, found {}", rows.len());
            return Err(Failure::at(&files.steps(), what));
        }
        let (zone_rows, observations) =
            Series::reopen(&files.zones(), &zone_columns(&setting), last)?;
        let mut summary = Summary::new(setting);
        rows.iter().for_each(|row| summary.take_step(row));
        observations.iter().for_each(|row| summary.take_zones(row));
        let results = Writer::reopen(files.results(), model, last)?;
        Ok(Self { zones, followed, steps, zone_rows, results, summary })
    }

    /// Records a step.
    pub fn step(
        &mut self,
        model: &Model,
        state: &State,
        workspace: &Workspace,
        report: &StepReport,
        phase: &str,
    ) -> Outcome {
        let coordination = observe::coordination(model, workspace).mean;
        let h = model.stepping.h();
        let row = record::row(h, state, report, phase, coordination, &self.followed);
        self.steps.push(&row)?;
        self.summary.take_step(&row);
        Ok(())
    }

    /// Records zones and geometry.
    pub fn observe(&mut self, model: &Model, state: &State, phase: &str) -> Outcome {
        let row = self.zones_now(model, state, phase);
        self.zone_rows.push(&row)?;
        self.summary.take_zones(&row);
        self.results.frame(model, state)?;
        Ok(())
    }

    /// Lets the summary know the zones of a run that ends between two frames; no record is made,
    /// since none would be there had the run gone on.
    pub fn observe_end(&mut self, model: &Model, state: &State, phase: &str) {
        let row = self.zones_now(model, state, phase);
        self.summary.take_zones(&row);
    }

    /// Hands all records to the system.
    pub fn flush(&mut self) -> Outcome {
        self.steps.flush()?;
        self.zone_rows.flush()?;
        self.results.flush()?;
        Ok(())
    }

    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    fn zones_now(&self, model: &Model, state: &State, phase: &str) -> Row {
        let compactness = self.zones.iter().map(|zone| observe::compactness(model, state, &zone.region));
        let values = std::iter::once(state.time()).chain(compactness).collect();
        Row { step: state.step, phase: phase.into(), values }
    }
}

fn outline(case: &Case, model: &Model) -> (Vec<track::Zone>, Vec<Followed>, Setting) {
    let zones = track::zones(&case.plan);
    let followed = record::followed(model);
    let setting = Setting {
        followed: followed.clone(),
        zones: zones.iter().map(|zone| zone.name.clone()).collect(),
        period: case.steps_per_period(),
        grain_size: case.grain_size(),
    };
    (zones, followed, setting)
}

/// Columns of `zones.csv`: the time, and the compactness of each zone.
fn zone_columns(setting: &Setting) -> Vec<String> {
    std::iter::once("time_s".to_string()).chain(setting.zones.iter().cloned()).collect()
}
