//! `[sleepers]`, `[tines]` and their single forms: what stands in the bed.

use super::range::{
    Count, Damping, Finite, Length, Mass, NonNegative, PairNumber, Positive, RowCount, Stiffness,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A row of equal sleepers along the track.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sleepers {
    /// Number of sleepers in the row; they are called `sleeper_1`, `sleeper_2`, and so on.
    #[serde(default = "default_count")]
    #[schemars(with = "RowCount")]
    pub count: u32,
    /// Distance between neighbours, m. Needed when there is more than one.
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
    pub blocks: Vec<Block>,
    /// Numbers of the sleepers that are tamped, counted from 1.
    #[serde(default)]
    #[schemars(with = "Vec<Count>", length(max = 1000))]
    pub tamped: Vec<u32>,
    /// How ballast and loads move them in the run. Absent: they stand, or follow the lift.
    pub mount: Option<SleeperMount>,
}

fn default_count() -> u32 {
    1
}

/// A block of a sleeper, a box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Block {
    /// Size in x (along the track), y (across) and z, m.
    #[schemars(with = "[Length; 3]")]
    pub size_m: [f64; 3],
    /// The block's centre in y, from the sleeper's centre, m.
    #[serde(default)]
    #[schemars(with = "Finite")]
    pub offset_y_m: f64,
}

/// One sleeper with its own numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sleeper {
    /// Name: letters, digits, `_` and `-`; no other sleeper or tine has it.
    pub name: String,
    /// Centre in x, m.
    #[schemars(with = "Finite")]
    pub x_m: f64,
    /// Centre in y, m.
    #[schemars(with = "Finite")]
    pub y_m: f64,
    /// Blocks: one, or two for a twin-block sleeper.
    #[schemars(length(min = 1, max = 16))]
    pub blocks: Vec<Block>,
    /// Whether the tamping cycle lifts it and the rows of `[tines]` stand beside it.
    #[serde(default)]
    pub tamped: bool,
    /// How ballast and loads move it in the run. Absent: it stands, or follows the lift.
    pub mount: Option<SleeperMount>,
}

/// How a sleeper is held: each of its degrees of freedom by itself. It stands still while the bed is prepared.
///
/// At most three are not held, or all translations are alike.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SleeperMount {
    /// Mass, kg, with what is fastened to it. Absent: that of concrete blocks, 2400 kg/m³.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Mass>")]
    pub mass_kg: Option<f64>,
    /// Along the track.
    pub x: Mode,
    /// Across the track.
    pub y: Mode,
    /// Upwards.
    pub z: Mode,
    /// Rotation about the world's x axis.
    pub about_x: Mode,
    /// Rotation about the world's y axis.
    pub about_y: Mode,
    /// Rotation about the world's z axis.
    pub about_z: Mode,
    /// Stiffness of each sprung translation, N/m. Absent: none is sprung.
    #[serde(rename = "stiffness_N_per_m", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Stiffness>")]
    pub stiffness: Option<f64>,
    /// Damping of each sprung translation, N s/m.
    #[serde(rename = "damping_N_s_per_m")]
    #[schemars(with = "Damping")]
    pub damping: f64,
    /// Stiffness of each sprung rotation, N m/rad. Absent: none is sprung.
    #[serde(rename = "turning_stiffness_N_m_per_rad", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Stiffness>")]
    pub turning_stiffness: Option<f64>,
    /// Damping of each sprung rotation, N m s/rad.
    #[serde(rename = "turning_damping_N_m_s_per_rad")]
    #[schemars(with = "Damping")]
    pub turning_damping: f64,
}

/// What a degree of freedom follows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// The imposed motion, whatever pushes back.
    #[default]
    Held,
    /// Loads and gravity alone.
    Loaded,
    /// The imposed motion, through a spring and a damper; weight is carried by what imposes it.
    Sprung,
}

/// Rows of tines on both sides of every tamped sleeper: one facing pair for each y offset.
///
/// They are called `tine_1_plus` (squeezes towards +x), `tine_1_minus`, `tine_2_plus`, and so on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Tines {
    /// Centre of each facing pair in y, from the sleeper's centre, m.
    #[schemars(with = "Vec<Finite>", length(min = 1, max = 64))]
    pub y_offsets_m: Vec<f64>,
    /// Distance from the sleeper's face to the blade's face before squeezing, m.
    #[serde(default = "default_gap")]
    #[schemars(with = "NonNegative")]
    pub gap_to_sleeper_m: f64,
    /// Size of the blade in x (thickness), y (width) and z (height), m.
    #[serde(default = "default_blade")]
    #[schemars(with = "[Length; 3]")]
    pub blade_m: [f64; 3],
    /// Size of the shaft above the blade in x, y and z, m.
    #[serde(default = "default_shaft")]
    #[schemars(with = "[Length; 3]")]
    pub shaft_m: [f64; 3],
    /// How the blade gives way to the ballast.
    #[serde(default)]
    pub mount: Mount,
}

fn default_gap() -> f64 {
    0.1
}

fn default_blade() -> [f64; 3] {
    [0.022, 0.12, 0.07]
}

fn default_shaft() -> [f64; 3] {
    [0.03, 0.06, 0.45]
}

/// How a blade gives way: a spring and a damper between it and the motion of the machine, equal in
/// all directions.
///
/// A rigid tine between rigid stones has no bounded force: what jams between it and a sleeper cannot
/// yield.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Mount {
    /// true: the tine does not give way at all.
    #[serde(default)]
    pub rigid: bool,
    /// Stiffness of the spring, N/m. Absent: that of the shaft as a steel beam held at its top, in its weaker direction.
    #[serde(default, rename = "stiffness_N_per_m", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Stiffness>")]
    pub stiffness: Option<f64>,
    /// Mass that moves with the blade, kg. Absent: that of such a beam with the blade at its end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Mass>")]
    pub mass_kg: Option<f64>,
    /// Damping, as a share of the critical one.
    #[serde(default = "default_damping_ratio")]
    #[schemars(with = "Damping")]
    pub damping_ratio: f64,
}

impl Default for Mount {
    fn default() -> Self {
        Self {
            rigid: false,
            stiffness: None,
            mass_kg: None,
            damping_ratio: default_damping_ratio(),
        }
    }
}

fn default_damping_ratio() -> f64 {
    0.1
}

/// One tine with its own numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Tine {
    /// Name: letters, digits, `_` and `-`; no other sleeper or tine has it.
    pub name: String,
    /// Middle of the blade in x before squeezing, m.
    #[schemars(with = "Finite")]
    pub x_m: f64,
    /// Middle of the blade in y, m.
    #[schemars(with = "Finite")]
    pub y_m: f64,
    /// Where the squeeze moves it.
    pub towards: Towards,
    /// Tines with the same number close together and share one force limit. The rows of `[tines]`
    /// take the numbers from 0 upwards.
    #[schemars(with = "PairNumber")]
    pub pair: u32,
    /// Size of the blade in x (thickness), y (width) and z (height), m.
    #[serde(default = "default_blade")]
    #[schemars(with = "[Length; 3]")]
    pub blade_m: [f64; 3],
    /// Size of the shaft above the blade in x, y and z, m.
    #[serde(default = "default_shaft")]
    #[schemars(with = "[Length; 3]")]
    pub shaft_m: [f64; 3],
    /// How the blade gives way to the ballast.
    #[serde(default)]
    pub mount: Mount,
}

/// Direction of a squeeze.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Towards {
    /// Along the track, forwards.
    #[serde(rename = "+x")]
    PlusX,
    /// Along the track, backwards.
    #[serde(rename = "-x")]
    MinusX,
}
