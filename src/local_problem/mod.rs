//! Frictional contact problem of a step, contact by contact, ready to be packed and swept.
//!
//! Reads: model, state (restitution needs the velocities at the start of the step), motion,
//! contacts, warm-start impulses. Writes: [`LocalProblem`]. Theory: (T-5) to (T-8), (T-15), (T-16). Cost: O(contacts
//! + grains), parallel. Contract: the result does not depend on the number of threads.
//!
//! Geometry is rounded to f32 once, here, and everything else (the third axis, the Delassus blocks)
//! is derived from the rounded values: `H` and its transpose are the same numbers, so linear
//! momentum is exact to rounding of f64. Rounding of the levers changes angular momentum by 1e-7 of
//! an impulse times its lever.

pub mod contact;
mod lane_builder;
mod positions;
mod problem;
pub(crate) mod rows;

pub use contact::LocalContact;
pub use positions::VelocitySolution;
pub use problem::LocalProblem;
