//! `[[plate]]`: boxes that follow a motion or carry a load, for laboratory tests.

use super::layout::MountSection;
use super::range::{Coefficient, ContactStiffness, Finite, Length, Pause, Positive};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A plate: one rigid body of boxes, such as a lid, a piston, half of a shear box or a vibrating wall.
///
/// Plates have contacts with grains only, not with each other, and may reach beyond the box of the bed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlateSection {
    /// Name of letters, digits, `_` and `-`, unique among sleepers, tines and plates.
    pub name: String,
    /// Reference point in x at the start of the run, m. Positions, forces and torques refer to this point.
    #[schemars(with = "Finite")]
    pub x_m: f64,
    /// Reference point in y at the start of the run, m.
    #[schemars(with = "Finite")]
    pub y_m: f64,
    /// Height of the reference point at the start of the run, m. Absent: the plate is lowered onto the grains of the prepared
    /// bed, until the highest of those below it touches.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Finite>")]
    pub z_m: Option<f64>,
    /// Boxes that make up the plate.
    #[schemars(length(min = 1, max = 64))]
    pub boxes: Vec<PlateBoxSection>,
    /// true: the plate stands in the bed while it is prepared, and no grains are poured below or above it. false: it is placed
    /// at the start of the run, clear of the grains.
    #[serde(default)]
    pub in_preparation: bool,
    /// Friction coefficient with grains. Absent: `bed.friction.boundary`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Coefficient>")]
    pub friction: Option<f64>,
    /// Normal stiffness of a contact point with a grain, N/m. Absent: `bed.stiffness.boundary_N_per_m`.
    #[serde(rename = "stiffness_N_per_m", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<ContactStiffness>")]
    pub stiffness: Option<f64>,
    /// Mount, which lets grains, weight and loads move the plate in the run. Absent: it stands, or follows `motion`.
    pub mount: Option<MountSection>,
    /// Displacement from the start of the run, in order of time. Of a plate on a mount it moves the mount. Absent: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1, max = 100000))]
    pub motion: Option<Vec<PlateMotionSection>>,
    /// Vibration in addition to `motion`. Absent: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vibration: Option<PlateVibrationSection>,
    /// Force on the plate besides its weight, in order of time. The plate needs a mount that lets it move along the force.
    /// Absent: none.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 1, max = 100000))]
    pub load: Option<Vec<PlateLoadSection>>,
}

/// Box of a plate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlateBoxSection {
    /// Size in x, y and z, m.
    #[schemars(with = "[Length; 3]")]
    pub size_m: [f64; 3],
    /// Centre of the box relative to the reference point of the plate, m.
    #[serde(default)]
    #[schemars(with = "[Finite; 3]")]
    pub offset_m: [f64; 3],
}

/// Displacement of a plate at a time: linear between entries, from zero at the start of the run, constant after the last.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlateMotionSection {
    /// Time since the start of the run, s.
    #[schemars(with = "Pause")]
    pub time_s: f64,
    /// Displacement in x, y and z, m.
    #[schemars(with = "[Finite; 3]")]
    pub displacement_m: [f64; 3],
}

/// Force on a plate at a time: linear between entries, from zero at the start of the run, constant after the last.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlateLoadSection {
    /// Time since the start of the run, s. One entry at 0: a constant force.
    #[serde(default)]
    #[schemars(with = "Pause")]
    pub time_s: f64,
    /// Force in x, y and z, N.
    #[serde(rename = "force_N")]
    #[schemars(with = "[Finite; 3]")]
    pub force: [f64; 3],
}

/// Sinusoidal vibration of a plate, which grows and dies away over three periods, or half its duration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlateVibrationSection {
    /// Amplitude in x, y and z, m.
    #[schemars(with = "[Finite; 3]")]
    pub amplitude_m: [f64; 3],
    /// Frequency, Hz.
    #[serde(rename = "frequency_Hz")]
    #[schemars(with = "Positive")]
    pub frequency: f64,
    /// Start, s.
    #[serde(default)]
    #[schemars(with = "Pause")]
    pub start_s: f64,
    /// End, s. Absent: the end of the run.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Pause>")]
    pub end_s: Option<f64>,
}
