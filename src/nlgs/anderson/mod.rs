//! Anderson acceleration of an iteration `r → g(r)` (T-32), for impulses in one or more sets.
//!
//! Each set keeps a [`History`] of its impulses. An [`AndersonMixing`] sums their products and computes the
//! coefficients of the mixed impulses. A [`Safeguard`] detects divergence. Cost: two passes over ten vectors per mixing.
//! Contract: sums run over the sets in the given order, so bytes do not depend on the number of threads.

mod history;
mod mixing;
mod safeguard;

pub use history::History;
pub use mixing::{AndersonMixing, DEPTH, HistoryProducts};
pub use safeguard::{Safeguard, SafeguardVerdict};

/// Sweeps between two mixings: the sweeps between them settle which contacts slip.
pub const MIXING_PERIOD: u32 = 3;
