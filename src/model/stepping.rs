//! Time stepping parameters.

/// Time stepping (T-1 to T-4) and detection.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stepping {
    /// Time step, ns. An integer, so that times are exact sums.
    pub step_ns: u64,
    /// Parameter of the θ-scheme, 1/2 to 1.
    pub theta: f64,
    /// Contacts are looked for at least up to this distance between two bodies, and further where they
    /// are fast (T-35), m.
    pub detection_distance: f64,
}

impl Stepping {
    /// Alert distance that serves well over the time step, m/s: less, and steps are more often repeated because a body
    /// turned out faster; more, and there are more contacts that no step closes.
    const DEFAULT_DETECTION_SPEED: f64 = 0.5;

    /// The usual alert distance for a time step, m.
    pub fn default_detection_distance(step_ns: u64) -> f64 {
        Self::DEFAULT_DETECTION_SPEED * step_ns as f64 * 1e-9
    }

    /// Time step `h`, s.
    pub fn h(&self) -> f64 {
        self.step_ns as f64 * 1e-9
    }
}
