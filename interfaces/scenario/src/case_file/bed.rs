//! `[bed]`: the box, its grains, and their preparation.

use super::range::{
    Coefficient, ContactStiffness, Corners, Count, Cycles, Density, Duration, Fraction, Gravity,
    Length, NonNegative, Positive, PositiveOrInfinite, Ratio, Seed, ShapeCount,
};
use super::walls::WallsSection;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The bed of grains: a box with a floor, four walls and no lid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BedSection {
    /// Inner size of the box in x, y and z, m.
    #[schemars(with = "[Length; 3]")]
    pub size_m: [f64; 3],
    /// Level of the sleepers' underside after preparation, m above the floor.
    #[schemars(with = "Length")]
    pub sleeper_underside_z_m: f64,
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
    pub grains: GrainsSection,
    /// Coulomb friction of grains with each kind of partner.
    #[serde(default)]
    pub friction: FrictionSection,
    /// Stiffness of the contacts of grains with each kind of partner.
    #[serde(default)]
    pub stiffness: StiffnessSection,
    /// Floor and walls with their own friction or stiffness.
    #[serde(default)]
    pub walls: WallsSection,
    /// Pouring and settling.
    #[serde(default)]
    pub preparation: PreparationSection,
    /// Soil under the floor. Absent: a rigid floor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subgrade: Option<SubgradeSection>,
    /// Traffic over the bed after it has been poured. Absent: a bed that has carried nothing.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub traffic: Option<TrafficSection>,
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

/// Soil under the floor: springs and dampers spread over its area (Winkler foundation).
///
/// The floor moves vertically as a whole, without tilting.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SubgradeSection {
    /// Modulus of subgrade reaction: pressure over settlement, N/m³. Soft soil has some 2e7, firm soil 1e8.
    #[serde(rename = "modulus_N_per_m3")]
    #[schemars(with = "Positive")]
    pub modulus: f64,
    /// Damping over critical damping; a rigid footing on soil radiates 0.4 and more.
    #[serde(default = "default_subgrade_damping")]
    #[schemars(with = "NonNegative")]
    pub damping_ratio: f64,
    /// Mass of soil that moves with the floor, per area, kg/m².
    #[serde(default = "default_subgrade_mass")]
    #[schemars(with = "Positive")]
    pub mass_kg_per_m2: f64,
}

fn default_subgrade_damping() -> f64 {
    0.4
}

/// Some 0.3 m of soil.
fn default_subgrade_mass() -> f64 {
    500.0
}

/// Traffic over the bed: vertical load cycles on every sleeper, which compact the ballast under it.
///
/// The sleepers settle. They are then at `sleeper_underside_z_m`: bed and floor are moved up by the settlement. The cribs
/// are filled up again.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TrafficSection {
    /// Number of load cycles; with `settlement_limit_m` their maximum.
    #[schemars(with = "Cycles")]
    pub cycles: u32,
    /// Largest load on each sleeper, N.
    #[serde(rename = "max_load_N")]
    #[schemars(with = "Positive")]
    pub max_load: f64,
    /// Smallest load between two cycles, N.
    #[serde(rename = "min_load_N", default)]
    #[schemars(with = "NonNegative")]
    pub min_load: f64,
    /// Load cycles per second, Hz.
    #[serde(rename = "frequency_Hz")]
    #[schemars(with = "Positive")]
    pub frequency: f64,
    /// Settlement of a cycle below which the traffic ends, m. 0: after all cycles.
    #[serde(default)]
    #[schemars(with = "NonNegative")]
    pub settlement_limit_m: f64,
}

/// Ballast grains: convex hulls of random points on ellipsoids, or given stones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct GrainsSection {
    /// Size classes; their number fractions sum to 1.
    #[schemars(length(min = 1, max = 100))]
    pub classes: Vec<SizeClassSection>,
    /// Sieve curve by mass, from 0 to 1; between its points it is linear in the logarithm of the sieve size. Absent: the
    /// grains have `classes`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(length(min = 2, max = 100))]
    pub grading: Option<Vec<GradingPointSection>>,
    /// Ratio of the middle axis to the longest axis: mean and half-width of a uniform distribution.
    #[schemars(with = "[Fraction; 2]")]
    pub elongation: [f64; 2],
    /// Ratio of the shortest axis to the middle axis: mean and half-width of a uniform distribution.
    #[schemars(with = "[Fraction; 2]")]
    pub flatness: [f64; 2],
    /// Minimum and maximum number of points whose convex hull is the grain.
    #[schemars(with = "[Corners; 2]")]
    pub vertices: [u32; 2],
    /// Randomness of the points on the ellipsoid. 0: evenly spread (rounded grains); 1: fully random (sharp grains). Not
    /// the shape descriptor "angularity" of Krumbein or Wadell.
    #[schemars(with = "Fraction")]
    pub angularity: f64,
    /// Number of different grain shapes, distributed over the size classes.
    #[schemars(with = "ShapeCount")]
    pub shape_count: u32,
    /// Stones of which the bed consists, in turn and scaled to its sizes. `ballast stones` makes them from surface meshes.
    /// Absent: random shapes.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(length(max = 1000))]
    pub stones: Vec<StoneSection>,
}

