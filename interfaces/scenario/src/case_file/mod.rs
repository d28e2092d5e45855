//! Serde structures of a case file; [`crate::resolve`] converts them to a plan.
//!
//! The doc comments are what people read: they become the descriptions of the JSON Schema. Every
//! key carries its unit, every default is written once, in `Default` or in a `default_` function.

mod bed;
mod layout;
mod plate;
pub mod range;
mod run;
mod tamping;
mod walls;

pub use bed::{BedSection, GrainsSection, SizeClassSection, StiffnessSection, TrafficSection};
pub use layout::{
    BlockSection, DofModeName, MountSection, SleeperRow, SleeperSection, SqueezeDirection,
    TineMountSection, TinePartSection, TineRows, TineSection,
};
pub use plate::{PlateBoxSection, PlateLoadSection, PlateMotionSection, PlateSection};
pub use run::{PartitionMethod, RunSection, SolverSection};
pub use tamping::{LoadCyclesSection, TampingSection};
pub use walls::WallsSection;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A Ballast case: a bed of grains, the sleepers or plates in it, and the tamping cycle.
///
/// x runs along the track, y across it, z up. The box of the bed spans 0 to its size in x and y;
/// its floor is z = 0.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Ballast case file")]
pub struct CaseFile {
    /// Name of the case: letters, digits, `_` and `-`. Results are named after it.
    pub name: String,
    /// Bed of grains and its preparation.
    pub bed: BedSection,
    /// Row of equal sleepers. Without it, only those in `sleeper`.
    pub sleepers: Option<SleeperRow>,
    /// Single sleepers in addition to those of the row.
    #[serde(default)]
    pub sleeper: Vec<SleeperSection>,
    /// Facing tines on both sides of every tamped sleeper. Without it, only those in `tine`.
    pub tines: Option<TineRows>,
    /// Single tines in addition to those of the rows.
    #[serde(default)]
    pub tine: Vec<TineSection>,
    /// Plates in and on the bed, for laboratory tests.
    #[serde(default)]
    pub plate: Vec<PlateSection>,
    /// Cycle of the tamping machine. Without it, sleepers and tines move only where a partner moves them.
    pub tamping: Option<TampingSection>,
    /// Time stepping and output.
    pub run: RunSection,
    /// Solution of each step.
    #[serde(default)]
    pub solver: SolverSection,
}
