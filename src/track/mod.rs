//! The track: sleepers, tines, the tamping cycle, and the bed they work in.

pub mod boundary;
mod clearance;
pub mod deposit;
mod machine_control;
pub mod motion_law;
mod paced_clock;
pub mod plan;
mod pour;
mod relief;
pub mod scene;
mod settle;
mod shape;
pub mod sleeper;
mod squeeze;
pub mod tamping_cycle;
#[cfg(test)]
mod test_plan;
pub mod tine;
pub mod zones;

pub use clearance::{SLACK, Swept, swept};
pub use deposit::{Bed, FALL_SPEED, MOST_GRAINS, bare, deposit};
pub use machine_control::{LONGEST_WINDOW, TinePair};
pub use pour::CELLS_PER_GRAIN;
pub use relief::MOST_CELLS;
pub use scene::scene;
pub use settle::{DepositProgress, DepositStage};
pub use sleeper::sleeper_mount;
pub use squeeze::squeezes;
pub use tamping_cycle::{LEAST_STEPS_PER_PERIOD, RISEN, TampingCycle, TampingPhase, TinePath};
pub use tine::steel_cantilever;
pub use zones::zones;
