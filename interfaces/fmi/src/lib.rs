//! Co-simulation units of Ballast after FMI 2.0 and FMI 3.0.
//!
//! One library for both versions: [`fmi2`] and [`fmi3`] are thin layers of C functions over [`instance`], which advances a
//! [`Component`](ballast::component::Component). [`package`] writes units: description, library, and the bed with its case.
//! Contract: same inputs give the states of the Rust component, bit for bit; a restored instance continues as if it had
//! never been interrupted; no panic leaves a C function. The library links no HDF5 and has no global state.

mod abi;
pub mod bed;
mod description;
mod description2;
mod description3;
pub mod fmi2;
mod fmi2_unsupported;
pub mod fmi3;
mod fmi3_types;
mod fmi3_unsupported;
mod inputs;
pub mod instance;
mod logger;
mod outputs;
pub mod package;
pub mod status;
mod unit_state;
pub mod variable_table;
pub mod variables;
