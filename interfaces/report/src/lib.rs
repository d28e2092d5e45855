//! Charts, pages, and the report of a run.

mod charts;
mod maps;
pub mod plot;
mod run_page;
mod scene_view;
mod section;
mod source;
mod squeezes;

pub use run_page::page;
pub use source::{ReportSource, run_files};
