//! Everything constant during a run.
//!
//! Bodies are numbered grains first, `0..grains.len()`, then driven bodies, and among these the
//! mounted ones first. A grain is one convex polyhedron; a driven body (tine, sleeper, wall) is
//! composed of convex parts and half-spaces. Its motion is imposed, or it has a mount: then contacts move
//! it, against springs or loads. Grains and mounted bodies are *mobile*: contacts change their velocities.

mod check;
mod mount;

pub use mount::{DofMode, Mount};

use crate::geometry::Polyhedron;
use crate::math::{Pose, Vec3};

/// What stays the same from step to step.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Shapes that grains and parts refer to `[ns]`.
    pub shapes: Vec<Polyhedron>,
    pub grains: Grains,
    /// Bodies of imposed motion `[nd]`, numbered after the grains.
    pub driven: Vec<DrivenBody>,
    /// Acceleration of gravity, m/s².
    pub gravity: Vec3,
    /// Coulomb friction between grains.
    pub grain_friction: f64,
    /// Newton restitution of every contact, 0 to 1.
    pub restitution: f64,
    pub stepping: Stepping,
    pub solver: Solver,
}

/// The grains, structure of arrays.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Grains {
    /// Index into [`Model::shapes`] `[ng]`.
    pub shape: Vec<u32>,
    /// kg `[ng]`.
    pub mass: Vec<f64>,
    /// Principal moments of inertia in the shape's frame, kg m² `[ng]`.
    pub inertia: Vec<Vec3>,
}

impl Grains {
    /// Number of grains.
    pub fn len(&self) -> usize {
        self.shape.len()
    }

    /// Whether there is no grain.
    pub fn is_empty(&self) -> bool {
        self.shape.is_empty()
    }

    /// Appends a grain of the given shape and density (kg/m³).
    pub fn push(&mut self, shape: u32, polyhedron: &Polyhedron, density: f64) {
        self.shape.push(shape);
        self.mass.push(density * polyhedron.volume);
        self.inertia.push(polyhedron.unit_inertia * density);
    }
}

/// What a driven body is in the track; observables and reports are grouped by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Role {
    /// Floor, wall, box of a sample.
    Boundary,
    Sleeper,
    Tine,
}

impl Role {
    pub const ALL: [Role; 3] = [Role::Boundary, Role::Sleeper, Role::Tine];

    /// The role's name in messages and files.
    pub fn name(self) -> &'static str {
        match self {
            Role::Boundary => "boundary",
            Role::Sleeper => "sleeper",
            Role::Tine => "tine",
        }
    }
}

/// A rigid body of imposed motion, or one that its mount lets contacts move.
#[derive(Debug, Clone, PartialEq)]
pub struct DrivenBody {
    /// Unique name, for people and messages.
    pub name: String,
    pub role: Role,
    /// Friction between this body and grains.
    pub friction: f64,
    /// The body frame's origin is the reference point of its impulses and wrenches.
    pub parts: Vec<Part>,
    /// `None`: the motion is imposed on the body itself, whatever pushes back.
    pub mount: Option<Mount>,
}

/// A convex part of a driven body, in the body's frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Part {
    /// A shape of [`Model::shapes`] placed by `pose`.
    Convex { shape: u32, pose: Pose },
    /// Everything with `normal · x < offset` is solid; `normal` is a unit vector, `offset` in m.
    HalfSpace { normal: Vec3, offset: f64 },
}

/// Time stepping (T-1 to T-4) and detection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stepping {
    /// Time step, ns. An integer, so that times are exact sums.
    pub step_ns: u64,
    /// Parameter of the θ-scheme, 1/2 to 1.
    pub theta: f64,
    /// Contacts are looked for at least up to this distance between two bodies, and further where they
    /// are fast (T-35), m.
    pub detection_distance: f64,
}

impl Stepping {
    /// Alert distance that serves well over the time step, m/s: less, and steps are more often repeated because a body
    /// turned out faster; more, and there are more contacts that no step closes.
    const DEFAULT_DETECTION_SPEED: f64 = 0.5;

