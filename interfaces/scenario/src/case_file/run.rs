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
pub struct RunSection {
    /// Simulated time, s: a whole number of time steps.
    #[schemars(with = "Duration")]
    pub duration_s: f64,
    /// Time step, s: a whole number of nanoseconds.
    #[serde(default = "default_step")]
    #[schemars(with = "Duration")]
    pub step_s: f64,
    /// Parameter of the θ-scheme; 0.5 conserves energy best.
    #[serde(default = "default_theta")]
    #[schemars(with = "Theta")]
    pub theta: f64,
    /// Minimum distance between two bodies up to which contacts are detected, m. Fast bodies are detected further away.
    /// Absent: 0.5 m/s times the time step.
    #[schemars(with = "Option<Positive>")]
    pub detection_distance_m: Option<f64>,
    /// Newton's coefficient of restitution, of every contact. Above 0 and with friction, impacts may gain energy, typically
    /// 3 to 5 % (Kane's paradox).
    #[serde(default)]
    #[schemars(with = "Fraction")]
    pub restitution: f64,
    /// Simulated time between two frames of the results, s: a whole number of steps; 0: no
    /// frames. Absent: the whole number of steps nearest to 0.01 s.
    #[schemars(with = "Option<Pause>")]
    pub output_interval_s: Option<f64>,
    /// Simulated time between two checkpoints, s: a whole number of steps; 0: none. Whatever it is, a run writes one at
    /// its end, when it is interrupted, and every five minutes of wall time (`--checkpoint-every`).
    #[serde(default)]
    #[schemars(with = "Pause")]
    pub checkpoint_interval_s: f64,
}

fn default_step() -> f64 {
    2e-4
}

fn default_theta() -> f64 {
    0.5
}

/// Solution of each step: nonlinear Gauss-Seidel iterations over subdomains and their interface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SolverSection {
    /// Order in which subdomains and interface are swept.
    #[serde(with = "ScheduleName")]
    pub schedule: model::Schedule,
    /// Division of the bed into subdomains.
    pub partition: PartitionSection,
    /// Maximum number of iterations per step; one iteration sweeps over all subdomains and the interface.
    #[schemars(with = "Count")]
    pub max_iterations: u32,
    /// Sweeps over a subdomain per iteration.
    #[schemars(with = "Count")]
    pub subdomain_sweeps: u32,
    /// Sweeps over the interface per iteration.
    #[schemars(with = "Count")]
    pub interface_sweeps: u32,
    /// Residual (`norm`) below which a step is solved; 0: always all iterations, without acceleration.
    #[schemars(with = "NonNegative")]
    pub tolerance: f64,
    /// Residual that `tolerance` bounds.
    #[serde(with = "NormName")]
    pub norm: model::Norm,
    /// Iterations between two convergence tests. Iterations without a test leave open contacts out.
    #[schemars(with = "Count")]
    pub convergence_check_interval: u32,
    /// Relaxation factor of each local solve.
    #[schemars(with = "Relaxation")]
    pub relaxation: f64,
    /// Fraction of the previous step's impulses with which a step starts. 1 needs the fewest sweeps at
    /// rest; below 1, forces of jammed grains fade when the tools have passed.
    #[schemars(with = "Fraction")]
    pub warm_start_factor: f64,
    /// Acceleration of the iterations to a tolerance. The asynchronous schedule has none.
    #[serde(with = "AccelerationName")]
    pub acceleration: model::Acceleration,
    /// Skip subdomains that have converged until a later convergence test: less time in large beds, where tools disturb a small
    /// part; more iterations in small ones. Only for the synchronous schedule with acceleration.
    pub skip_converged_subdomains: bool,
    /// Steps from one force check to the next; 0: none. A check solves the step again from zero impulses, without effect on
    /// the run, and compares the forces on tines and sleepers (T-43).
    #[schemars(with = "u32")]
    pub force_check_interval: u32,
    /// Correction of penetrations, on positions only. Absent: penetrations are left as they are, as in most studies.
    pub penetration_correction: Option<PenetrationCorrectionSection>,
}

