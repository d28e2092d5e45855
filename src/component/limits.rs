//! Limits of the inputs of a component.

/// Limits of what a component accepts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Maximum jump of a reference point between two windows, m.
    pub join_distance: f64,
    /// Maximum jump of an orientation between two windows, rad.
    pub join_angle: f64,
    /// Maximum jump of a velocity between two windows, m/s.
    pub join_speed: f64,
    /// Maximum jump of an angular velocity between two windows, rad/s.
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
