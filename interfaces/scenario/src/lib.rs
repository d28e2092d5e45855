//! Case files (TOML), sweep plans (TOML) and neutral samples (JSON): from text to plan or model.
//!
//! The crate opens no files; callers pass a text or a reader.

mod case_file;
mod check;
mod content_key;
mod diagnostic;
mod document;
mod layout;
mod mount;
mod nearest;
mod notation;
mod overrides;
mod placed_body;
mod plate;
mod read_case;
mod read_text;
#[cfg(test)]
mod reference_tests;
mod renamed;
mod report;
mod resolve;
pub mod sample;
mod schema;
mod schema_check;
#[cfg(test)]
mod schema_check_tests;
mod stiffness;
pub mod sweep;
mod tine_shape;

pub use content_key::content_key;
pub use diagnostic::{CaseDiagnostic, CaseErrors};
pub use overrides::{CaseOverrides, OverrideError};
pub use read_case::{CheckedPlan, read_case};
pub use read_text::{MAX_CASE_BYTES, ReadError, read_text};
pub use schema::schema;
