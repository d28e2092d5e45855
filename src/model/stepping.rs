//! Time stepping parameters.

/// Parameters of time stepping (T-1 to T-4) and detection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stepping {
    /// Time step, ns; an integer, so that times are exact sums.
    pub step_ns: u64,
    /// Parameter of the θ-scheme, 1/2 to 1.
    pub theta: f64,
    /// Minimum detection distance of contacts between two bodies, m; larger between fast ones (T-35).
    pub detection_distance: f64,
}

impl Stepping {
    /// Default detection distance over the time step, m/s.
    ///
    /// Smaller values make steps repeat more often because a body was faster; larger ones add contacts that no step
    /// closes.
    const DEFAULT_DETECTION_SPEED: f64 = 0.5;

    /// Returns the default detection distance for a time step, m.
    pub fn default_detection_distance(step_ns: u64) -> f64 {
        Self::DEFAULT_DETECTION_SPEED * step_ns as f64 * 1e-9
    }

    /// Returns the time step `h`, s.
    pub fn h(&self) -> f64 {
        self.step_ns as f64 * 1e-9
    }
}
