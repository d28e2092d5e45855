//! Errors of the core, with the place, what was expected and what was found.

use crate::cancel::StopReason;

/// Errors of the core. Not converging is a report ([`crate::step::StepReport`]), not an error.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// A set of points is no usable convex polyhedron.
    #[error("polyhedron: expected {expected}, found {found}")]
    Geometry { expected: &'static str, found: String },
    /// A constant of the model is unusable.
    #[error("model: {place}: expected {expected}, found {found}")]
    Model { place: String, expected: String, found: String },
    /// The state does not fit the model, or holds a value that is not finite.
    #[error("state: {place}: expected {expected}, found {found}")]
    State { place: String, expected: String, found: String },
    /// The input of a step is unusable.
    #[error("input: {place}: expected {expected}, found {found}")]
    Input { place: String, expected: String, found: String },
    /// The step failed; the state is exactly that of before the step.
    // Times are whole nanoseconds, and not 0.0024000000000000002 s.
    #[error("step at t = {} s: {place}: expected {expected}, found {found}", (time_s * 1e9).round() / 1e9)]
    Step { cause: Cause, time_s: f64, place: String, expected: String, found: String },
    /// The observer cancelled the step; the state is exactly that of before the step.
    #[error("step: cancelled by its observer")]
    Stopped(StopReason),
}

/// Cause of a failed step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Cause {
    /// A body is moved too far in one step, by its motion or by its loads.
    OverSpeed,
    /// A velocity is not finite.
    NotFinite,
    /// Grains are pressed into each other deeper than allowed.
    Penetration,
}

impl Error {
    /// Code of the error in messages.
    pub fn code(&self) -> &'static str {
        match self {
            Error::Step { cause: Cause::OverSpeed, .. } => "over_speed",
            Error::Step { cause: Cause::NotFinite, .. } => "not_finite",
            Error::Step { cause: Cause::Penetration, .. } => "penetration",
            Error::Stopped(_) => "stopped",
            _ => "step_failed",
        }
    }
}

/// Result of the core.
pub type Result<T> = std::result::Result<T, Error>;
