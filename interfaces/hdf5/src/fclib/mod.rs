//! Published friction-contact problems in the FCLIB form: HDF5 files that give `W`, `q`, `μ`, or the
//! bodies' `M`, `H`, `f`, `w`.
//!
//! [`read()`] takes both forms and all three storages of matrices; [`write_local`] writes the local form,
//! [`write_solution`] a copy with a solution. These files carry no seal: the HDF5 library sees their
//! structure before anything can be checked; every dataset is checked before it is used.

mod matrix;
mod read;
mod write;

pub use read::{Problem, read};
pub use write::{Storage, write_local, write_solution};