impl Default for SolverSection {
    /// Returns the core's defaults.
    fn default() -> Self {
        let core = model::Solver::default();
        Self {
            schedule: core.schedule,
            partition: PartitionSection::default(),
            max_iterations: core.max_iterations,
            subdomain_sweeps: core.subdomain_sweeps,
            interface_sweeps: core.interface_sweeps,
            tolerance: core.tolerance.unwrap_or(0.0),
            norm: core.norm,
            convergence_check_interval: core.convergence_check_interval,
            relaxation: core.relaxation,
            warm_start_factor: core.warm_start_factor,
            acceleration: core.acceleration,
            skip_converged_subdomains: core.skip_converged_subdomains,
            force_check_interval: core.force_check_interval,
            penetration_correction: core
                .penetration_correction
                .map(PenetrationCorrectionSection::from),
        }
    }
}

/// Division of the bed into subdomains, each with its own key.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PartitionSection {
    /// Method of the division.
    pub method: PartitionMethod,
    /// Numbers of boxes in x, y and z. Needed for the method `boxes`: `[7, 1, 1]` are seven slabs along x.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<[Count; 3]>")]
    pub boxes: Option<[u32; 3]>,
    /// Number of subdomains. Needed for the method `balanced`.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Count>")]
    pub subdomains: Option<u32>,
    /// Approximate number of contacts of each subdomain, for the method `target_size`. Absent: 4000.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<Count>")]
    pub contacts_per_subdomain: Option<u32>,
}

/// Method that divides a bed into subdomains.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PartitionMethod {
    /// Compact subdomains of about `contacts_per_subdomain` contacts each.
    #[default]
    TargetSize,
    /// Compact `subdomains` with equal numbers of contacts.
    Balanced,
    /// Equal `boxes` over the grains and the bodies with mounts.
    Boxes,
}

/// Penetration correction: moves penetrating grains apart without giving them velocity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PenetrationCorrectionSection {
    /// Fraction of the penetration beyond `slop_m` that a step corrects.
    #[schemars(with = "Ratio")]
    pub factor: f64,
    /// Penetration that is not corrected, m. The smaller it is, the more a bed at rest creeps.
    #[schemars(with = "NonNegative")]
    pub slop_m: f64,
    /// Number of iterations over the position problem.
    #[schemars(with = "Count")]
    pub iterations: u32,
}

impl From<model::PenetrationCorrection> for PenetrationCorrectionSection {
    fn from(core: model::PenetrationCorrection) -> Self {
        let model::PenetrationCorrection { factor, slop, iterations } = core;
        Self { factor, slop_m: slop, iterations }
    }
}

impl Default for PenetrationCorrectionSection {
    fn default() -> Self {
        model::PenetrationCorrection::default().into()
    }
}

/// Order in which subdomains and interface are swept.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "model::Schedule", rename_all = "snake_case")]
pub enum ScheduleName {
    /// One set of contacts, no decomposition.
    Sequential,
    /// Subdomains in parallel, then the interface: the same bytes for any number of threads.
    Synchronous,
    /// Interface and subdomains in parallel with the newest values, in no fixed order.
    Asynchronous,
}

/// Residual that measures the accuracy of a solved step.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "model::Norm", rename_all = "snake_case")]
pub enum NormName {
    /// Maximum of the quadratic, maximum/16 and impulse-weighted norms, the strictest.
    Qm16,
    /// Quadratic norm alone, which misses newly created contacts.
    Quad,
    /// Natural map, scaled.
    NaturalMap,
}

/// Method that accelerates the iterations of a step.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(remote = "model::Acceleration", rename_all = "snake_case")]
pub enum AccelerationName {
    /// Nonsmooth nonlinear conjugate gradients (NNCG), which save most of the iterations.
    Nncg,
    /// Plain Gauss-Seidel sweeps, for comparisons.
    None,
}
