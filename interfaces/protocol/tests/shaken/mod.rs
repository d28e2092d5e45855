//! A floor that is shaken: 2 mm at 10 Hz, from rest at 0.

#![allow(dead_code, reason = "each test binary uses its part")]

use ballast_protocol::messages::{
    BodyMotion, InterpolationMode, MotionKnot, Point, Pose, Twist, Vector3,
};
use std::f64::consts::TAU;

/// The floor at a time.
pub fn floor(time_ns: i64) -> MotionKnot {
    let (t, w) = (time_ns.max(0) as f64 * 1e-9, TAU * 10.0);
    let position = Point { z: -2e-3 * (1.0 - (w * t).cos()), ..Point::default() };
    let linear = Vector3 { z: -2e-3 * w * (w * t).sin(), ..Vector3::default() };
    let twist = Twist { linear, ..Twist::default() };
    MotionKnot { time_ns, pose: Pose { position, ..Pose::default() }, twist }
}

/// Its motion through a window.
pub fn through(t0_ns: i64, t1_ns: i64) -> Vec<BodyMotion> {
    vec![BodyMotion {
        body: "floor".into(),
        interpolation: InterpolationMode::Hermite,
        allow_jump: false,
        knots: vec![floor(t0_ns), floor(t1_ns)],
    }]
}