/// A convex stone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StoneSection {
    /// Corners, each with x, y and z, in any unit of length.
    #[schemars(length(min = 4, max = 100))]
    pub corners: Vec<[f64; 3]>,
}

impl Default for GrainsSection {
    fn default() -> Self {
        let class = |size_m, number_fraction| SizeClassSection { size_m, number_fraction };
        Self {
            classes: vec![class(0.025, 0.5), class(0.0375, 0.34), class(0.05, 0.16)],
            grading: None,
            elongation: [0.7, 0.1],
            flatness: [0.7, 0.1],
            vertices: [8, 40],
            angularity: 0.5,
            shape_count: 60,
            stones: vec![],
        }
    }
}

/// One size class of grains.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SizeClassSection {
    /// Nominal size, m: diameter of the sphere of equal volume, close to the sieve size.
    #[schemars(with = "Length")]
    pub size_m: f64,
    /// Fraction of the number of grains in this class. Gradings such as EN 13450 are by mass: see `grading`.
    #[schemars(with = "Ratio")]
    pub number_fraction: f64,
}

/// Point of a sieve curve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GradingPointSection {
    /// Side of the square holes of the sieve, m.
    #[schemars(with = "Length")]
    pub sieve_m: f64,
    /// Fraction of the mass that passes the sieve.
    #[schemars(with = "Fraction")]
    pub passing: f64,
}

/// Coulomb friction of grains with each kind of partner.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FrictionSection {
    /// Friction coefficient between two grains.
    #[schemars(with = "Coefficient")]
    pub grain: f64,
    /// Friction coefficient between grain and sleeper.
    #[schemars(with = "Coefficient")]
    pub sleeper: f64,
    /// Friction coefficient between grain and tine.
    #[schemars(with = "Coefficient")]
    pub tine: f64,
    /// Friction coefficient between grain and floor or wall.
    #[schemars(with = "Coefficient")]
    pub boundary: f64,
}

impl Default for FrictionSection {
    fn default() -> Self {
        Self { grain: 1.0, sleeper: 1.0, tine: 1.0, boundary: 0.8 }
    }
}

/// Stiffness of the contact points of grains with each kind of partner (T-42); `inf`: rigid.
///
/// Rough contacts of real stones have some 1e6 to 1e8 N/m. Compliant contacts make contact forces unique, let the solver
/// converge in fewer iterations, and give the bed a stiffness that can be compared with measurements.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StiffnessSection {
    /// Normal stiffness of a contact point between two grains, N/m. Absent: rigid.
    #[serde(rename = "grain_N_per_m", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<ContactStiffness>")]
    pub grain: Option<f64>,
    /// Normal stiffness between grain and sleeper, N/m. Absent: that between grains.
    #[serde(rename = "sleeper_N_per_m", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<ContactStiffness>")]
    pub sleeper: Option<f64>,
    /// Normal stiffness between grain and tine, N/m. Absent: that between grains.
    #[serde(rename = "tine_N_per_m", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<ContactStiffness>")]
    pub tine: Option<f64>,
    /// Normal stiffness between grain and floor or wall, N/m. Absent: that between grains.
    #[serde(rename = "boundary_N_per_m", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<ContactStiffness>")]
    pub boundary: Option<f64>,
    /// Tangential stiffness over normal stiffness; `inf`: contacts stick rigidly.
    #[schemars(with = "PositiveOrInfinite")]
    pub tangential_ratio: f64,
    /// Relaxation time of the damping, s: a growing overlap adds its rate times the stiffness times this time to the force.
    #[schemars(with = "Fraction")]
    pub damping_s: f64,
}

impl Default for StiffnessSection {
    fn default() -> Self {
        Self {
            grain: None,
            sleeper: None,
            tine: None,
            boundary: None,
            tangential_ratio: 1.0,
            damping_s: 0.0,
        }
    }
}

/// Pouring and settling of the bed before the run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PreparationSection {
    /// Level up to which cribs are filled, m above the floor. Absent: the top of the highest
    /// sleeper block, or `bed.sleeper_underside_z_m` without sleepers.
    #[schemars(with = "Option<Positive>")]
    pub fill_level_m: Option<f64>,
    /// Friction coefficient between grains while pouring and filling, and upper bound of that of walls and sleepers. Low
    /// friction packs denser.
    #[schemars(with = "Coefficient")]
    pub friction: f64,
    /// Time step while pouring, s.
    #[schemars(with = "Duration")]
    pub step_s: f64,
    /// Number of iterations per step while pouring.
    #[schemars(with = "Count")]
    pub iterations: u32,
    /// Mean speed of the grains below which the bed counts as settled, m/s.
    #[schemars(with = "Positive")]
    pub settled_speed_m_per_s: f64,
    /// Maximum duration of each settling stage, s of simulated time. Each of up to three rounds of topping up may take as
    /// long. The last stage, with the run's time step, takes 0.02 s at most.
    #[schemars(with = "Duration")]
    pub max_settling_s: f64,
}

impl Default for PreparationSection {
    fn default() -> Self {
        Self {
            fill_level_m: None,
            friction: 0.3,
            step_s: 1e-3,
            iterations: 60,
            settled_speed_m_per_s: 5e-3,
            max_settling_s: 2.0,
        }
    }
}
