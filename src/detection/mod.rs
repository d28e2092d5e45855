//! Contacts of a configuration: broad phase, narrow phase, identity from step to step.
//!
//! Contacts are a function of the configuration and of how far they are looked for (T-35): pair lists and separating axes
//! that are kept from earlier steps make it faster, never different.

mod broad_phase;
mod contacts;
mod detector;
mod grid;
mod matching;
mod narrow_phase;
mod range;
mod travel;

pub use contacts::Contacts;
pub use detector::Detector;
pub use matching::{store_contacts, warm_start};
pub use range::{DetectionRange, max_point_speed};
