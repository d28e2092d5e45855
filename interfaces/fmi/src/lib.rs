//! Co-simulation units of Ballast after FMI 2.0 and FMI 3.0.
//!
//! One library for both versions: [`fmi2`] and [`fmi3`] are thin layers of C functions over [`instance`], which advances a
//! [bed](bed_backend): a [`Component`](ballast::component::Component) inside the unit, or one on a server, which it owns over
//! Zenoh. [`package`] writes units: description, library, and the bed with its case or the [component](served_unit) that
//! serves it.
//! Contract: same inputs give the states of the Rust component, bit for bit; a restored instance continues as if it had
//! never been interrupted; no panic leaves a C function. The library links no HDF5 and has no global state, except the
//! threads of Zenoh: the first unit with its bed on a server starts them, and pins the library until the process ends.

mod abi;
pub mod bed;
pub mod bed_backend;
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
#[cfg(all(feature = "zenoh", unix))]
mod library_pin;
mod local_bed;
mod logger;
mod outputs;
pub mod package;
mod resources;
#[cfg(feature = "zenoh")]
mod served_bed;
pub mod served_unit;
pub mod status;
mod unit_state;
pub mod variable_table;
pub mod variables;
