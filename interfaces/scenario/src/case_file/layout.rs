//! `[sleepers]`, `[tines]` and their single forms: the bodies that stand in the bed.

use super::range::{
    Count, Damping, Finite, Length, Mass, NonNegative, PairNumber, Positive, RowCount, Stiffness,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A row of equal sleepers along the track.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SleeperRow {
    /// Number of sleepers in the row, named `sleeper_1`, `sleeper_2`, and so on.
    #[serde(default = "default_count")]
    #[schemars(with = "RowCount")]
    pub count: u32,
    /// Distance between neighbours, m. Needed for more than one sleeper.
    #[schemars(with = "Option<Positive>")]
    pub pitch_m: Option<f64>,
    /// Centre of the first sleeper in x, m. Absent: the row stands in the middle of the box.
    #[schemars(with = "Option<Finite>")]
    pub first_x_m: Option<f64>,
    /// Centre of the sleepers in y, m. Absent: the middle of the box.
    #[schemars(with = "Option<Finite>")]
    pub y_m: Option<f64>,
    /// Blocks of each sleeper: one, or two for a twin-block sleeper.
    #[schemars(length(min = 1, max = 16))]
    pub blocks: Vec<BlockSection>,
    /// Numbers of the tamped sleepers, counted from 1.
    #[serde(default)]
    #[schemars(with = "Vec<Count>", length(max = 1000))]
    pub tamped: Vec<u32>,
    /// Mounts of the sleepers, which let ballast and loads move them in the run. Absent: they stand, or follow the lift.
    pub mount: Option<MountSection>,
}

fn default_count() -> u32 {
    1
}

/// A block of a sleeper, a box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BlockSection {
    /// Size in x (along the track), y (across) and z, m.
    #[schemars(with = "[Length; 3]")]
    pub size_m: [f64; 3],
    /// Centre of the block in y, relative to the sleeper's centre, m.
    #[serde(default)]
    #[schemars(with = "Finite")]
    pub offset_y_m: f64,
}

/// A single sleeper with its own place and blocks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SleeperSection {
    /// Name of letters, digits, `_` and `-`, unique among sleepers, tines and plates.
    pub name: String,
    /// Centre in x, m.
    #[schemars(with = "Finite")]
    pub x_m: f64,
    /// Centre in y, m.
    #[schemars(with = "Finite")]
    pub y_m: f64,
    /// Blocks: one, or two for a twin-block sleeper.
    #[schemars(length(min = 1, max = 16))]
    pub blocks: Vec<BlockSection>,
    /// true: the tamping cycle lifts it, and the rows of `[tines]` stand on both sides of it.
    #[serde(default)]
    pub tamped: bool,
    /// Mount of the sleeper, which lets ballast and loads move it in the run. Absent: it stands, or follows the lift.
    pub mount: Option<MountSection>,
}

/// Mount of a sleeper or plate, with one mode for each degree of freedom. The body stands still during preparation.
///
/// At most three are not prescribed, or all translations have the same mode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MountSection {
    /// Mass, fastened parts included, kg. Absent: that of a sleeper of concrete, 2400 kg/m³, or of a plate of steel,
    /// 7850 kg/m³.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Mass>")]
    pub mass_kg: Option<f64>,
    /// Mode of the translation along the track.
    pub x: DofModeName,
    /// Mode of the translation across the track.
    pub y: DofModeName,
    /// Mode of the vertical translation.
    pub z: DofModeName,
    /// Mode of the rotation about the world's x axis.
    pub rx: DofModeName,
    /// Mode of the rotation about the world's y axis.
    pub ry: DofModeName,
    /// Mode of the rotation about the world's z axis.
    pub rz: DofModeName,
    /// Stiffness of each translation with a spring, N/m. Absent: no translation has one.
    #[serde(rename = "stiffness_N_per_m", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Stiffness>")]
    pub stiffness: Option<f64>,
    /// Damping of each translation with a spring, N s/m.
    #[serde(rename = "damping_N_s_per_m")]
    #[schemars(with = "Damping")]
    pub damping: f64,
    /// Stiffness of each rotation with a spring, N m/rad. Absent: no rotation has one.
    #[serde(rename = "rotational_stiffness_N_m_per_rad", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Stiffness>")]
    pub rotational_stiffness: Option<f64>,
    /// Damping of each rotation with a spring, N m s/rad.
    #[serde(rename = "rotational_damping_N_m_s_per_rad")]
    #[schemars(with = "Damping")]
    pub rotational_damping: f64,
}

/// Mode of one degree of freedom of a mount.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum DofModeName {
    /// Follows the imposed motion, whatever the reaction.
    #[default]
    Prescribed,
    /// Moves under loads and gravity alone.
    Free,
    /// Follows the imposed motion through a spring and a damper, which also carry the weight.
    Spring,
}

