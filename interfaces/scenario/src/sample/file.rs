//! Serde structures of the JSON of a sample.

use ballast::model;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Name and version of the format.
pub const FORMAT: &str = "nscd-sample-1";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampleFile {
    pub format: String,
    /// Acceleration of gravity, m/s².
    pub gravity: [f64; 3],
    /// Time step, s.
    pub dt: f64,
    pub theta: f64,
    pub steps: u64,
    /// Detection distance, m.
    pub alert: f64,
    pub friction: SampleFriction,
    #[serde(default)]
    pub restitution: f64,
    pub solver: SampleSolver,
    pub grains: Vec<SampleGrain>,
    #[serde(default)]
    pub fixed: Vec<SampleFixedBody>,
    #[serde(default)]
    pub meta: Value,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampleFriction {
    pub grain_grain: f64,
    pub grain_wall: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampleSolver {
    /// Sweeps per step; null: until the residual is below `tolerance`.
    #[serde(default)]
    pub iterations: Option<u32>,
    #[serde(default)]
    pub tolerance: Option<f64>,
    #[serde(default = "default_max_iterations")]
    pub max_iterations: u32,
    #[serde(default = "default_check_every")]
    pub check_every: u32,
    #[serde(default = "default_relax")]
    pub relax: f64,
    #[serde(default = "default_norm", with = "Lmgc90NormName")]
    pub norm: model::Norm,
}

fn default_max_iterations() -> u32 {
    10_000
}

fn default_check_every() -> u32 {
    10
}

fn default_relax() -> f64 {
    1.0
}

fn default_norm() -> model::Norm {
    model::Norm::Quad
}

/// Norms under their names in LMGC90.
#[derive(Serialize, Deserialize)]
#[serde(remote = "model::Norm")]
pub enum Lmgc90NormName {
    Quad,
    #[serde(rename = "QM/16")]
    Qm16,
    NaturalMap,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampleGrain {
    /// Vertices in the body frame, m.
    pub vertices: Vec<[f64; 3]>,
    /// Origin of the body frame, world axes, m.
    pub position: [f64; 3],
    /// Rotation from body to world, w, x, y, z.
    pub quaternion: [f64; 4],
    /// Density, kg/m³.
    pub density: f64,
    /// Velocity of the body frame's origin, world axes, m/s.
    #[serde(default)]
    pub velocity: [f64; 3],
    /// Angular velocity, world axes, rad/s.
    #[serde(default)]
    pub omega: [f64; 3],
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampleFixedBody {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Vertices in the body frame, m.
    pub vertices: Vec<[f64; 3]>,
    /// Origin of the body frame, world axes, m.
    #[serde(default)]
    pub position: [f64; 3],
    /// Rotation from body to world, w, x, y, z.
    #[serde(default = "no_rotation")]
    pub quaternion: [f64; 4],
}

fn no_rotation() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}
