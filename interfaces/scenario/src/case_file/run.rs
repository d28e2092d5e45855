//! `[run]` and `[solver]`: time, output and the solution of each step.

use super::range::{
    Count, Duration, Fraction, NonNegative, Pause, Positive, Ratio, Relaxation, Theta,
};
use ballast::model;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Time stepping and output.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Run {
    /// Simulated time, s: a whole number of time steps.
    #[schemars(with = "Duration")]
    pub duration_s: f64,
    /// Time step, s: a whole number of nanoseconds.
    #[serde(default = "default_step")]
    #[schemars(with = "Duration")]
    pub step_s: f64,
    /// Parameter of the θ-scheme; 0.5 keeps energy best.
    #[serde(default = "default_theta")]
    #[schemars(with = "Theta")]
    pub theta: f64,
    /// Contacts are looked for at least up to this distance between two bodies, and further where they are fast, m.
    /// Absent: 0.5 m/s times the time step.
    #[schemars(with = "Option<Positive>")]
    pub alert_m: Option<f64>,
    /// Newton restitution of every contact.
    #[serde(default)]
    #[schemars(with = "Fraction")]
    pub restitution: f64,
    /// Simulated time between two frames of the results, s: a whole number of steps; 0: no
    /// frames. Absent: the whole number of steps nearest to 0.01 s.
    #[schemars(with = "Option<Pause>")]
    pub output_every_s: Option<f64>,
    /// Simulated time between two checkpoints, s: a whole number of steps; 0: only at the end.
    #[serde(default)]
    #[schemars(with = "Pause")]
    pub checkpoint_every_s: f64,
}

fn default_step() -> f64 {
    2e-4
}

fn default_theta() -> f64 {
    0.5
}

/// How each step is solved. At most one of `boxes`, `balanced` and `contacts_per_subdomain`;
/// without any, subdomains of about 4000 contacts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Solver {
    /// In which order subdomains and interface are swept.
    pub schedule: Schedule,
    /// Equal boxes over the grains, numbers in x, y and z: `[7, 1, 1]` are seven slabs along x.
    #[schemars(with = "Option<[Count; 3]>")]
    pub boxes: Option<[u32; 3]>,
    /// This many compact subdomains with equal numbers of contacts.
    #[schemars(with = "Option<Count>")]
    pub balanced: Option<u32>,
    /// Compact subdomains of about this many contacts each.
    #[schemars(with = "Option<Count>")]
    pub contacts_per_subdomain: Option<u32>,
    /// Largest number of DDM iterations per step.
    #[schemars(with = "Count")]
    pub iterations: u32,
    /// Sweeps over a subdomain per DDM iteration.
    #[schemars(with = "Count")]
    pub subdomain_sweeps: u32,
    /// Sweeps over the interface per DDM iteration.
    #[schemars(with = "Count")]
    pub interface_sweeps: u32,
    /// Stop a step when `norm` is below this. Absent: always run all iterations.
    #[schemars(with = "Option<Positive>")]
    pub tolerance: Option<f64>,
    /// Which residual `tolerance` bounds.
    pub norm: Norm,
    /// DDM iterations between two convergence tests; those between leave open contacts out.
    #[schemars(with = "Count")]
    pub check_every: u32,
    /// Relaxation of each contact visit.
    #[schemars(with = "Relaxation")]
    pub relaxation: f64,
    /// Share of the previous step's impulses that a step starts from. 1 needs the fewest sweeps at
    /// rest; below 1, forces that a jam has pressed in fade when the tools have passed.
    #[schemars(with = "Fraction")]
    pub warm_start: f64,
    /// Let iterations to a tolerance have momentum, which saves most of them. false: plain sweeps, to compare with.
    /// The asynchronous schedule has none.
    pub momentum: bool,
    /// Move grains that have been pressed into each other apart again. Absent: penetration is left as it is,
    /// as in most studies.
    pub recovery: Option<Recovery>,
}

/// Recovery of positions: without speed, so that nothing is flung.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Recovery {
    /// Share of what is beyond the allowed penetration that a step takes back.
    #[schemars(with = "Ratio")]
    pub share: f64,
    /// Penetration that is left as it is, m: the less it is, the more a bed at rest creeps.
    #[schemars(with = "NonNegative")]
    pub allowed_m: f64,
    /// DDM iterations over the problem of positions.
    #[schemars(with = "Count")]
    pub iterations: u32,
}

impl Default for Recovery {
    fn default() -> Self {
        let model::Recovery { share, allowed, iterations } = model::Recovery::default();
        Self { share, allowed_m: allowed, iterations }
    }
}

impl Default for Solver {
    fn default() -> Self {
        Self {
            schedule: Schedule::Synchronous,
            boxes: None,
            balanced: None,
            contacts_per_subdomain: None,
            iterations: 1000,
            subdomain_sweeps: 1,
            interface_sweeps: 1,
            tolerance: None,
            norm: Norm::Qm16,
            check_every: 5,
            relaxation: 1.0,
            warm_start: 1.0,
            momentum: true,
            recovery: None,
        }
    }
}

/// In which order subdomains and interface are swept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    /// One set of contacts, no decomposition.
    Sequential,
    /// Subdomains in parallel, then the interface: the same bytes for any number of threads.
    Synchronous,
    /// Interface and subdomains together, newest values, in no order.
    Asynchronous,
}

/// A measure of how well a step is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Norm {
    /// The strictest of the quadratic, maximum/16 and impulse-weighted norms.
    Qm16,
    /// The quadratic norm alone; misses newly created contacts.
    Quad,
    /// The natural map, scaled.
    NaturalMap,
}