/// Rows of tines on both sides of every tamped sleeper: one facing pair for each y offset.
///
/// Their names are `tine_1_plus` (squeezes towards +x), `tine_1_minus`, `tine_2_plus`, and so on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TineRows {
    /// Centre of each facing pair in y, relative to the sleeper's centre, m.
    #[schemars(with = "Vec<Finite>", length(min = 1, max = 64))]
    pub y_offsets_m: Vec<f64>,
    /// Distance from the sleeper's face to the blade's face before squeezing, m.
    #[serde(default = "default_gap")]
    #[schemars(with = "NonNegative")]
    pub gap_to_sleeper_m: f64,
    /// Size of the blade in x (thickness), y (width) and z (height), m.
    #[serde(default = "default_blade_size")]
    #[schemars(with = "[Length; 3]")]
    pub blade_size_m: [f64; 3],
    /// Size of the shaft above the blade in x, y and z, m.
    #[serde(default = "default_shaft_size")]
    #[schemars(with = "[Length; 3]")]
    pub shaft_size_m: [f64; 3],
    /// Convex parts of the tine. `ballast tool` makes them from a surface mesh. Absent: the boxes of blade and shaft.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(length(max = 64))]
    pub parts: Vec<TinePartSection>,
    /// Mount of each blade.
    #[serde(default)]
    pub mount: TineMountSection,
}

/// A convex part of a tine that squeezes towards +x. The tine that squeezes towards -x is its mirror image.
///
/// Origin: the middle of the blade's upper edge. x: direction of the squeeze; y: across the track; z: up. All below the
/// origin counts as the blade.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TinePartSection {
    /// Corners, each with x, y and z, m.
    #[schemars(with = "Vec<[Finite; 3]>", length(min = 4, max = 100))]
    pub corners: Vec<[f64; 3]>,
}

fn default_gap() -> f64 {
    0.1
}

fn default_blade_size() -> [f64; 3] {
    [0.022, 0.12, 0.07]
}

fn default_shaft_size() -> [f64; 3] {
    [0.03, 0.06, 0.45]
}

/// Mount of a blade: a spring and a damper between the blade and the motion of the machine, equal in
/// all directions.
///
/// A rigid tine between rigid grains has no bounded force, because grains that jam between it and a sleeper cannot
/// yield.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TineMountSection {
    /// true: the tine follows the motion of the machine exactly.
    pub rigid: bool,
    /// Stiffness of the spring, N/m. Needed with `parts`. Absent: that of the shaft as a steel cantilever, in its weaker
    /// direction.
    #[serde(rename = "stiffness_N_per_m", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Stiffness>")]
    pub stiffness: Option<f64>,
    /// Mass that moves with the blade, kg. Needed with `parts`. Absent: that of such a cantilever with the blade at its end.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Mass>")]
    pub mass_kg: Option<f64>,
    /// Ratio of the damping to the critical damping.
    #[schemars(with = "Damping")]
    pub damping_ratio: f64,
}

impl Default for TineMountSection {
    fn default() -> Self {
        Self { rigid: false, stiffness: None, mass_kg: None, damping_ratio: 0.1 }
    }
}

/// A single tine with its own place and size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TineSection {
    /// Name of letters, digits, `_` and `-`, unique among sleepers, tines and plates.
    pub name: String,
    /// Middle of the blade in x before squeezing, m.
    #[schemars(with = "Finite")]
    pub x_m: f64,
    /// Middle of the blade in y, m.
    #[schemars(with = "Finite")]
    pub y_m: f64,
    /// Direction in which the squeeze moves the tine.
    pub squeeze_direction: SqueezeDirection,
    /// Number of the tine's pair: tines with the same number close together and share one force limit. The rows of
    /// `[tines]` take the numbers from 0 upwards.
    #[schemars(with = "PairNumber")]
    pub pair: u32,
    /// Size of the blade in x (thickness), y (width) and z (height), m.
    #[serde(default = "default_blade_size")]
    #[schemars(with = "[Length; 3]")]
    pub blade_size_m: [f64; 3],
    /// Size of the shaft above the blade in x, y and z, m.
    #[serde(default = "default_shaft_size")]
    #[schemars(with = "[Length; 3]")]
    pub shaft_size_m: [f64; 3],
    /// Convex parts of the tine. `ballast tool` makes them from a surface mesh. Absent: the boxes of blade and shaft.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    #[schemars(length(max = 64))]
    pub parts: Vec<TinePartSection>,
    /// Mount of the blade.
    #[serde(default)]
    pub mount: TineMountSection,
}

/// Direction of a squeeze.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum SqueezeDirection {
    /// Forwards along the track.
    #[serde(rename = "+x")]
    PlusX,
    /// Backwards along the track.
    #[serde(rename = "-x")]
    MinusX,
}
