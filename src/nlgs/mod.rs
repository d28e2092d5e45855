//! Non-linear Gauss-Seidel: sweeps of contact visits over a set of contacts.
//!
//! [`ContactSet`] is what runs: blocks of eight independent contacts, body velocities as the running
//! state, one arithmetic for every processor. [`mod@reference`] is what it is checked with: the same
//! method written plainly. [`solution`] solves problems given by their Delassus operator ([`assembled`]).

pub mod acceleration;
pub mod assembled;
pub mod block;
pub mod contact_law;
pub mod contact_set;
pub mod global_form;
mod kernel;
pub mod reference;
pub mod residual;
pub mod scenes;
pub mod solution;
#[cfg(test)]
mod tests;
mod visit;

pub use contact_set::{ContactSet, Traffic};
pub use kernel::{Chosen, Operations};
pub use residual::{NaturalMapSums, Residuals, VisitNorms};
