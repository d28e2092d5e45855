//! One time step, from state to state.

use crate::math::Vec3;
pub use crate::nlgs::Residuals;

/// The phases of a step, in order; the words of profiles, recordings and docs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Phase {
    Predict,
    BroadPhase,
    NarrowPhase,
    WarmStart,
    Partition,
    LocalProblem,
    ContactGraph,
    Solve,
    Integrate,
    Store,
}

impl Phase {
    /// All phases in the order of the step.
    pub const ALL: [Phase; 10] = [
        Phase::Predict,
        Phase::BroadPhase,
        Phase::NarrowPhase,
        Phase::WarmStart,
        Phase::Partition,
        Phase::LocalProblem,
        Phase::ContactGraph,
        Phase::Solve,
        Phase::Integrate,
        Phase::Store,
    ];

    /// The phase's name in profiles and files.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Predict => "predict",
            Phase::BroadPhase => "broad phase",
            Phase::NarrowPhase => "narrow phase",
            Phase::WarmStart => "warm start",
            Phase::Partition => "partition",
            Phase::LocalProblem => "local problem",
            Phase::ContactGraph => "contact graph",
            Phase::Solve => "solve",
            Phase::Integrate => "integrate",
            Phase::Store => "store",
        }
    }
}

/// Told when a phase ends. The core has no clock: the caller brings one, or `()`.
pub trait Stopwatch {
    /// `phase` has just ended; the next one begins.
    fn lap(&mut self, phase: Phase);
}

impl Stopwatch for () {
    fn lap(&mut self, _phase: Phase) {}
}

/// What a step did. Not converging is told here, not as an error.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StepReport {
    /// Contact points, and how many of them carry an impulse.
    pub contacts: usize,
    pub active_contacts: usize,
    /// Contact points of the interface Γ.
    pub interface_contacts: usize,
    /// Subdomains that hold at least one contact.
    pub subdomains: usize,
    /// DDM iterations, and contact visits over all sweeps.
    pub iterations: u32,
    pub visits: u64,
    pub residuals: Residuals,
    /// Whether the tolerance was reached, or none was asked for.
    pub converged: bool,
    /// Whether asynchronous iterations diverged and were repeated with the guard on.
    pub guarded: bool,
    /// Mean (over penetrating points) and largest penetration, m.
    pub mean_penetration: f64,
    pub max_penetration: f64,
    /// What the ballast did to each driven body `[nd]`.
    pub reactions: Vec<Reaction>,
}

/// What the ballast did to one driven body during a step, about its reference point, world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reaction {
    /// N s.
    pub impulse: Vec3,
    /// N m s.
    pub angular_impulse: Vec3,
    /// Work of the body on the ballast, J.
    pub work: f64,
    /// Contact points that carry an impulse.
    pub contacts: u32,
}

impl Default for Reaction {
    fn default() -> Self {
        Self { impulse: Vec3::zeros(), angular_impulse: Vec3::zeros(), work: 0.0, contacts: 0 }
    }
}
