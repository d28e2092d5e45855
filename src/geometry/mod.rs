//! Convex polyhedra: hull, mass properties, clipping, random ballast grains.

pub(crate) mod plane;
pub mod polyhedron;

pub mod clip;
mod faces;
pub mod grain;
pub mod hull;
pub mod mass_properties;

pub use clip::{AxisBox, Clipper, HalfSpace, Piece};
pub use grain::{GrainShape, random_grain, random_rotation};
pub use hull::{convex_hull, cuboid};
pub use polyhedron::{Edge, Polyhedron};
