//! `[bed]`: the box, the grains, and how they are poured.

use super::range::{
    Coefficient, Corners, Count, Density, Duration, Fraction, Gravity, Length, Positive, Ratio,
    Seed, Templates,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The bed of grains: a box with a floor, four walls and no lid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Bed {
    /// Inner size of the box in x, y and z, m.
    #[schemars(with = "[Length; 3]")]
    pub size_m: [f64; 3],
    /// Level of the sleepers' underside after preparation, m above the floor.
    #[schemars(with = "Length")]
    pub ballast_depth_m: f64,
    /// Random seed of grains and pouring: the same seed gives the same bed.
    #[serde(default = "default_seed")]
    #[schemars(with = "Seed")]
    pub seed: u64,
    /// Density of the grains, kg/m³.
    #[serde(default = "default_density")]
    #[schemars(with = "Density")]
    pub density_kg_per_m3: f64,
    /// Acceleration of gravity, m/s², downwards.
    #[serde(default = "default_gravity")]
    #[schemars(with = "Gravity")]
    pub gravity_m_per_s2: f64,
    /// Sizes and shapes of the grains.
    #[serde(default)]
    pub grains: Grains,
    /// Coulomb friction of grains with each kind of partner.
    #[serde(default)]
    pub friction: Friction,
    /// Pouring and settling.
    #[serde(default)]
    pub preparation: Preparation,
}

fn default_seed() -> u64 {
    1
}

fn default_density() -> f64 {
    2700.0
}

fn default_gravity() -> f64 {
    9.81
}

/// Random ballast grains: convex hulls of points on ellipsoids.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Grains {
    /// Size classes; their shares sum to 1.
    #[schemars(length(min = 1, max = 100))]
    pub classes: Vec<SizeClass>,
    /// Middle axis over longest axis: mean and half-width of a uniform distribution.
    #[schemars(with = "[Fraction; 2]")]
    pub elongation: [f64; 2],
    /// Shortest axis over middle axis: mean and half-width of a uniform distribution.
    #[schemars(with = "[Fraction; 2]")]
    pub flatness: [f64; 2],
    /// Smallest and largest number of points whose hull a grain is.
    #[schemars(with = "[Corners; 2]")]
    pub vertices: [u32; 2],
    /// 0: points spread evenly over the ellipsoid (rounded grains); 1: fully random (sharp).
    #[schemars(with = "Fraction")]
    pub angularity: f64,
    /// Number of different shapes, shared out over the size classes.
    #[schemars(with = "Templates")]
    pub templates: u32,
}

impl Default for Grains {
    fn default() -> Self {
        Self {
            classes: vec![
                SizeClass { size_m: 0.025, share: 0.5 },
                SizeClass { size_m: 0.0375, share: 0.34 },
                SizeClass { size_m: 0.05, share: 0.16 },
            ],
            elongation: [0.7, 0.1],
            flatness: [0.7, 0.1],
            vertices: [8, 40],
            angularity: 0.5,
            templates: 60,
        }
    }
}

/// One size class of grains.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SizeClass {
    /// Nominal size, m: diameter of the sphere of equal volume, close to the sieve size.
    #[schemars(with = "Length")]
    pub size_m: f64,
    /// Share of the grains, by number.
    #[schemars(with = "Ratio")]
    pub share: f64,
}

/// Coulomb friction of grains with each kind of partner.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Friction {
    /// Grain on grain.
    #[schemars(with = "Coefficient")]
    pub grain: f64,
    /// Grain on sleeper.
    #[schemars(with = "Coefficient")]
    pub sleeper: f64,
    /// Grain on tine.
    #[schemars(with = "Coefficient")]
    pub tine: f64,
    /// Grain on floor and walls.
    #[schemars(with = "Coefficient")]
    pub boundary: f64,
}

impl Default for Friction {
    fn default() -> Self {
        Self { grain: 1.0, sleeper: 1.0, tine: 1.0, boundary: 0.8 }
    }
}

/// How the bed is poured and settled before the run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Preparation {
    /// Level up to which cribs are filled, m above the floor. Absent: the top of the highest
    /// sleeper block, or `bed.ballast_depth_m` where there is none.
    #[schemars(with = "Option<Positive>")]
    pub fill_level_m: Option<f64>,
    /// Friction of grain on grain while pouring and filling, and of walls and sleepers at most; low friction packs denser.
    #[schemars(with = "Coefficient")]
    pub friction: f64,
    /// Time step while pouring, s.
    #[schemars(with = "Duration")]
    pub step_s: f64,
    /// Iterations per step while pouring.
    #[schemars(with = "Count")]
    pub iterations: u32,
    /// The bed rests when the mean speed of the grains is below this, m/s.
    #[schemars(with = "Positive")]
    pub rest_speed_m_per_s: f64,
    /// Longest settling of each stage, and of each of up to three rounds of topping up, s of simulated time. The last
    /// stage, with the run's time step, takes 0.02 s at most.
    #[schemars(with = "Duration")]
    pub max_settling_s: f64,
}

impl Default for Preparation {
    fn default() -> Self {
        Self {
            fill_level_m: None,
            friction: 0.3,
            step_s: 1e-3,
            iterations: 60,
            rest_speed_m_per_s: 5e-3,
            max_settling_s: 2.0,
        }
    }
}
