//! What is measured on a state for a message.

use super::{Compactness, Header};
use ballast::model::Model;
use ballast::observe::{self, Zone};
use ballast::state::State;
use ballast::workspace::Workspace;

impl Compactness {
    /// The measures of a zone; `workspace` is that of the step which led to `state`.
    ///
    /// # Errors
    /// A zone without accessible volume.
    pub fn measure(
        model: &Model,
        state: &State,
        workspace: &Workspace,
        zone: &Zone,
    ) -> ballast::Result<Self> {
        let compactness = observe::compactness(model, state, zone)?.compactness;
        let inertial = observe::inertial_number(model, state, workspace, zone);
        Ok(Self {
            header: Header::world(state.time_ns),
            zone: zone.name.clone(),
            compactness,
            coordination: coordination(model, state, workspace, zone),
            inertial_number: inertial.value.unwrap_or(f64::NAN),
            mean_pressure: inertial.pressure,
            low: zone.region.low.into(),
            high: zone.region.high.into(),
        })
    }
}

/// Mean number of touching neighbours of the grains whose centre is in the zone; 0 without grains.
fn coordination(model: &Model, state: &State, workspace: &Workspace, zone: &Zone) -> f64 {
    let neighbours = observe::coordination(model, workspace).neighbours;
    let inside = |i: &usize| {
        let p = state.position[*i];
        (0..3).all(|k| zone.region.low[k] <= p[k] && p[k] <= zone.region.high[k])
    };
    let counted: Vec<u32> = (0..neighbours.len()).filter(inside).map(|i| neighbours[i]).collect();
    let sum: f64 = counted.iter().map(|n| f64::from(*n)).sum();
    sum / (counted.len().max(1)) as f64
}
