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
    /// Newton's coefficient of restitution, of every contact.
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
    #[serde(with = "Schedule")]
    pub schedule: model::Schedule,
    /// Equal boxes over the grains and what the ballast moves, numbers in x, y and z: `[7, 1, 1]` are seven slabs along x.
    #[schemars(with = "Option<[Count; 3]>")]
    pub boxes: Option<[u32; 3]>,
    /// This many compact subdomains with equal numbers of contacts.
    #[schemars(with = "Option<Count>")]
    pub balanced: Option<u32>,
    /// Compact subdomains of about this many contacts each.
    #[schemars(with = "Option<Count>")]
    pub contacts_per_subdomain: Option<u32>,
    /// Largest number of iterations per step; one is a round over subdomains and interface.
    #[schemars(with = "Count")]
    pub iterations: u32,
    /// Sweeps over a subdomain per iteration.
    #[schemars(with = "Count")]
    pub subdomain_sweeps: u32,
    /// Sweeps over the interface per iteration.
    #[schemars(with = "Count")]
    pub interface_sweeps: u32,
    /// A step is solved when its residual (`norm`) is below this; 0: always all iterations, without momentum.
    #[schemars(with = "NonNegative")]
    pub tolerance: f64,
    /// Which residual `tolerance` bounds.
    #[serde(with = "Norm")]
    pub norm: model::Norm,
    /// Iterations between two convergence tests; those between leave open contacts out.
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
    /// Iterations over the problem of positions.
    #[schemars(with = "Count")]
    pub iterations: u32,
}

impl From<model::PenetrationCorrection> for Recovery {
    fn from(recovery: model::PenetrationCorrection) -> Self {
        let model::PenetrationCorrection { factor: share, slop: allowed, iterations } = recovery;
        Self { share, allowed_m: allowed, iterations }
    }
}

impl Default for Recovery {
    fn default() -> Self {
        model::PenetrationCorrection::default().into()
    }
}

impl Default for Solver {
    /// The core's; how it divides a bed holds where none of the three ways is asked for.
    fn default() -> Self {
        let core = model::Solver::default();
        Self {
            schedule: core.schedule,
            boxes: None,
            balanced: None,
            contacts_per_subdomain: None,
            iterations: core.max_iterations,
            subdomain_sweeps: core.subdomain_sweeps,
            interface_sweeps: core.interface_sweeps,
            tolerance: core.tolerance.unwrap_or(0.0),
            norm: core.norm,
            check_every: core.convergence_check_interval,
            relaxation: core.relaxation,
            warm_start: core.warm_start_factor,
            momentum: core.acceleration == model::Acceleration::Nncg,
            recovery: core.penetration_correction.map(Recovery::from),
        }
    }
}

/// In which order subdomains and interface are swept.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "model::Schedule", rename_all = "snake_case")]
pub enum Schedule {
    /// One set of contacts, no decomposition.
    Sequential,
    /// Subdomains in parallel, then the interface: the same bytes for any number of threads.
    Synchronous,
    /// Interface and subdomains together, newest values, in no order.
    Asynchronous,
}

/// A measure of how well a step is solved.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "model::Norm", rename_all = "snake_case")]
pub enum Norm {
    /// The strictest of the quadratic, maximum/16 and impulse-weighted norms.
    Qm16,
    /// The quadratic norm alone; misses newly created contacts.
    Quad,
    /// The natural map, scaled.
    NaturalMap,
}
