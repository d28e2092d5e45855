//! Constants of a run.
//!
//! Bodies are numbered grains first, `0..grains.len()`, then driven bodies, and among these the mounted ones first. A
//! grain is one convex polyhedron; a driven body (tine, sleeper, wall) consists of convex parts and half-spaces. Its
//! motion is imposed, or it has a mount: then contacts move it, against springs or loads. Grains and mounted bodies
//! are *mobile*: contacts change their velocities.

pub(crate) mod check;
mod mount;
mod solver;
mod stepping;
mod stiffness;

pub use mount::{DofMode, Mount};
pub use solver::{Acceleration, Norm, PartitionRule, PenetrationCorrection, Schedule, Solver};
pub use stepping::Stepping;
pub use stiffness::ContactStiffness;

use crate::geometry::Polyhedron;
use crate::math::{Pose, Vec3};

/// Constants of a run: shapes, bodies, physical constants and solver parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Shapes of grains and parts `[ns]`.
    pub shapes: Vec<Polyhedron>,
    /// Grains, numbered first.
    pub grains: Grains,
    /// Bodies with imposed motion or a mount `[nd]`, numbered after the grains.
    pub driven: Vec<DrivenBody>,
    /// Acceleration of gravity, m/s².
    pub gravity: Vec3,
    /// Coulomb friction coefficient between grains.
    pub grain_friction: f64,
    /// Stiffness of the contacts between grains.
    pub grain_stiffness: ContactStiffness,
    /// Newton restitution coefficient of every contact, 0 to 1; 0 where a contact is not rigid.
    pub restitution: f64,
    /// Time step and detection distance.
    pub stepping: Stepping,
    /// Solver parameters.
    pub solver: Solver,
}

/// Grains as structure of arrays.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Grains {
    /// Index into [`Model::shapes`] `[ng]`.
    pub shape: Vec<u32>,
    /// Mass, kg `[ng]`.
    pub mass: Vec<f64>,
    /// Principal moments of inertia in the shape's frame, kg m² `[ng]`.
    pub inertia: Vec<Vec3>,
}

impl Grains {
    /// Returns the number of grains.
    pub fn len(&self) -> usize {
        self.shape.len()
    }

    /// True if there is no grain.
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

/// Kind of a driven body in the track; observables and reports are grouped by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Role {
    /// Floor, wall or box of a sample.
    Boundary,
    /// Sleeper.
    Sleeper,
    /// Tine of the tamping unit.
    Tine,
    /// Plate of a test: lid, piston, part of a shear box, vibrating wall.
    Plate,
}

impl Role {
    /// Every role.
    pub const ALL: [Role; 4] = [Role::Boundary, Role::Sleeper, Role::Tine, Role::Plate];

    /// Returns the role's name in messages and files.
    pub fn name(self) -> &'static str {
        match self {
            Role::Boundary => "boundary",
            Role::Sleeper => "sleeper",
            Role::Tine => "tine",
            Role::Plate => "plate",
        }
    }
}

/// Rigid body with imposed motion, or with a mount that lets contacts move it.
#[derive(Debug, Clone, PartialEq)]
pub struct DrivenBody {
    /// Unique name for messages and files.
    pub name: String,
    /// Kind of body.
    pub role: Role,
    /// Friction coefficient between this body and grains.
    pub friction: f64,
    /// Stiffness of the contacts between this body and grains.
    pub stiffness: ContactStiffness,
    /// Parts; the body frame's origin is the reference point of its impulses and wrenches.
    pub parts: Vec<Part>,
    /// Mount; `None` if the motion is imposed on the body itself.
    pub mount: Option<Mount>,
}

/// Convex part of a driven body, in the body's frame.
#[derive(Debug, Clone, PartialEq)]
pub enum Part {
    /// Shape of [`Model::shapes`] at `pose`.
    Convex {
        /// Number of the shape.
        shape: u32,
        /// Pose in the body's frame.
        pose: Pose,
    },
    /// Solid half-space `normal · x < offset`.
    HalfSpace {
        /// Outward unit normal.
        normal: Vec3,
        /// Offset along the normal, m.
        offset: f64,
    },
}

impl Model {
    /// Returns the largest distance of a point of grain `i` from its centre of mass, m.
    pub fn grain_radius(&self, i: usize) -> f64 {
        self.shapes[self.grains.shape[i] as usize].radius
    }

    /// Returns the number of bodies, grains and driven.
    pub fn body_count(&self) -> usize {
        self.grains.len() + self.driven.len()
    }

    /// Returns the number of mounted bodies, which are the first driven bodies.
    pub fn mounted_count(&self) -> usize {
        self.driven.iter().take_while(|d| d.mount.is_some()).count()
    }

    /// Returns the number of bodies whose velocities contacts change: grains and mounted bodies.
    pub fn mobile_count(&self) -> usize {
        self.grains.len() + self.mounted_count()
    }

    /// Returns the stiffness of contacts with antagonist `body`, numbered as the bodies are.
    pub fn contact_stiffness(&self, body: usize) -> &ContactStiffness {
        match body.checked_sub(self.grains.len()) {
            None => &self.grain_stiffness,
            Some(d) => &self.driven[d].stiffness,
        }
    }

    /// Returns true if all contacts are rigid.
    pub fn is_rigid(&self) -> bool {
        self.grain_stiffness.is_rigid() && self.driven.iter().all(|d| d.stiffness.is_rigid())
    }

    /// Returns the index of the driven body called `name`, among the driven bodies.
    pub fn driven_index(&self, name: &str) -> Option<usize> {
        self.driven.iter().position(|d| d.name == name)
    }
}
