//! Collision detection: broad phase, narrow phase, identity of contacts from step to step.
//!
//! Contacts are a function of the configuration and of the detection range (T-35). Pair lists and separating axes
//! cached from earlier steps affect cost only, never results.

mod broad_phase;
mod contacts;
mod covered;
mod detector;
mod grid;
mod history;
mod matching;
mod narrow_phase;
mod range;
mod travel;

pub use contacts::Contacts;
pub use detector::Detector;
pub use history::ContactHistory;
pub use matching::{match_contacts, open_impulse, store_contacts};
pub use range::{DetectionRange, max_point_speed};
