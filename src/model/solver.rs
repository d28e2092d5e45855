//! Solver parameters.

/// Order of sweeps over subdomains and interface (T-12).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Schedule {
    /// One set of contacts, no decomposition.
    Sequential,
    /// Subdomains in parallel, then the interface; same results for any number of threads.
    Synchronous,
    /// Interface as one more subdomain of the parallel loop, with the newest values in no fixed order.
    Asynchronous,
}

impl Schedule {
    /// Every schedule.
    pub const ALL: [Schedule; 3] =
        [Schedule::Sequential, Schedule::Synchronous, Schedule::Asynchronous];

    /// Returns the schedule's name in files and recordings.
    pub fn name(self) -> &'static str {
        match self {
            Schedule::Sequential => "sequential",
            Schedule::Synchronous => "synchronous",
            Schedule::Asynchronous => "asynchronous",
        }
    }

    /// Returns the schedule of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|schedule| schedule.name() == name)
    }
}

/// Rule that distributes grains to subdomains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PartitionRule {
    /// Equal boxes that span the grains and mounted bodies: `[1, 1, n]` are layers, `[n, 1, 1]` slabs along x.
    Boxes([u32; 3]),
    /// Number of compact subdomains with equal numbers of contacts.
    Balanced(u32),
    /// Approximate number of contacts of each compact subdomain.
    ContactsPer(u32),
}

impl PartitionRule {
    /// Maximum number of subdomains; more would have no contacts to share.
    pub const MAX_SUBDOMAINS: u64 = 100_000;

    /// Returns the requested number of subdomains; 1 if it follows from the number of contacts.
    pub fn requested_subdomains(self) -> u64 {
        match self {
            Self::Boxes(n) => n.iter().fold(1, |a, b| u64::saturating_mul(a, u64::from(*b))),
            Self::Balanced(n) => u64::from(n),
            Self::ContactsPer(_) => 1,
        }
    }
}

/// Parameters of the contact solver: iteration scheme and stopping rule (T-10 to T-12).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solver {
    /// Order of sweeps over subdomains and interface.
    pub schedule: Schedule,
    /// Distribution of grains to subdomains.
    pub partition: PartitionRule,
    /// Maximum number of DDM iterations per step, `n_DDM`.
    pub max_iterations: u32,
    /// Sweeps over a subdomain per DDM iteration, `n`.
    pub subdomain_sweeps: u32,
    /// Sweeps over the interface per DDM iteration, `m`.
    pub interface_sweeps: u32,
    /// Residual in `norm` below which a step counts as solved; `None` runs all iterations.
    pub tolerance: Option<f64>,
    /// Residual that `tolerance` bounds.
    pub norm: Norm,
    /// DDM iterations from one convergence test to the next; those between skip open contacts (T-12).
    pub convergence_check_interval: u32,
    /// Relaxation factor of each contact visit, above 0, up to 1: `r += relaxation (r⁺ - r)` where `r⁺` is not 0 (T-17).
    pub relaxation: f64,
    /// Factor on the previous step's impulses that the iterations start from, 0 to 1 (T-12).
    ///
    /// 1 takes the fewest iterations and leaves the least penetration, also under mounted tines (decision 006);
    /// 0 starts from zero impulses.
    pub warm_start_factor: f64,
    /// Acceleration of the iterations to a tolerance.
    pub acceleration: Acceleration,
    /// True: the synchronous schedule skips subdomains that have converged until a later convergence test (T-12).
    pub skip_converged_subdomains: bool,
    /// Steps from one force check to the next; 0: none. A check solves the step again from zero impulses, without effect on
    /// the run, and compares the forces on tines and sleepers.
    pub force_check_interval: u32,
    /// Position-level penetration correction; `None` leaves penetration as it is (T-34).
    pub penetration_correction: Option<PenetrationCorrection>,
}

/// Method that accelerates the Gauss-Seidel iterations of the synchronous and sequential schedules.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Acceleration {
    /// Plain sweeps.
    None,
    /// Nonsmooth nonlinear conjugate gradients (T-37).
    Nncg,
}

impl Acceleration {
    /// All methods.
    pub const ALL: [Acceleration; 2] = [Acceleration::None, Acceleration::Nncg];

    /// Name of the method in files.
    pub fn name(self) -> &'static str {
        match self {
            Acceleration::None => "none",
            Acceleration::Nncg => "nncg",
        }
    }
}

/// Position-level penetration correction (T-34): moves penetrating bodies apart without adding velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PenetrationCorrection {
    /// Fraction of the penetration beyond `slop` that a step corrects, above 0, up to 1.
    pub factor: f64,
    /// Penetration that is not corrected, m; smaller values make a bed at rest creep more.
    pub slop: f64,
    /// DDM iterations over the position-level problem.
    pub iterations: u32,
}

impl Default for PenetrationCorrection {
    fn default() -> Self {
        Self { factor: 0.1, slop: 1e-4, iterations: 20 }
    }
}

/// Residual that [`Solver::tolerance`] bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Norm {
    /// LMGC90's quadratic, maximum/16 and impulse-weighted norms together (T-11); usual tolerance 1.666e-4.
    Qm16,
    /// LMGC90's quadratic norm alone; misses newly created contacts.
    Quad,
    /// Scaled natural map (T-10).
    NaturalMap,
}

impl Norm {
    /// Every norm.
    pub const ALL: [Norm; 3] = [Norm::Qm16, Norm::Quad, Norm::NaturalMap];

    /// Returns the norm's name in files of beds, checkpoints and results.
    pub fn name(self) -> &'static str {
        match self {
            Norm::Qm16 => "qm16",
            Norm::Quad => "quad",
            Norm::NaturalMap => "natural map",
        }
    }
}

impl Default for Solver {
    fn default() -> Self {
        Self {
            schedule: Schedule::Synchronous,
            partition: PartitionRule::ContactsPer(4000),
            max_iterations: 1000,
            subdomain_sweeps: 1,
            interface_sweeps: 1,
            tolerance: Some(1.666e-4),
            norm: Norm::Qm16,
            convergence_check_interval: 5,
            relaxation: 1.0,
            warm_start_factor: 1.0,
            acceleration: Acceleration::Nncg,
            skip_converged_subdomains: false,
            force_check_interval: 50,
            penetration_correction: None,
        }
    }
}
