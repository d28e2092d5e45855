//! Measurements of the program's speed, one file per command.
//!
//! Contract: what is compared is measured in one run, in turn, from the same state; ratios are taken turn
//! by turn, and told with their spread. Nothing here changes what a step computes.

pub mod args;
pub mod cost;
pub mod detection;
pub mod iterations;
pub mod kernel;
mod loads;
mod machine;
mod pools;
mod published;
mod roof;
mod rule;
pub mod sample;
mod scene;
mod shared_args;
mod sheet;
pub mod step;
pub mod subdomains;
pub mod tables;
mod trial;

use ballast_session::ProgressLabel;
use serde_json::{Value, json};

/// Where a measurement stands.
struct Said(String);

impl ProgressLabel for Said {
    fn text(&self) -> String {
        self.0.clone()
    }

    fn fields(&self) -> Value {
        json!({ "what": self.0 })
    }
}
