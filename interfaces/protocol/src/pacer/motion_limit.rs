//! Limit of the motion of a body between two samples.
//!
//! Contract: an accepted sample never ends a window later, neither by an ambiguous rotation nor by a displacement per
//! step that exceeds the limit for grains.

use ballast::component::{Component, Interpolation, Knot, MAX_KNOT_ROTATION};
use ballast::drive::SpeedLimit;
use ballast::math::{Vec3, rotation};

/// Maximum ratio of the rate of a rotation vector of at most [`MAX_KNOT_ROTATION`] to the angular velocity.
const MAX_RATE_RATIO: f64 = 1.2;

/// Limit of the motion of one body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SampleMotionLimit {
    /// Maximum displacement of a point of the body in a step, m.
    max_displacement: f64,
    /// Length of a step, s.
    step: f64,
    /// Distance from the reference point to the grains, m; for a wall, to their initial positions.
    lever: f64,
    interpolation: Interpolation,
}

impl SampleMotionLimit {
    pub fn new(component: &Component, d: usize, interpolation: Interpolation) -> Self {
        let (model, state) = (component.model(), component.state());
        let limit = SpeedLimit::new(model);
        let lever = match limit.max_displacement.is_finite() {
            true => {
                limit.max_displacement / limit.time(model, state, d, &Vec3::zeros(), &Vec3::x())
            }
            false => 0.0,
        };
        Self {
            max_displacement: limit.max_displacement,
            step: model.stepping.h(),
            lever,
            interpolation,
        }
    }

    /// Returns true if a body can move from `a` to the later knot `b`.
    pub fn allows(&self, a: &Knot, b: &Knot) -> bool {
        let seconds = (b.time_ns - a.time_ns) as f64 * 1e-9;
        let displacement = b.pose.position - a.pose.position;
        let rotation_vector = rotation::log(&(b.pose.orientation * a.pose.orientation.inverse()));
        if self.interpolation == Interpolation::Hold {
            // Jumps add up within a step: consecutive ones to half of the limit, the first one to the other half.
            return 2.0
                * self.point_displacement(displacement, rotation_vector)
                * (self.step / seconds).max(1.0)
                <= self.max_displacement;
        }
        let in_a_step = match self.interpolation {
            Interpolation::Hermite => {
                // The velocity of a cubic never exceeds the largest of these three.
                let middle = |whole: Vec3, from, to| whole * (3.0 / seconds) - from - to;
                let middle = [
                    middle(displacement, a.velocity, b.velocity),
                    middle(
                        rotation_vector * MAX_RATE_RATIO,
                        a.angular_velocity * MAX_RATE_RATIO,
                        b.angular_velocity * MAX_RATE_RATIO,
                    ),
                ];
                let ends = [
                    [a.velocity, a.angular_velocity * MAX_RATE_RATIO],
                    [b.velocity, b.angular_velocity * MAX_RATE_RATIO],
                ];
                let led = [ends[0], middle, ends[1]].map(|[v, w]| self.point_displacement(v, w));
                led.into_iter().fold(0.0, f64::max) * self.step
            }
            _ => self.point_displacement(displacement, rotation_vector) * (self.step / seconds),
        };
        rotation_vector.norm() <= MAX_KNOT_ROTATION && in_a_step <= self.max_displacement
    }

    fn point_displacement(&self, translation: Vec3, rotation: Vec3) -> f64 {
        translation.norm() + rotation.norm() * self.lever
    }
}
