//! Convex polyhedra: hull, mass properties, clipping, random ballast grains.

pub mod polyhedron;

mod faces;
pub mod hull;
pub mod mass_properties;

pub use hull::{convex_hull, cuboid};
pub use polyhedron::{Edge, Polyhedron};
