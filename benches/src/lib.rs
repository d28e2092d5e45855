//! Measurements of the speed of the program, one file per command of `ballast bench`.
//!
//! Contract: compared variants are measured in one run, alternating, from the same states; ratios are taken step by
//! step and reported with their quartiles. No measurement changes the result of a step.

pub mod args;
mod convergence;
mod detection;
mod hoang2012;
mod kernel;
mod kernel_load;
mod machine_info;
mod pools;
mod published;
mod result_sheet;
mod roofline;
mod sample;
mod scene;
mod step;
mod stop_rule;
mod subdomains;
mod variant;
mod work_precision;

pub use convergence::convergence;
pub use detection::detection;
pub use hoang2012::hoang2012;
pub use kernel::kernel;
pub use sample::sample;
pub use step::step;
pub use subdomains::subdomains;
pub use work_precision::work_precision;

use ballast_session::ProgressLabel;
use serde_json::{Value, json};

/// Label of the current part of a measurement.
struct StageLabel(String);

impl ProgressLabel for StageLabel {
    fn text(&self) -> String {
        self.0.clone()
    }

    fn fields(&self) -> Value {
        json!({ "stage": self.0 })
    }
}
