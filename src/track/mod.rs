//! The track: sleepers, tines, the tamping cycle, and the bed they work in.

pub mod boundary;
mod clearance;
pub mod deposit;
pub mod motion_law;
pub mod plan;
mod pour;
mod relief;
pub mod scene;
mod settle;
mod shape;
pub mod sleeper;
mod squeeze_control;
pub mod tamping_cycle;
#[cfg(test)]
mod test_plan;
pub mod tine;
pub mod zones;

pub use deposit::{Bed, deposit};
pub use scene::scene;
pub use settle::{DepositProgress, DepositStage};
pub use squeeze_control::TinePair;
pub use tamping_cycle::{TampingCycle, TampingPhase};
pub use tine::steel_cantilever;
pub use zones::zones;
