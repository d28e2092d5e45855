//! Everything constant during a run.
//!
//! Bodies are numbered grains first, `0..grains.len()`, then driven bodies, and among these the
//! mounted ones first. A grain is one convex polyhedron; a driven body (tine, sleeper, wall) is
//! composed of convex parts and half-spaces. Its motion is imposed, or it has a mount: then contacts move
//! it, against springs or loads. Grains and mounted bodies are *mobile*: contacts change their velocities.

mod check;
mod mount;
mod solver;
mod stepping;

pub use mount::{DofMode, Mount};
pub use solver::{Acceleration, Norm, PartitionRule, PenetrationCorrection, Schedule, Solver};
pub use stepping::Stepping;

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
