//! What a run leaves in its results while it goes: a row per step, zones and geometry per frame;
//! and the figures of the summary.

use crate::case::Case;
use crate::exit::{Failure, Outcome};
use crate::files::RunFiles;
use crate::record::{self, Followed};
use crate::summary::{Setting, Summary};
use ballast::model::Model;
use ballast::observe::{self, Zone};
use ballast::state::State;
use ballast::step::StepReport;
use ballast::track::plan::Plan;
use ballast::track::{self, TampingPhase};
use ballast::workspace::Workspace;
use ballast_hdf5::results::{Background, Meta, Reader, Writer};

/// Table of the steps, see [`record`].
pub const STEPS: &str = "steps";
/// Table of the compactness of the zones over time.
pub const ZONES: &str = "zones";
/// Frames and rows that may wait while the file is written.
const WAITING: usize = 64;

/// The open records of a run.
pub struct Recorder {
    zones: Vec<Zone>,
    followed: Vec<Followed>,
    results: Background,
    /// Whether the case asks for geometry.
    frames: bool,
    summary: Summary,
}

impl Recorder {
    /// Starts the records of a run.
    pub fn create(files: &RunFiles, case: &Case, model: &Model) -> Outcome<Self> {
        let meta = Meta {
            case_name: case.plan.name.clone(),
            case_text: case.text.clone(),
            key: case.bed_key(),
            program: concat!("ballast ", env!("CARGO_PKG_VERSION")).into(),
        };
        let writer = Writer::create(files.results(), model, &meta)?;
        Self::open(writer, case, model)
    }

    /// Takes the records of a run up after step `last`; later ones are cut off.
    pub fn reopen(files: &RunFiles, case: &Case, model: &Model, last: u64) -> Outcome<Self> {
        let path = files.results();
        // First: the file may have to be put right before anything reads it.
        let writer = Writer::append_to(&path, model, last)?;
        let reader = Reader::open(&path)?;
        let (steps, zones) = (reader.series(STEPS)?, reader.series(ZONES)?);
        drop(reader);
        let mut recorder = Self::open(writer, case, model)?;
        let kept = recorder.summary.take_tables(&steps, &zones, last);
        if kept != last {
            let what = format!("expected a row for each of {last} steps, found {kept}");
            return Err(Failure::at(&path, what));
        }
        Ok(recorder)
    }

    fn open(writer: Writer, case: &Case, model: &Model) -> Outcome<Self> {
        let zones = track::zones(&case.plan);
        let followed = record::followed(model);
        let summary = Summary::new(Setting::of(case, model));
        let mut results = Background::new(writer, WAITING);
        declare(&mut results, STEPS, &record::columns(&followed))?;
        declare(&mut results, ZONES, &zone_columns(&zones))?;
        let frames = case.plan.run.output_ns > 0;
        Ok(Self { zones, followed, results, frames, summary })
    }

    /// Records a step.
    pub fn step(
        &mut self,
        model: &Model,
        state: &State,
        report: &StepReport,
        phase: TampingPhase,
    ) -> Outcome {
        let coordination = observe::coordination(model, state);
        let h = model.stepping.h();
        let row = record::row(h, state, report, phase, &coordination, &self.followed);
        self.results.append(STEPS, state.step, &row.0)?;
        self.summary.take_step(&row);
        Ok(())
    }

    /// Records the zones, and the geometry if the case asks for it.
    pub fn observe(&mut self, model: &Model, state: &State, workspace: &Workspace) -> Outcome {
        let compactness = self.compactness(model, state)?;
        self.summary.take_zones(&compactness);
        let mut row = vec![state.time()];
        row.extend(compactness);
        self.results.append(ZONES, state.step, &row)?;
        if self.frames {
            self.results.frame(model, state, workspace)?;
        }
        Ok(())
    }

    /// Lets the summary know the zones of a run that ends between two frames; no record is made,
    /// since none would be there had the run gone on.
    pub fn observe_end(&mut self, model: &Model, state: &State) -> Outcome {
        let compactness = self.compactness(model, state)?;
        self.summary.take_zones(&compactness);
        Ok(())
    }

    /// Makes sure that no kill from here on costs a record.
    pub fn secure(&mut self) -> Outcome {
        Ok(self.results.secure()?)
    }

    pub fn zones(&self) -> &[Zone] {
        &self.zones
    }

    pub fn summary(&self) -> &Summary {
        &self.summary
    }

    fn compactness(&self, model: &Model, state: &State) -> Outcome<Vec<f64>> {
        compactness(model, state, &self.zones)
    }
}

/// Compactness of each zone.
pub fn compactness(model: &Model, state: &State, zones: &[Zone]) -> Outcome<Vec<f64>> {
    zones.iter().map(|zone| Ok(observe::compactness(model, state, zone)?.compactness)).collect()
}

impl Setting {
    /// What the case says beforehand of a run of `model`.
    pub fn of(case: &Case, model: &Model) -> Self {
        Self {
            followed: record::followed(model),
            zones: track::zones(&case.plan).into_iter().map(|zone| zone.name).collect(),
            period: steps_per_period(&case.plan),
            grain_size: case.plan.bed.grains.mean_size(),
        }
    }
}

/// Steps per period of the vibration; 1 without one.
fn steps_per_period(plan: &Plan) -> usize {
    let frequency = plan.tamping.map_or(0.0, |t| t.vibration.frequency);
    if frequency <= 0.0 {
        return 1;
    }
    (1.0 / (frequency * plan.run.stepping.h())).round().clamp(1.0, 1e6) as usize
}

fn declare(results: &mut Background, name: &str, columns: &[(String, String)]) -> Outcome {
    let columns: Vec<(&str, &str)> = columns.iter().map(|(n, u)| (&n[..], &u[..])).collect();
    Ok(results.series(name, &columns)?)
}

/// The time, and the compactness of each zone.
fn zone_columns(zones: &[Zone]) -> Vec<(String, String)> {
    let zones = zones.iter().map(|zone| (zone.name.clone(), "1".to_string()));
    std::iter::once(("time".to_string(), "s".to_string())).chain(zones).collect()
}
