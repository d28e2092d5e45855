//! Coupling schemes between a served component and a partner, such as a model of a machine.
//!
//! The [`Partner`] moves bodies and feels the forces of the ballast on them. A [`Coupling`] advances both sides in windows:
//! in parallel, staggered, or implicitly with fixed relaxation, Aitken's factor or IQN-ILS. It uses the published
//! requests `advance` and `redo` only. The schemes are those of `ballast.couple` in Python.

mod coupling;
mod error;
mod guess;
mod motion;
mod partner;
mod settings;
mod simulation;

pub use coupling::{Coupling, Window};
pub use error::Error;
pub use motion::{ForceRows, MotionRow, MotionRows};
pub use partner::{Partner, PartnerError};
pub use settings::{CouplingAcceleration, CouplingSettings, Scheme};
pub use simulation::Simulation;
