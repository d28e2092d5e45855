//! Nonsmooth contact dynamics of railway ballast, as a stepping component.
//!
//! Rigid convex polyhedra, Signorini-Coulomb contact and Moreau-Jean time stepping, solved by nonlinear Gauss-Seidel
//! with a primal domain decomposition on shared memory. Modules are listed in the order of the data flow through one
//! step; a module uses only modules above it. Equations `(T-n)` are those of `docs/src/theory.md`.
//!
//! The crate is pure: no files, no clock, no environment, no async, no logging.

pub mod cancel;
pub mod error;
pub mod math;

pub mod lanes;

pub mod geometry;

pub mod model;
pub mod window_memory;

pub mod state;

pub mod drive;

pub mod motion;

pub mod detection;

mod contact_graph;
pub mod partition;

pub mod local_problem;
pub mod nlgs;

mod ddm;

mod integrate;

mod force_check;

pub mod workspace;

mod contact_recheck;

pub mod step;

pub mod observe;
pub mod track;

pub mod component;

pub use error::{Error, Result};
