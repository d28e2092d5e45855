//! Primal domain decomposition: alternating sweeps over subdomains and interface (T-12).
//!
//! Orders sweeps; computes no contact. Reads: partition, local problem. Writes: the decomposition's
//! body velocities and impulses. Cost: visits. Contract: the sequential and synchronous schedules give
//! the same bytes for any number of threads; with one subdomain all three schedules do.

mod anderson;
mod asynchronous;
mod boundary;
mod decomposition;
mod iteration;
mod nncg;
mod restart_cycle;
mod solve;
mod sweep_scheduler;
mod sweep_set;
mod synchronous;

pub use decomposition::Decomposition;
pub use iteration::SolveOutcome;
pub use solve::solve;

#[cfg(test)]
mod tests;
