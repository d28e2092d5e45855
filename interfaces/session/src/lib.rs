//! Runs of cases, for every face of the program: their files, records, figures, beds and failures.
//!
//! Nothing here writes to a terminal: messages, events and progress go to a [`Reporter`].

pub mod beds;
pub mod body_overlap;
pub mod case;
pub mod case_stepper;
pub mod driver;
mod error;
pub mod files;
pub mod interrupt;
pub mod lock;
pub mod phase_figures;
pub mod profile;
pub mod quantities;
pub mod record;
pub mod recorder;
pub mod recording_driver;
mod reporter;
pub mod run_files;
pub mod run_recorder;
pub mod statistics;
pub mod stones;
pub mod summary;
pub mod summary_text;
pub mod table;
pub mod threads;
pub mod zones;

pub use error::{Failure, Result};
pub use reporter::{ProgressLabel, ProgressMeter, Reporter};
