//! Checks with known answers, each for every schedule.

#[path = "../common/mod.rs"]
mod common;

mod arch;
mod balance;
mod compliance;
mod flight;
mod flung;
mod flush;
mod freedoms;
mod impact;
mod incline;
mod mount;
mod passing;
mod recovery;
mod rolling;
mod spinning;
mod stack;
mod turning;
