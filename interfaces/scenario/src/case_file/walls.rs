//! `[bed.walls]`: floor and walls that differ from the other boundaries.

use super::range::{Coefficient, ContactStiffness};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Floor and walls of the box; an absent one has the values of `boundary` in friction and stiffness.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct WallsSection {
    /// Floor, z = 0.
    pub floor: WallSection,
    /// Wall at x = 0.
    pub x_min: WallSection,
    /// Wall at the largest x.
    pub x_max: WallSection,
    /// Wall at y = 0.
    pub y_min: WallSection,
    /// Wall at the largest y.
    pub y_max: WallSection,
}

impl WallsSection {
    /// Returns keys and values in the order of the core's boundaries.
    pub fn by_name(&self) -> [(&'static str, &WallSection); 5] {
        [
            ("floor", &self.floor),
            ("x_min", &self.x_min),
            ("x_max", &self.x_max),
            ("y_min", &self.y_min),
            ("y_max", &self.y_max),
        ]
    }
}

/// Properties of the floor or of one wall.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct WallSection {
    /// Friction coefficient with grains. 0: a plane of symmetry. Absent: `bed.friction.boundary`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Coefficient>")]
    pub friction: Option<f64>,
    /// Normal stiffness of a contact point with a grain, N/m. Absent: `bed.stiffness.boundary_N_per_m`.
    #[serde(rename = "stiffness_N_per_m", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<ContactStiffness>")]
    pub stiffness: Option<f64>,
}
