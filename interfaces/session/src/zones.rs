//! Figures of the zones of a stored run.

use crate::Result;
use crate::case::{Case, CaseOverrides};
use crate::quantities::Quantity;
use crate::table::TextTable;
use ballast::component::{ZoneResult, measure_zones};
use ballast::track;
use ballast_hdf5::checkpoint::{self, Kind};
use serde_json::{Value, json};
use std::path::Path;

/// Measures the zones of the checkpoint of a run; none in the file of a bed.
///
/// # Errors
/// A file that cannot be read, or whose case is invalid.
pub fn of_checkpoint(path: &Path) -> Result<Vec<ZoneResult>> {
    let stored = checkpoint::read(path)?;
    if stored.kind != Kind::Run {
        return Ok(vec![]);
    }
    let choices = CaseOverrides::from_notes(&stored.extra)?;
    // The run has reported the warnings.
    let case = Case::parse(stored.case_text, &stored.case_name)?.with_overrides(choices);
    Ok(measure_zones(&stored.model, &stored.state, &track::zones(&case.plan)))
}

/// Tabulates compactness, coordination and inertial number of zones.
pub fn zones_table(zones: &[ZoneResult]) -> TextTable {
    let header = [Quantity::Compactness, Quantity::Coordination, Quantity::InertialNumber]
        .map(Quantity::label);
    let mut table = TextTable::new("zone", header);
    let text = |value: Option<f64>, digits: usize| {
        value.map_or_else(|| "-".to_string(), |value| format!("{value:.digits$}"))
    };
    for zone in zones {
        let inertial = zone.inertial_number.map_or_else(|| "-".to_string(), |i| format!("{i:.2e}"));
        table.row([
            zone.name.clone(),
            text(zone.compactness, 4),
            text(zone.coordination, 2),
            inertial,
        ]);
    }
    table
}

/// Converts compactness, coordination and inertial number of zones to JSON, by name of the zone.
pub fn zones_json(zones: &[ZoneResult]) -> Value {
    let of_zone = |zone: &ZoneResult| {
        let figures = json!({
            "compactness": zone.compactness,
            "coordination": zone.coordination,
            "inertial_number": zone.inertial_number,
        });
        (zone.name.clone(), figures)
    };
    Value::Object(zones.iter().map(of_zone).collect())
}
