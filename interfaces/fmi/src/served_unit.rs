//! Content of a unit whose bed is on a server: where the component is, which case it must have, and the variables.

use crate::bed::{Error, UnitBed};
use crate::variable_table::VariableTable;
use crate::variables::Variable;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Name of the file of a served bed among the resources of a unit.
pub const SERVED_FILE: &str = "served.json";
/// Environment variable with another name of the component, `site/id`.
pub const COMPONENT_VARIABLE: &str = "BALLAST_FMU_COMPONENT";
/// Environment variable with other endpoints to connect to, separated by commas.
pub const CONNECT_VARIABLE: &str = "BALLAST_FMU_CONNECT";

/// Endpoints of the session of a unit, as [`ServedUnit`] stores them.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ServedEndpoints {
    /// Endpoints to connect to; the default one if nothing is named.
    pub connect: Vec<String>,
    /// Endpoints to listen on.
    pub listen: Vec<String>,
    /// Endpoint of a router, to which the session connects as client.
    pub router: Option<String>,
    /// Zenoh configuration file on the computer of the importer.
    pub config: Option<PathBuf>,
}

/// Facts about a bed that an instance needs besides its variables.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnitOutline {
    /// Name of the case.
    pub name: String,
    /// Time step, ns.
    pub step_ns: u64,
    /// Simulated time at the start of the run, ns.
    pub start_ns: u64,
    /// Number of grains.
    pub grains: usize,
    /// Names of the driven bodies `[nd]`.
    pub bodies: Vec<String>,
}

impl UnitOutline {
    /// Returns the outline of a bed.
    pub fn of(bed: &UnitBed) -> Self {
        Self {
            name: bed.name.clone(),
            step_ns: bed.model.stepping.step_ns,
            start_ns: bed.state.time_ns,
            grains: bed.model.grains.len(),
            bodies: bed.model.driven.iter().map(|d| d.name.clone()).collect(),
        }
    }
}

/// Content of a unit whose bed is on a server.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ServedUnit {
    /// Name of the component, `site/id`.
    pub component: String,
    /// Endpoints of the session.
    pub endpoints: ServedEndpoints,
    /// Hash of model and state at the start of the run, which the served component must have.
    pub start_hash: String,
    /// Facts about the bed.
    pub outline: UnitOutline,
    /// Variables in the order of their elements.
    pub variables: Vec<Variable>,
}

impl ServedUnit {
    /// Describes the unit of a bed that the component `site/id` serves.
    pub fn new(bed: &UnitBed, component: impl Into<String>, endpoints: ServedEndpoints) -> Self {
        let hash = ballast_columns::state_hash(&bed.model, &bed.state);
        Self {
            component: component.into(),
            endpoints,
            start_hash: format!("{hash:032x}"),
            outline: UnitOutline::of(bed),
            variables: VariableTable::new(bed).variables,
        }
    }

    /// Returns the content as bytes.
    ///
    /// # Errors
    /// A path that is not text.
    pub fn to_bytes(&self) -> Result<Vec<u8>, Error> {
        serde_json::to_vec_pretty(self).map_err(|e| Error::Package(e.to_string()))
    }

    /// Reads the content in the folder of a unit's resources with its bytes; `None` if the unit has a bed inside.
    ///
    /// # Errors
    /// A file that cannot be read, or has other content.
    pub fn read(resources: &Path) -> Result<Option<(Self, Vec<u8>)>, Error> {
        let path = resources.join(SERVED_FILE);
        if !path.exists() {
            return Ok(None);
        }
        let place = path.display().to_string();
        let bytes =
            std::fs::read(&path).map_err(|source| Error::Io { path: place.clone(), source })?;
        let unit: Self =
            serde_json::from_slice(&bytes).map_err(|e| Error::Served(format!("{place}: {e}")))?;
        Ok(Some((unit, bytes)))
    }

    /// Replaces component and endpoints by those of the environment.
    pub fn with_environment(mut self, read: impl Fn(&str) -> Option<String>) -> Self {
        let set = |name| read(name).filter(|text| !text.is_empty());
        if let Some(component) = set(COMPONENT_VARIABLE) {
            self.component = component;
        }
        if let Some(connect) = set(CONNECT_VARIABLE) {
            let connect = connect.split(',').map(|endpoint| endpoint.trim().to_string()).collect();
            self.endpoints = ServedEndpoints {
                connect,
                config: self.endpoints.config,
                ..ServedEndpoints::default()
            };
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_environment_replaces_component_and_endpoints() {
        let unit = ServedUnit {
            component: "yard/bed".into(),
            endpoints: ServedEndpoints {
                router: Some("tcp/a:1".into()),
                config: Some("/etc/zenoh.json5".into()),
                ..ServedEndpoints::default()
            },
            start_hash: String::new(),
            outline: UnitOutline {
                name: String::new(),
                step_ns: 1,
                start_ns: 0,
                grains: 0,
                bodies: vec![],
            },
            variables: vec![],
        };
        assert_eq!(unit.clone().with_environment(|_| None), unit);
        assert_eq!(unit.clone().with_environment(|_| Some(String::new())), unit);
        let other = unit.clone().with_environment(|name| match name {
            COMPONENT_VARIABLE => Some("yard/other".into()),
            _ => Some("tcp/b:2, tcp/c:3".into()),
        });
        assert_eq!(other.component, "yard/other");
        assert_eq!(other.endpoints.connect, ["tcp/b:2", "tcp/c:3"]);
        assert_eq!((other.endpoints.router, other.endpoints.config), (None, unit.endpoints.config));
    }
}
