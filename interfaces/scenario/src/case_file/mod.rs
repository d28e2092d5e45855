//! The words of a case file, as they are written; what they mean is in [`crate::resolve`].
//!
//! The doc comments are what people read: they become the descriptions of the JSON Schema. Every
//! key carries its unit, every default is written once, in `Default` or in a `default_` function.

mod bed;
mod layout;
pub mod range;
mod run;
mod tamping;

pub use bed::{Bed, Grains};
pub use layout::{Block, Mode, Mount, Sleeper, SleeperMount, Sleepers, Tine, Tines, Towards};
pub use run::{Run, Solver};
pub use tamping::Tamping;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A Ballast case: a bed of grains, the sleepers in it, and the tamping that is done to it.
///
/// x runs along the track, y across it, z up. The box of the bed spans 0 to its size in x and y;
/// its floor is z = 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Ballast case file")]
pub struct CaseFile {
    /// Name of the case: letters, digits, `_` and `-`. Results are named after it.
    pub name: String,
    /// The bed of grains and how it is prepared.
    pub bed: Bed,
    /// A row of equal sleepers. Without it, only those in `sleeper`.
    pub sleepers: Option<Sleepers>,
    /// Single sleepers, each with its own numbers, beside those of the row.
    #[serde(default)]
    pub sleeper: Vec<Sleeper>,
    /// Facing tines on both sides of every tamped sleeper. Without it, only those in `tine`.
    pub tines: Option<Tines>,
    /// Single tines, each with its own numbers, beside those of the rows.
    #[serde(default)]
    pub tine: Vec<Tine>,
    /// The cycle of the tamping machine. Without it nothing moves by itself.
    pub tamping: Option<Tamping>,
    /// Time stepping and output.
    pub run: Run,
    /// How each step is solved.
    #[serde(default)]
    pub solver: Solver,
}
