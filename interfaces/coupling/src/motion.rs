//! Motions and forces at the interface.

use ballast_protocol::description::BodyDescription;
use ballast_protocol::messages::{BodyMotion, InterpolationMode, MotionKnot, Pose, Twist, ns};
use nalgebra::{DVector, Quaternion, UnitQuaternion, Vector3};
use std::array;
use std::collections::BTreeMap;

/// Motion of a body at a time: position of its reference point (m), rotation vector (rad), velocity (m/s) and angular
/// velocity (rad/s), world axes.
pub type MotionRow = [f64; 12];
/// Motions of bodies by name.
pub type MotionRows = BTreeMap<String, MotionRow>;
/// Force (N) and torque (N m) by the ballast on each body about its reference point in each step of a window, by name.
pub type ForceRows = BTreeMap<String, Vec<[f64; 6]>>;

/// Returns the motion with which the next one of a body must start.
pub(crate) fn start_motion(body: &BodyDescription) -> MotionRow {
    let q = body.orientation;
    let rotation = UnitQuaternion::new_normalize(Quaternion::new(q.w, q.x, q.y, q.z)).scaled_axis();
    let (place, twist) = (body.position, body.twist.unwrap_or_default());
    let (v, w) = (twist.linear, twist.angular);
    let r = rotation;
    [place.x, place.y, place.z, r.x, r.y, r.z, v.x, v.y, v.z, w.x, w.y, w.z]
}

/// Returns the cubic motion of a body between two times, ns.
pub(crate) fn cubic_motion(
    body: &str,
    ends: [u64; 2],
    start: &MotionRow,
    end: &MotionRow,
) -> BodyMotion {
    BodyMotion {
        body: body.into(),
        interpolation: InterpolationMode::Hermite,
        allow_jump: false,
        knots: vec![knot(ends[0], start), knot(ends[1], end)],
    }
}

fn knot(time_ns: u64, row: &MotionRow) -> MotionKnot {
    let vector = |at: usize| Vector3::new(row[at], row[at + 1], row[at + 2]);
    let orientation = UnitQuaternion::from_scaled_axis(vector(3));
    let pose = Pose { position: vector(0).into(), orientation: orientation.into() };
    let twist = Twist { linear: vector(6).into(), angular: vector(9).into() };
    MotionKnot { time_ns: ns(time_ns), pose, twist }
}

/// Returns displacement (m) and rotation (rad) in each of `steps` equal steps of a cubic motion of `length` seconds.
pub(crate) fn displacements(
    start: &MotionRow,
    end: &MotionRow,
    length: f64,
    steps: usize,
) -> Vec<[f64; 6]> {
    let way = |k: usize| -> [f64; 6] {
        let s = k as f64 / steps as f64;
        let rise = s * s * (3.0 - 2.0 * s);
        let (first, last) = (s * (1.0 - s) * (1.0 - s), s * s * (1.0 - s));
        array::from_fn(|c| {
            rise * (end[c] - start[c]) + length * (first * start[c + 6] - last * end[c + 6])
        })
    };
    (0..steps).map(|k| array::from_fn(|c| way(k + 1)[c] - way(k)[c])).collect()
}

/// Scale of the components of a motion, m: rotations count with a lever, velocities with the length of the window.
#[derive(Clone, Copy)]
pub(crate) struct MotionScale([f64; 4]);

impl MotionScale {
    /// Creates the scale for a lever in m and a window in s.
    pub fn new(lever: f64, length: f64) -> Self {
        Self([1.0, lever, length, lever * length])
    }

    /// Returns all components as a vector in m.
    pub fn vector(&self, rows: &MotionRows) -> DVector<f64> {
        let scaled =
            rows.values().flat_map(|row| array::from_fn::<_, 12, _>(|c| row[c] * self.0[c / 3]));
        DVector::from_vec(scaled.collect())
    }

    /// Returns the motions of a vector in m, with the bodies of `like`.
    pub fn rows(&self, vector: &DVector<f64>, like: &MotionRows) -> MotionRows {
        let row = |k: usize| array::from_fn(|c| vector[12 * k + c] / self.0[c / 3]);
        like.keys().enumerate().map(|(k, name)| (name.clone(), row(k))).collect()
    }
}
