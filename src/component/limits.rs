//! Limits of the inputs of a component.

/// Limits of what a component accepts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Maximum jumps between two windows: m, rad, m/s, rad/s.
    pub join_distance: f64,
    pub join_angle: f64,
    pub join_speed: f64,
    pub join_angular_velocity: f64,
    /// Maximum penetration that a step may add, m; infinite: no limit.
    pub penetration: f64,
    /// True if the steps of a window that fails are kept; otherwise the window is discarded.
    pub keep_partial_window: bool,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            join_distance: 1e-6,
            join_angle: 1e-6,
            join_speed: 1e-3,
            join_angular_velocity: 1e-3,
            penetration: f64::INFINITY,
            keep_partial_window: false,
        }
    }
}
