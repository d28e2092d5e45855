//! Coupling schemes and their settings.

use crate::Error;
use std::str::FromStr;

/// Order in which the two sides compute a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scheme {
    /// Both sides compute at once: the partner feels the mean forces of the last window, and the ballast follows the
    /// velocity with which the partner ended it.
    Parallel,
    /// The partner computes first, with the mean forces of the last window; the ballast follows its motion.
    Staggered,
    /// The window is repeated until the motion that the partner computes with the forces of the ballast is the one that
    /// the ballast followed.
    Implicit,
}

/// Method by which the implicit scheme finds the next guess of the motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CouplingAcceleration {
    /// Relaxation by a fixed factor.
    Fixed,
    /// Relaxation by Aitken's factor, which changes in each iteration.
    Aitken,
    /// Quasi-Newton step by least squares over the differences of iterations of this and the last three windows.
    IqnIls,
}

impl FromStr for Scheme {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        match name {
            "parallel" => Ok(Self::Parallel),
            "staggered" => Ok(Self::Staggered),
            "implicit" => Ok(Self::Implicit),
            _ => Err(invalid_setting("scheme", "one of parallel, staggered, implicit", name)),
        }
    }
}

impl FromStr for CouplingAcceleration {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        match name {
            "fixed" => Ok(Self::Fixed),
            "aitken" => Ok(Self::Aitken),
            "iqn-ils" => Ok(Self::IqnIls),
            _ => Err(invalid_setting("acceleration", "one of fixed, aitken, iqn-ils", name)),
        }
    }
}

/// Settings of a coupling.
#[derive(Debug, Clone, PartialEq)]
pub struct CouplingSettings {
    /// Coupling scheme.
    pub scheme: Scheme,
    /// Number of time steps of a window.
    pub window_steps: u32,
    /// Next guess of the implicit scheme.
    pub acceleration: CouplingAcceleration,
    /// Factor of fixed relaxation, and of the first iteration of the others.
    pub relaxation: f64,
    /// Residual at which a window has converged, m.
    pub tolerance: f64,
    /// Maximum number of iterations of a window.
    pub max_iterations: u32,
    /// Length by which rotations count in the residual, m.
    pub lever: f64,
}

impl Default for CouplingSettings {
    fn default() -> Self {
        Self {
            scheme: Scheme::Implicit,
            window_steps: 4,
            acceleration: CouplingAcceleration::IqnIls,
            relaxation: 0.5,
            tolerance: 1e-6,
            max_iterations: 20,
            lever: 0.1,
        }
    }
}

impl CouplingSettings {
    /// Checks the ranges of all settings.
    pub(crate) fn check(&self) -> Result<(), Error> {
        if !(0.0 < self.relaxation && self.relaxation <= 1.0) {
            return Err(invalid_setting(
                "relaxation",
                "a number above 0 and up to 1",
                self.relaxation,
            ));
        }
        for (name, count) in
            [("window_steps", self.window_steps), ("max_iterations", self.max_iterations)]
        {
            if count == 0 {
                return Err(invalid_setting(name, "at least 1", count));
            }
        }
        for (name, length) in [("tolerance", self.tolerance), ("lever", self.lever)] {
            if !(0.0 < length && length.is_finite()) {
                return Err(invalid_setting(name, "a length above 0, m", length));
            }
        }
        Ok(())
    }
}

fn invalid_setting(name: &'static str, expected: &'static str, found: impl ToString) -> Error {
    Error::InvalidSetting { name, expected, found: found.to_string() }
}
