//! The program as people and scripts use it, on a case of some sixty grains.

mod bench;
mod commands;
mod endings;
mod fmu;
mod keeping;
#[cfg(feature = "zenoh")]
mod live_view;
#[cfg(feature = "zenoh")]
mod one_hash;
mod plates;
mod probes;
mod recordings;
#[cfg(feature = "zenoh")]
mod redone;
mod reference;
mod report;
mod restart;
mod results;
mod samples;
#[cfg(feature = "zenoh")]
mod serve;
mod setup;
mod signals;
mod solve;
mod sweeps;
mod tools;
mod validate;
mod windows;
