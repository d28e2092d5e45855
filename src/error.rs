//! Errors of the core, with the place, what was expected and what was found.

use crate::cancel::StopReason;

/// Errors of the core. Not converging is a report ([`crate::step::StepReport`]), not an error.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// Points without a valid convex polyhedron.
    #[error("polyhedron: expected {expected}, found {found}")]
    Geometry {
        /// Valid values.
        expected: &'static str,
        /// Offending value.
        found: String,
    },
    /// Invalid constant of the model.
    #[error("model: {place}: expected {expected}, found {found}")]
    Model {
        /// Name of the offending value.
        place: String,
        /// Valid values.
        expected: String,
        /// Offending value.
        found: String,
    },
    /// State that does not fit the model, or contains a value that is not finite.
    #[error("state: {place}: expected {expected}, found {found}")]
    State {
        /// Name of the offending value.
        place: String,
        /// Valid values.
        expected: String,
        /// Offending value.
        found: String,
    },
    /// Invalid input of a step.
    #[error("input: {place}: expected {expected}, found {found}")]
    Input {
        /// Name of the offending value.
        place: String,
        /// Valid values.
        expected: String,
        /// Offending value.
        found: String,
    },
    /// Failed step; the state is unchanged.
    // Rounded to whole nanoseconds, so that no time reads 0.0024000000000000002 s.
    #[error("step at t = {} s: {place}: expected {expected}, found {found}", (time_s * 1e9).round() / 1e9)]
    Step {
        /// Kind of failure.
        cause: Cause,
        /// Time at the start of the step, s.
        time_s: f64,
        /// Name of the offending value.
        place: String,
        /// Valid values.
        expected: String,
        /// Offending value.
        found: String,
    },
    /// Step cancelled by its observer; the state is unchanged.
    #[error("step: cancelled by its observer")]
    Stopped(StopReason),
}

/// Cause of a failed step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Cause {
    /// Excessive displacement of a body in one step, by its motion or by its loads.
    OverSpeed,
    /// Velocity that is not finite.
    NotFinite,
    /// Penetration of grains beyond the limit.
    Penetration,
}

impl Error {
    /// Returns the code of the error in messages.
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
