//! The JSON of a sample, word for word.

use ballast::model;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Name and version of the format.
pub const FORMAT: &str = "nscd-sample-1";

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampleFile {
    pub format: String,
    /// m/s².
    pub gravity: [f64; 3],
    /// s.
    pub dt: f64,
    pub theta: f64,
    pub steps: u64,
    /// m.
    pub alert: f64,
    pub friction: Friction,
    #[serde(default)]
    pub restitution: f64,
    pub solver: Solver,
    pub grains: Vec<Grain>,
    #[serde(default)]
    pub fixed: Vec<Fixed>,
    #[serde(default)]
    pub meta: Value,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Friction {
    pub grain_grain: f64,
    pub grain_wall: f64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Solver {
    /// Sweeps per step; null: until `tolerance` is met.
    #[serde(default)]
    pub iterations: Option<u32>,
    #[serde(default)]
    pub tolerance: Option<f64>,
    #[serde(default = "max_iterations")]
    pub max_iterations: u32,
    #[serde(default = "check_every")]
    pub check_every: u32,
    #[serde(default = "relax")]
    pub relax: f64,
    #[serde(default = "norm", with = "Norm")]
    pub norm: model::Norm,
}

fn max_iterations() -> u32 {
    10_000
}

fn check_every() -> u32 {
    10
}

fn relax() -> f64 {
    1.0
}

fn norm() -> model::Norm {
    model::Norm::Quad
}

/// Norms under the names they have in LMGC90.
#[derive(Serialize, Deserialize)]
#[serde(remote = "model::Norm")]
pub enum Norm {
    Quad,
    #[serde(rename = "QM/16")]
    Qm16,
    NaturalMap,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grain {
    /// Corners in the body frame, m.
    pub vertices: Vec<[f64; 3]>,
    /// m.
    pub position: [f64; 3],
    /// w, x, y, z; body to world.
    pub quaternion: [f64; 4],
    /// kg/m³.
    pub density: f64,
    /// Of the body frame's origin, m/s.
    #[serde(default)]
    pub velocity: [f64; 3],
    /// World axes, rad/s.
    #[serde(default)]
    pub omega: [f64; 3],
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fixed {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Corners in the body frame, m.
    pub vertices: Vec<[f64; 3]>,
    /// m.
    #[serde(default)]
    pub position: [f64; 3],
    /// w, x, y, z; body to world.
    #[serde(default = "no_rotation")]
    pub quaternion: [f64; 4],
}

fn no_rotation() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}
