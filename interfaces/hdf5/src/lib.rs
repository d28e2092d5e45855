//! Beds, checkpoints and results of Ballast in HDF5 files.
//!
//! [`checkpoint`]: model and state, sealed, to go on from bit for bit.

pub mod checkpoint;

mod columns;
mod decode;
mod error;
mod hash;
mod image;
mod seal;
mod validate;

pub use error::{Error, Result};
pub use hash::state_hash;
