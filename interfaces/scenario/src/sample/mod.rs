//! Neutral samples, `nscd-sample-1`: a JSON format for the exchange with other programs of nonsmooth contact dynamics. SI
//! units, z up.
//!
//! One object: `format`, `gravity`, `dt`, `theta`, `steps`, `alert`, `friction`, `restitution`,
//! `solver`, `grains`, `fixed`, `meta`.

mod content;
mod file;
mod read;
mod write;

pub use content::{Sample, SampleError};
pub use read::{MAX_SAMPLE_BYTES, read};
pub use write::write;
