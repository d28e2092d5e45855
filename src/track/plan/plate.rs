//! Plan of a plate, and its motion and load as functions of time.

use crate::math::Vec3;
use crate::model::{ContactStiffness, Mount};
use crate::track::motion_law::sine_between;
use std::f64::consts::TAU;

/// A plate: one rigid body of boxes that follows a motion or carries a load.
#[derive(Debug, Clone, PartialEq)]
pub struct PlatePlan {
    /// Name of the driven body.
    pub name: String,
    /// Position of the reference point at the start of the run in x and y, m.
    pub position: [f64; 2],
    /// Height of the reference point at the start of the run, m; `None`: the plate is lowered onto the grains.
    pub z: Option<f64>,
    /// Boxes that make up the plate.
    pub boxes: Vec<PlateBox>,
    /// Friction coefficient with grains.
    pub friction: f64,
    /// Stiffness of the contacts with grains.
    pub stiffness: ContactStiffness,
    /// Mount on which loads and contacts move it in the run; `None`: its motion is imposed.
    pub mount: Option<Mount>,
    /// True if it stands in the bed while the bed is prepared.
    pub in_preparation: bool,
    /// Displacement through the run, m; linear between knots, and from zero at the start of the run.
    pub motion: Vec<VectorKnot>,
    /// Vibration in addition to the motion.
    pub vibration: Option<PlateVibration>,
    /// Force through the run, N; linear between knots, and from zero at the start of the run.
    pub load: Vec<VectorKnot>,
}

/// Box of a plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateBox {
    /// Centre of the box relative to the reference point, m.
    pub offset: Vec3,
    /// Size in x, y and z, m.
    pub size: Vec3,
}

/// Vector at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VectorKnot {
    /// Time since the start of the run, ns.
    pub time_ns: u64,
    /// Displacement (m) or force (N), world axes.
    pub value: Vec3,
}

/// Sinusoidal vibration of a plate, which grows and dies away over some periods.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateVibration {
    /// Amplitude along each axis, m.
    pub amplitude: Vec3,
    /// Frequency, Hz.
    pub frequency: f64,
    /// Start, s.
    pub start: f64,
    /// End, s.
    pub end: f64,
}

impl PlatePlan {
    /// True if it has a motion or a vibration.
    pub fn is_moved(&self) -> bool {
        !self.motion.is_empty() || self.vibration.is_some()
    }

    /// Returns the displacement from the start of the run, m.
    pub fn displacement(&self, time_ns: u64) -> Vec3 {
        let moved = self.motion_at(time_ns);
        let Some(v) = &self.vibration else { return moved };
        let whole = v.end - v.start;
        let t = time_ns as f64 * 1e-9;
        moved + v.amplitude * sine_between(1.0, t, [v.start, v.end], v.frequency, [0.5 * whole; 2])
    }

    /// Returns the displacement from the start of the run without the vibration, m.
    pub fn motion_at(&self, time_ns: u64) -> Vec3 {
        value_at(&self.motion, time_ns)
    }

    /// Returns the force, N.
    pub fn force(&self, time_ns: u64) -> Vec3 {
        value_at(&self.load, time_ns)
    }

    /// Returns the largest displacement of the mount in a step of `step_ns`, m: a bound.
    pub fn max_displacement(&self, step_ns: u64) -> f64 {
        let start = VectorKnot { time_ns: 0, value: Vec3::zeros() };
        let knots: Vec<&VectorKnot> = std::iter::once(&start).chain(&self.motion).collect();
        let steps = knots.windows(2).map(|pair| {
            let way = (pair[1].value - pair[0].value).norm();
            let duration = pair[1].time_ns.saturating_sub(pair[0].time_ns);
            way * (step_ns as f64 / duration.max(step_ns) as f64)
        });
        let swing = self.vibration.map_or(0.0, |v| {
            // Chord of a sine, and the growth of its amplitude over at least a period.
            let angle = (0.5 * TAU * v.frequency * step_ns as f64 * 1e-9).min(0.25 * TAU);
            2.0 * v.amplitude.norm() * libm::sin(angle)
        });
        steps.fold(0.0, f64::max) + swing
    }
}

/// Returns a vector that is linear between knots, from zero at the start of the run, and constant after the last knot.
fn value_at(knots: &[VectorKnot], time_ns: u64) -> Vec3 {
    let after = knots.partition_point(|k| k.time_ns <= time_ns);
    let start = VectorKnot { time_ns: 0, value: Vec3::zeros() };
    let before = after.checked_sub(1).map_or(start, |k| knots[k]);
    let Some(next) = knots.get(after) else { return before.value };
    let share = (time_ns - before.time_ns) as f64 / (next.time_ns - before.time_ns) as f64;
    before.value + (next.value - before.value) * share
}

#[cfg(test)]
mod tests {
    use super::*;

    fn knot(time_ns: u64, x: f64) -> VectorKnot {
        VectorKnot { time_ns, value: Vec3::new(x, 0.0, -2.0 * x) }
    }

    #[test]
    fn vectors_are_linear_between_knots_and_constant_after_the_last() {
        let knots = [knot(100, 0.5), knot(300, -0.5)];
        for (time, x) in [(0, 0.0), (50, 0.25), (100, 0.5), (200, 0.0), (300, -0.5), (900, -0.5)] {
            assert_eq!(value_at(&knots, time), knot(time, x).value, "{time}");
        }
        assert_eq!(value_at(&[knot(0, 3.0)], 0), knot(0, 3.0).value);
        assert_eq!(value_at(&[], 7), Vec3::zeros());
    }

    #[test]
    fn a_step_moves_no_farther_than_the_bound() {
        let vibration = PlateVibration {
            amplitude: Vec3::new(0.0, 0.002, 0.0),
            frequency: 40.0,
            start: 0.01,
            end: 0.3,
        };
        let plan = PlatePlan {
            name: "wall".into(),
            position: [0.0; 2],
            z: Some(0.0),
            boxes: Vec::new(),
            friction: 0.5,
            stiffness: ContactStiffness::RIGID,
            mount: None,
            in_preparation: false,
            motion: vec![knot(50_000_000, 0.01), knot(90_000_000, -0.02)],
            vibration: Some(vibration),
            load: Vec::new(),
        };
        let step = 500_000;
        let bound = plan.max_displacement(step);
        let ways = (0..700)
            .map(|k| (plan.displacement((k + 1) * step) - plan.displacement(k * step)).norm());
        let largest = ways.fold(0.0, f64::max);
        assert!(largest <= bound && bound < 1.3 * largest, "{largest} {bound}");
        assert_eq!(plan.displacement(400_000_000), plan.motion[1].value, "the vibration has ended");
    }
}
