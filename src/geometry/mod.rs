//! Convex polyhedra: hull, mass properties, clipping, shape descriptors, random ballast grains.

pub(crate) mod plane;
mod polyhedron;

mod clip;
mod faces;
mod grain;
mod hull;
mod mass_properties;
mod shape_descriptors;

pub use clip::{AxisBox, Clipper, HalfSpace, half_spaces_of};
pub use grain::{GrainShape, random_grain, random_rotation, stone_with_corners};
pub use hull::{convex_hull, cuboid};
pub use polyhedron::{Edge, Polyhedron};
pub use shape_descriptors::ShapeDescriptors;
