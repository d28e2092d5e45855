//! What can go wrong, with the place, what was expected and what was found.

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
    /// The step was refused; the state is exactly that of before the step.
    #[error("step at t = {time_s} s: {place}: expected {expected}, found {found}")]
    Step { time_s: f64, place: String, expected: String, found: String },
}

/// Result of the core.
pub type Result<T> = std::result::Result<T, Error>;
