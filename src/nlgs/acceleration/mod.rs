//! Anderson's acceleration of an iteration `r → g(r)` (T-32), for impulses that lie in one or many
//! sets.
//!
//! Each set keeps a [`History`] of its own impulses; a [`Mixing`] adds up what they have in common and
//! says how the last images are combined; a [`Guard`] takes it back when it does harm. Cost: two
//! passes over ten vectors per point. Contract: sums go over the sets in the order given, so the bytes
//! do not depend on who computed them.

mod guard;
mod history;
mod mixing;

pub use guard::{Guard, Verdict};
pub use history::History;
pub use mixing::{Mixing, Products};

/// Steps that a point is made of.
pub const WINDOW: usize = 10;

/// Accelerated points are taken after every third sweep: the sweeps between them settle which
/// contacts slip.
pub const PERIOD: u32 = 3;
