//! The track: sleepers, tines, the tamping cycle, and the bed they work in.

pub mod boundary;
mod clearance;
pub mod deposit;
mod force_limited_progress;
mod height_map;
mod machine_control;
pub mod motion_law;
pub(crate) mod mounting;
pub mod plan;
mod plate;
mod pour;
pub mod scene;
mod settle;
mod shape;
pub mod sleeper;
mod squeeze;
mod subgrade;
pub mod tamping_cycle;
#[cfg(test)]
mod test_plan;
pub mod tine;
mod traffic;
pub mod zones;

pub use clearance::{MAX_PROTRUSION, ROUNDING_TOLERANCE, SweptArea, swept_area};
pub use deposit::{Bed, FALL_SPEED, MAX_GRAINS, deposit, empty_bed};
pub use height_map::MAX_CELLS;
pub use machine_control::{MAX_AVERAGING_STEPS, TampingState, TinePair};
pub use plate::{plate_boxes, plate_mount};
pub use pour::CELLS_PER_GRAIN;
pub use scene::scene;
pub use settle::{DepositProgress, DepositStage};
pub use sleeper::sleeper_mount;
pub use squeeze::squeezes;
pub use tamping_cycle::{MIN_STEPS_PER_PERIOD, TampingCycle, TampingPhase, TinePath};
pub use tine::steel_cantilever;
pub use zones::zones;
