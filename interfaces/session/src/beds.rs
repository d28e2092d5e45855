//! Prepared beds at the terminal: found, or prepared under the eyes of who waits.

use crate::ProgressLabel;
use crate::Reporter;
use crate::case::Case;
use crate::interrupt;
use crate::table::duration;
use crate::{Failure, Result};
use ballast::model::Model;
use ballast::observe::mean_speed;
use ballast::state::State;
use ballast::track::{Bed, DepositProgress};
use ballast_beds::{BedStore, PreparationProgress};
use serde_json::{Value, json};
use std::path::Path;

/// Prepares the bed of a case unless it is there; `again` prepares it anyway.
pub fn prepare(case: &Case, folder: &Path, again: bool, console: &dyn Reporter) -> Result {
    let beds = BedStore::new(folder);
    let kept = if again { None } else { beds.find(&case.plan)? };
    let (prepared, bed) = found_or_made(kept, || make(case, &beds, console))?;
    announce(case, &beds, &bed, prepared, console);
    let verb = if prepared { "prepared" } else { "already there" };
    console.result(&format!("{verb}: {}", beds.path(&case.plan).display()));
    Ok(())
}

/// Model and state at the start of a case's run; the bed is prepared if it is not there.
pub fn scene(case: &Case, folder: &Path, console: &dyn Reporter) -> Result<(Model, State)> {
    let beds = BedStore::new(folder);
    scene_of(case, &beds, console, || make(case, &beds, console))
}

/// The same for one of many that are prepared at a time, so without a bar.
pub fn one_of_many(case: &Case, folder: &Path, console: &dyn Reporter) -> Result<(Model, State)> {
    let beds = BedStore::new(folder);
    let make = || unless_stopped(beds.prepare(case, &mut |_| interrupt::flow())?);
    scene_of(case, &beds, console, make)
}

fn scene_of(
    case: &Case,
    beds: &BedStore,
    console: &dyn Reporter,
    make: impl FnOnce() -> Result<Bed>,
) -> Result<(Model, State)> {
    let (prepared, bed) = found_or_made(beds.find(&case.plan)?, make)?;
    announce(case, beds, &bed, prepared, console);
    Ok(ballast_beds::scene(&case.plan, bed)?)
}

/// Whether it is made now, and the bed.
fn found_or_made(kept: Option<Bed>, make: impl FnOnce() -> Result<Bed>) -> Result<(bool, Bed)> {
    Ok(match kept {
        Some(bed) => (false, bed),
        None => (true, make()?),
    })
}

/// Tells of the bed whenever it is used, and whether it is what a bed should be.
fn announce(case: &Case, beds: &BedStore, bed: &Bed, prepared: bool, console: &dyn Reporter) {
    let (key, path) = (case.bed_key(), beds.path(&case.plan));
    let (speed, rest_speed) =
        (mean_speed(&bed.model, &bed.state), case.plan.bed.preparation.rest_speed);
    let at_rest = speed < rest_speed;
    console.event(
        "bed",
        json!({ "path": path, "key": key, "prepared": prepared, "mean_speed": speed, "at_rest": at_rest }),
    );
    if !at_rest {
        console.warning(&format!(
            "the bed is not at rest: its grains move at {speed:.1e} m/s in the mean, {rest_speed:.1e} m/s count \
             as rest"
        ));
    }
}

/// Prepares a bed and keeps it.
fn make(case: &Case, beds: &BedStore, console: &dyn Reporter) -> Result<Bed> {
    let mut progress = console.start_progress("bed");
    let mut pace = PreparationProgress::default();
    let mut watch = |done: &DepositProgress| {
        progress.advance(pace.update(done), &PrepareMark(*done));
        interrupt::flow()
    };
    let bed = beds.prepare(case, &mut watch)?;
    progress.finish();
    let bed = unless_stopped(bed)?;
    console.note(&format!(
        "bed of {} grains prepared in {}",
        bed.model.grains.len(),
        duration(progress.elapsed())
    ));
    Ok(bed)
}

fn unless_stopped(bed: Option<Bed>) -> Result<Bed> {
    let text = "stopped while preparing the bed; the next call prepares it from the start";
    bed.ok_or_else(|| Failure::Interrupted(text.into()))
}

/// Where a preparation stands.
struct PrepareMark(DepositProgress);

impl ProgressLabel for PrepareMark {
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
