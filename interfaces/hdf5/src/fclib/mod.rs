//! Published friction-contact problems in the FCLIB format: HDF5 files with `W`, `q`, `μ`, or the
//! bodies' `M`, `H`, `f`, `w`.
//!
//! [`read()`] takes both forms and all three storages of matrices; [`write_local`] writes the local form,
//! [`write_solution`] a copy with a solution. These files have no seal: the HDF5 library reads their
//! structure before anything can be checked; every dataset is checked before it is used.

mod matrix;
mod read;
mod write;

pub use read::{FclibProblem, read};
pub use write::{Storage, write_local, write_solution};
