//! Prepared beds: found again by what they depend on, or prepared and kept.

use crate::case::Case;
use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::files::create_folder;
use crate::interrupt;
use crate::progress::{Mark, Progress, duration};
use ballast::model::Model;
use ballast::state::State;
use ballast::track::{self, Bed, DepositProgress, DepositStage};
use ballast_hdf5::checkpoint::{self, Checkpoint, Kind};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// The stages of the preparation, in order.
const STAGES: [DepositStage; 4] =
    [DepositStage::Pour, DepositStage::Fill, DepositStage::Trim, DepositStage::Rest];

/// Prepares the bed of a case unless it is there; `again` prepares it anyway.
pub fn prepare(case: &Case, folder: &Path, again: bool, console: Console) -> Outcome {
    let path = path(case, folder);
    let prepared = again || !path.exists();
    if prepared {
        make(case, &path, console)?;
    } else {
        kept(case, &path)?;
    }
    announce(case, &path, prepared, console);
    let verb = if prepared { "prepared" } else { "already there" };
    console.result(&format!("{verb}: {}", path.display()));
    Ok(())
}

/// Model and state at the start of a case's run; the bed is prepared if it is not there.
pub fn scene(case: &Case, folder: &Path, console: Console) -> Outcome<(Model, State)> {
    let path = path(case, folder);
    let prepared = !path.exists();
    let bed = if prepared { make(case, &path, console)? } else { kept(case, &path)? };
    announce(case, &path, prepared, console);
    track::scene(&case.plan, bed)
        .map_err(|e| Failure::InvalidCase(format!("{}: {e}", case.plan.name)))
}

fn path(case: &Case, folder: &Path) -> PathBuf {
    folder.join(format!("{}.h5", case.bed_key()))
}

fn announce(case: &Case, path: &Path, prepared: bool, console: Console) {
    let (key, path) = (case.bed_key(), path);
    console.event("bed", json!({ "path": path, "key": key, "prepared": prepared }));
}

/// Reads a bed that was prepared earlier.
fn kept(case: &Case, path: &Path) -> Outcome<Bed> {
    let hint = "prepare it again with `ballast prepare CASE --force`";
    let kept = checkpoint::read(path).map_err(|e| match Failure::from(e) {
        Failure::Incompatible(text) => Failure::Incompatible(format!("{text}; {hint}")),
        other => Failure::Failed(format!("{other}; {hint}")),
    })?;
    if kept.kind != Kind::Bed || kept.key != case.bed_key() {
        return Err(Failure::at(path, format!("it is not the bed of this case; {hint}")));
    }
    Ok(Bed { model: kept.model, state: kept.state })
}

/// Prepares a bed and keeps it.
fn make(case: &Case, path: &Path, console: Console) -> Outcome<Bed> {
    if let Some(folder) = path.parent() {
        create_folder(folder)?;
    }
    let mut progress = Progress::start(console, "bed", 0.0);
    let mut last = None;
    let mut watch = |done: &DepositProgress| {
        last = Some(*done);
        progress.advance(share(done), &PrepareMark(*done));
        if interrupt::requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    };
    let bed = track::deposit(&case.plan, &mut watch)
        .map_err(|e| Failure::Failed(format!("preparing the bed of {}: {e}", case.plan.name)))?;
    progress.finish();
    let Some(bed) = bed else {
        let text = "stopped while preparing the bed; the next call prepares it from the start";
        return Err(Failure::Interrupted(text.into()));
    };
    let checkpoint = Checkpoint {
        model: bed.model.clone(),
        state: bed.state.clone(),
        kind: Kind::Bed,
        case_name: case.plan.name.clone(),
        case_text: case.text.clone(),
        key: case.bed_key(),
        extra: BTreeMap::new(),
    };
    checkpoint::write(path, &checkpoint)?;
    let rest_speed = case.plan.bed.preparation.rest_speed;
    if let Some(moving) = last.filter(|l| l.mean_speed >= rest_speed) {
        console.note(&format!(
            "the bed is not at rest: its grains move at {:.1e} m/s in the mean, {rest_speed:.1e} m/s count \
             as rest",
            moving.mean_speed
        ));
    }
    console.note(&format!(
        "bed of {} grains prepared in {}",
        bed.model.grains.len(),
        duration(progress.elapsed())
    ));
    Ok(bed)
}

/// Share of the preparation that is done. How long a stage takes is not known beforehand, only how
/// long it may take; each counts the same.
fn share(done: &DepositProgress) -> f64 {
    let before = STAGES.iter().take_while(|stage| **stage != done.stage).count() as f64;
    let within = done.step as f64 / done.most_steps.max(1) as f64;
    (before + within.min(1.0)) / STAGES.len() as f64
}

/// Where a preparation stands.
struct PrepareMark(DepositProgress);

impl Mark for PrepareMark {
    fn text(&self) -> String {
        let DepositProgress { stage, step, grains, contacts, mean_speed, .. } = self.0;
        format!(
            "{} · step {step} · {grains} grains · {contacts} contacts · mean speed {mean_speed:.1e} m/s",
            stage.name()
        )
    }

    fn fields(&self) -> Value {
        let done = &self.0;
        json!({
            "stage": done.stage.name(), "step": done.step, "grains": done.grains,
            "contacts": done.contacts, "mean_speed": done.mean_speed,
            "max_penetration_m": done.max_penetration,
        })
    }
}
