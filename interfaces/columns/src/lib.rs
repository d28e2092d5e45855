//! Model and state as named columns, the form in which they are hashed, stored and sent.
//!
//! [`columns`]: list of the columns. [`decode`]: the way back, from any [`ColumnReader`]. [`state_hash`]: hash of the columns.
//! [`validate`]: check of what was read. [`bytes`]: columns as one block of bytes, for programs without HDF5.

pub mod bytes;
pub mod columns;
pub mod decode;
pub mod validate;

mod fault;
mod hash;
mod reader;

pub use fault::Fault;
pub use hash::{columns_hash, state_hash};
pub use reader::{ColumnReader, DataKind, Number};
