//! Figures of the zones of a stored run.

use crate::Result;
use crate::case::{Case, CaseOverrides};
use crate::quantities::Quantity;
use crate::table::{TextTable, figure};
use ballast::component::{ZoneResult, measure_zones};
use ballast::track;
use ballast_hdf5::checkpoint::{Checkpoint, Kind};
use serde_json::{Value, json};

/// Measures the zones of the checkpoint of a run; a bed has none.
///
/// # Errors
/// A case that is invalid.
pub fn measure_stored_zones(stored: &Checkpoint) -> Result<Vec<ZoneResult>> {
    if stored.kind != Kind::Run {
        return Ok(vec![]);
    }
    let choices = CaseOverrides::from_notes(&stored.extra)?;
    // The run has reported the warnings.
    let case = Case::parse(stored.case_text.clone(), &stored.case_name)?.with_overrides(choices);
    Ok(measure_zones(&stored.model, &stored.state, &track::zones(&case.plan)))
}

/// Tabulates compactness, coordination and inertial number of zones.
pub fn zones_table(zones: &[ZoneResult]) -> TextTable {
    let header = [Quantity::Compactness, Quantity::Coordination, Quantity::InertialNumber]
        .map(Quantity::label);
    let mut table = TextTable::new("zone", header);
    for zone in zones {
        let values = [(zone.compactness, 4), (zone.coordination, 3), (zone.inertial_number, 3)];
        let cells = values.map(|(value, digits)| value.map_or("-".into(), |v| figure(v, digits)));
        table.row(std::iter::once(zone.name.clone()).chain(cells));
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
