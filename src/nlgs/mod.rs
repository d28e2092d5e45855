//! Non-linear Gauss-Seidel: sweeps of contact visits over a set of contacts.
//!
//! [`ContactSet`] is the production implementation: blocks of eight independent contacts, with body velocities as the
//! running state and the same arithmetic on every processor. [`mod@reference`] is the scalar reference. [`solution`]
//! solves problems given by their Delassus operator ([`assembled_problem`]).

pub mod anderson;
pub mod assembled_problem;
pub mod block;
pub mod contact_law;
pub mod contact_set;
pub mod global_problem;
mod kernel;
pub mod lattice_scene;
mod local_solve;
pub mod reference;
pub mod residual;
pub mod solution;
#[cfg(test)]
mod tests;

pub use contact_set::{ContactSet, MemoryTraffic};
pub use kernel::{BlockSubset, OperationCounts};
pub use residual::{ComplementarityGap, ContactLawSums, Residuals, VisitNorms};
