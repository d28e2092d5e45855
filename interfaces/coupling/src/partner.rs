//! Models that move bodies of a simulation.

use crate::motion::{ForceRows, MotionRows};

/// Error of a partner.
pub type PartnerError = Box<dyn std::error::Error + Send + Sync>;

/// Model that moves bodies of a simulation.
pub trait Partner {
    /// State of the model.
    type State;

    /// Advances the model from `t0` to `t1` (s since the start of the run) and returns the motion at `t1`.
    ///
    /// `forces` has a row for every step of the window and every driven body. The motion has the same bodies in every
    /// window.
    ///
    /// # Errors
    /// The model cannot compute the window.
    fn advance(&mut self, t0: f64, t1: f64, forces: &ForceRows)
    -> Result<MotionRows, PartnerError>;

    /// Returns the state of the model, which later windows do not change.
    fn save(&self) -> Self::State;

    /// Restores a state of [`Partner::save`].
    fn restore(&mut self, state: &Self::State);
}
