//! A component on real sockets: the same states as in one process, and what goes wrong between processes.
//!
//! `BALLAST_FAULTS=100`: every kind of fault comes at least a hundred times.

#[path = "../../../../tests/common/mod.rs"]
mod common;
#[path = "../../../protocol/tests/shaken/mod.rs"]
mod shaken;

mod cut;
mod hostile;
mod lockstep;
mod lossy;
mod observers;
mod owners;
mod proxy;
mod relay;
mod restart;
mod routers;
mod running;
mod security;
mod setup;
