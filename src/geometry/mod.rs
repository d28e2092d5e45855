//! Convex polyhedra: hull, mass properties, clipping, random ballast grains.

pub mod polyhedron;

pub use polyhedron::{Edge, Polyhedron};
