//! Beds from the cache, or prepared with progress.

use crate::ProgressLabel;
use crate::Reporter;
use crate::case::Case;
use crate::interrupt;
use crate::quantities::Quantity;
use crate::stones::{stones_json, stones_text};
use crate::summary::last_cycle;
use crate::table::duration;
use crate::{Failure, Result};
use ballast::model::Model;
use ballast::observe::{mean_speed, stone_statistics};
use ballast::state::State;
use ballast::track::{Bed, DepositProgress};
use ballast_beds::{BedStore, PreparationProgress};
use serde_json::{Value, json};
use std::path::Path;

/// Prepares the bed of a case unless the cache contains it; `again` prepares it anyway.
///
/// # Errors
/// A bed that cannot be prepared, read or written, or an interrupt.
pub fn prepare(case: &Case, folder: &Path, again: bool, console: &dyn Reporter) -> Result {
    let beds = BedStore::new(folder);
    let kept = if again { None } else { beds.find(&case.plan)? };
    let (prepared, bed) = find_or_prepare(kept, || prepare_bed(case, &beds, console))?;
    report_bed(case, &beds, &bed, prepared, console);
    if let Some(stones) = stone_statistics(&bed.model) {
        console.result(&stones_text(&stones));
        console.event("stones", stones_json(&stones));
    }
    if let Some(traffic) = traffic_text(&bed.settlements) {
        console.result(&traffic);
        console.event("traffic", json!({ (Quantity::TrafficSettlement.key()): bed.settlements }));
    }
    let verb = if prepared { "prepared" } else { "already there" };
    console.result(&format!("{verb}: {}", beds.path(&case.plan).display()));
    Ok(())
}

/// Returns a line with the settlements of the traffic over a bed; `None` without traffic.
pub fn traffic_text(settlements: &[f64]) -> Option<String> {
    let all = settlements.last()?;
    Some(format!(
        "{}: {:.1} mm in {} load cycles, {:.2} mm in the last",
        Quantity::TrafficSettlement.label(),
        1e3 * all,
        settlements.len(),
        1e3 * last_cycle(settlements)
    ))
}

/// Returns model and state at the start of a run; prepares the bed if necessary.
///
/// # Errors
/// A bed that cannot be prepared, read or written, or an interrupt.
pub fn scene(case: &Case, folder: &Path, console: &dyn Reporter) -> Result<(Model, State)> {
    let beds = BedStore::new(folder);
    let bed = bed_of(case, &beds, console, || prepare_bed(case, &beds, console))?;
    Ok(ballast_beds::scene(&case.plan, bed)?)
}

/// Returns model and state at the start of a run; prepares the bed without progress, for many in parallel.
///
/// # Errors
/// A bed that cannot be prepared, read or written, or an interrupt.
pub fn scene_without_progress(
    case: &Case,
    folder: &Path,
    console: &dyn Reporter,
) -> Result<(Model, State)> {
    Ok(ballast_beds::scene(&case.plan, bed_without_progress(case, folder, console)?)?)
}

/// Returns a bed, prepared without progress if necessary.
///
/// # Errors
/// A bed that cannot be prepared, read or written, or an interrupt.
pub fn bed_without_progress(case: &Case, folder: &Path, console: &dyn Reporter) -> Result<Bed> {
    let beds = BedStore::new(folder);
    let make = || unless_stopped(beds.prepare(case, &mut |_| interrupt::flow())?);
    bed_of(case, &beds, console, make)
}

/// Returns a bed, from `make` if the cache has none.
fn bed_of(
    case: &Case,
    beds: &BedStore,
    console: &dyn Reporter,
    make: impl FnOnce() -> Result<Bed>,
) -> Result<Bed> {
    let (prepared, bed) = find_or_prepare(beds.find(&case.plan)?, make)?;
    report_bed(case, beds, &bed, prepared, console);
    Ok(bed)
}

/// Returns the bed, and true if it was prepared now.
fn find_or_prepare(kept: Option<Bed>, make: impl FnOnce() -> Result<Bed>) -> Result<(bool, Bed)> {
    Ok(match kept {
        Some(bed) => (false, bed),
        None => (true, make()?),
    })
}

/// Reports the bed, with a warning if it is not at rest.
fn report_bed(case: &Case, beds: &BedStore, bed: &Bed, prepared: bool, console: &dyn Reporter) {
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
            "bed: expected a mean speed of the grains below {rest_speed:.1e} m/s, found {speed:.1e} m/s; increase the \
             limits of its preparation"
        ));
    }
}

/// Prepares a bed and stores it.
fn prepare_bed(case: &Case, beds: &BedStore, console: &dyn Reporter) -> Result<Bed> {
    let mut progress = console.start_progress("bed");
    let mut pace = PreparationProgress::default();
    let mut watch = |done: &DepositProgress| {
        progress.advance(pace.update(done), &PreparationLabel(*done));
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
    let text = "stopped while preparing the bed; the next command prepares it from the start";
    bed.ok_or_else(|| Failure::Interrupted(text.into()))
}

/// Label of the point that a preparation has reached.
struct PreparationLabel(DepositProgress);

impl ProgressLabel for PreparationLabel {
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
