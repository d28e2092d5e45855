//! Properties of a simulation that stepping does not change.

use crate::bodies::BodyInfo;
use crate::local::LocalBackend;
use ballast_protocol::description::TineDescription;
use ballast_zenoh::ComponentDescription;
use std::sync::Arc;

/// Properties of a local or remote simulation that stepping does not change.
pub struct SimulationInfo {
    pub name: String,
    /// Names of the driven bodies `[nd]`.
    pub names: Arc<[String]>,
    /// Driven bodies `[nd]`.
    pub bodies: Vec<BodyInfo>,
    /// Tines of the case's tamping cycle.
    pub tines: Vec<TineDescription>,
    pub step_ns: u64,
    pub schedule: String,
    pub grain_count: usize,
}

impl SimulationInfo {
    /// Returns the properties of a simulation of this process.
    pub fn local(local: &LocalBackend) -> Self {
        let context = local.context();
        let model = &context.model;
        Self {
            name: context.case.plan.name.clone(),
            names: Arc::clone(&context.names),
            bodies: model.driven.iter().map(Into::into).collect(),
            tines: TineDescription::of(local.cycle(), model),
            step_ns: model.stepping.step_ns,
            schedule: model.solver.schedule.name().into(),
            grain_count: model.grains.len(),
        }
    }

    /// Returns the properties of a simulation of a remote component.
    pub fn remote(description: ComponentDescription) -> Self {
        let schedule = description.parameters.get("schedule").and_then(|s| s.as_str());
        Self {
            name: format!("zenoh:{}", description.key),
            schedule: schedule.unwrap_or_default().into(),
            names: description.bodies.iter().map(|b| b.name.clone()).collect(),
            tines: description.tines,
            bodies: description.bodies.into_iter().map(Into::into).collect(),
            step_ns: description.step_ns,
            grain_count: description.grains,
        }
    }
}
