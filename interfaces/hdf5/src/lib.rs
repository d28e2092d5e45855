//! Beds, checkpoints and results of Ballast in HDF5 files.
//!
//! [`checkpoint`]: model and state in sealed files, from which a run continues bit for bit. [`results`]: frames and tables
//! of a run, for viewers and programs. [`export`](mod@export): results as VTK XML and CSV.
//! [`inspect`](mod@inspect): summary of a file. [`fclib`]: published friction-contact problems.

pub mod checkpoint;
pub mod export;
pub mod fclib;
pub mod inspect;
pub mod results;

mod error;
mod image;
mod replace;
mod seal;

pub use ballast_columns::state_hash;
pub use error::{Error, Result};
pub use replace::{check_file_kind, clear, replace, replaceable};