    /// The usual alert distance for a time step, m.
    pub fn default_detection_distance(step_ns: u64) -> f64 {
        Self::DEFAULT_DETECTION_SPEED * step_ns as f64 * 1e-9
    }

    /// Time step `h`, s.
    pub fn h(&self) -> f64 {
        self.step_ns as f64 * 1e-9
    }
}

/// In which order subdomains and interface are swept (T-12).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Schedule {
    /// One set of contacts, no decomposition.
    Sequential,
    /// Subdomains in parallel, then the interface: the same bytes for any number of threads.
    Synchronous,
    /// The interface is one more subdomain of the parallel loop; newest values, in no order.
    Asynchronous,
}

impl Schedule {
    pub const ALL: [Schedule; 3] =
        [Schedule::Sequential, Schedule::Synchronous, Schedule::Asynchronous];

    /// The schedule's name in files and recordings.
    pub fn name(self) -> &'static str {
        match self {
            Schedule::Sequential => "sequential",
            Schedule::Synchronous => "synchronous",
            Schedule::Asynchronous => "asynchronous",
        }
    }

    /// The schedule of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|schedule| schedule.name() == name)
    }
}

/// How grains are distributed to subdomains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PartitionRule {
    /// Equal boxes that span the grains and mounted bodies: `[1, 1, n]` are layers, `[n, 1, 1]` slabs along x.
    Boxes([u32; 3]),
    /// This many compact subdomains with equal numbers of contacts.
    Balanced(u32),
    /// Compact subdomains of about this many contacts each.
    ContactsPer(u32),
}

impl PartitionRule {
    /// Most subdomains that may be asked for: more have no contacts left to share.
    pub const MAX_SUBDOMAINS: u64 = 100_000;

    /// How many subdomains are asked for; one where their number follows from that of the contacts.
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
    pub schedule: Schedule,
    pub partition: PartitionRule,
    /// Maximum number of DDM iterations per step, `n_DDM`.
    pub max_iterations: u32,
    /// Sweeps over a subdomain per DDM iteration, `n`.
    pub subdomain_sweeps: u32,
    /// Sweeps over the interface per DDM iteration, `m`.
    pub interface_sweeps: u32,
    /// Residual in `norm` below which a step counts as solved; `None` runs all iterations.
    pub tolerance: Option<f64>,
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

/// Which residual [`Solver::tolerance`] bounds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Norm {
    /// All of LMGC90's quadratic, maximum/16 and impulse-weighted norms (T-11); tolerance 1.666e-4 by habit.
    Qm16,
    /// Its quadratic norm alone; misses newly created contacts.
    Quad,
    /// The natural map, scaled (T-10).
    NaturalMap,
}

impl Norm {
    pub const ALL: [Norm; 3] = [Norm::Qm16, Norm::Quad, Norm::NaturalMap];

    /// The norm's name in files of beds, checkpoints and results.
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
            penetration_correction: None,
        }
    }
}

impl Model {
    /// Largest distance of a point of grain `i` from its centre of mass, m.
    pub fn grain_radius(&self, i: usize) -> f64 {
        self.shapes[self.grains.shape[i] as usize].radius
    }

    /// Number of bodies, grains and driven.
    pub fn body_count(&self) -> usize {
        self.grains.len() + self.driven.len()
    }

    /// Number of driven bodies that are mounted: the first ones.
    pub fn mounted_count(&self) -> usize {
        self.driven.iter().take_while(|d| d.mount.is_some()).count()
    }

    /// Number of bodies whose velocities contacts change: grains and mounted bodies.
    pub fn mobile_count(&self) -> usize {
        self.grains.len() + self.mounted_count()
    }

    /// Index of the driven body called `name`, among the driven bodies.
    pub fn driven_index(&self, name: &str) -> Option<usize> {
        self.driven.iter().position(|d| d.name == name)
    }
}
