//! Case files (TOML) and neutral samples (JSON): text in, plan or model out. No files: a text is read from what the
//! caller has opened.

mod case_file;
mod check;
mod choices;
mod content_key;
mod diagnostic;
mod document;
mod layout;
mod mount;
mod nearest;
mod read;
#[cfg(test)]
mod reference_tests;
mod renamed;
mod report;
mod resolve;
pub mod sample;
mod schema;
mod structure;
pub mod sweep;
mod text;

pub use choices::{Choices, UnknownChoice};
pub use content_key::content_key;
pub use diagnostic::{CaseErrors, Diagnostic};
pub use read::{Case, read_case};
pub use schema::schema;
pub use text::{LONGEST_CASE, NoText, read_text};
