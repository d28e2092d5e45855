//! How far a body may be led from one sample to the next.
//!
//! Contract: what fits ends no window later, neither as a turn whose way round is a guess nor as a body that is led
//! farther in a step than grains allow.

use ballast::component::{Component, Interpolation, Knot, MAX_KNOT_ROTATION};
use ballast::drive::SpeedLimit;
use ballast::math::{Vec3, rotation};

/// A rotation vector of at most [`MAX_KNOT_ROTATION`] changes by so much faster than its body turns, at most.
const RATE: f64 = 1.2;

/// Of one body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Reach {
    /// Way of a point of the body in a step, m, and length of the step, s.
    way: f64,
    step: f64,
    /// From the reference point to where grains are met, m: of a wall, where they lay at the beginning.
    lever: f64,
    interpolation: Interpolation,
}

impl Reach {
    pub fn of(component: &Component, d: usize, interpolation: Interpolation) -> Self {
        let (model, state) = (component.model(), component.state());
        let limit = SpeedLimit::new(model);
        let lever = match limit.max_displacement.is_finite() {
            true => {
                limit.max_displacement / limit.time(model, state, d, &Vec3::zeros(), &Vec3::x())
            }
            false => 0.0,
        };
        Self { way: limit.max_displacement, step: model.stepping.h(), lever, interpolation }
    }

    /// Whether a body can be led from `a` to `b`, which is later.
    pub fn fits(&self, a: &Knot, b: &Knot) -> bool {
        let seconds = (b.time_ns - a.time_ns) as f64 * 1e-9;
        let way = b.pose.position - a.pose.position;
        let turn = rotation::log(&(b.pose.orientation * a.pose.orientation.inverse()));
        if self.interpolation == Interpolation::Hold {
            // Jumps add up within a step: those that follow each other in it to half of its way, and the first, however
            // long after the one before, to the other half.
            return 2.0 * self.led(way, turn) * (self.step / seconds).max(1.0) <= self.way;
        }
        let in_a_step = match self.interpolation {
            Interpolation::Hermite => {
                // The velocity of a cubic is nowhere larger than the largest of these three.
                let middle = |whole: Vec3, from, to| whole * (3.0 / seconds) - from - to;
                let middle = [
                    middle(way, a.velocity, b.velocity),
                    middle(turn * RATE, a.angular_velocity * RATE, b.angular_velocity * RATE),
                ];
                let ends = [
                    [a.velocity, a.angular_velocity * RATE],
                    [b.velocity, b.angular_velocity * RATE],
                ];
                let led = [ends[0], middle, ends[1]].map(|[v, w]| self.led(v, w));
                led.into_iter().fold(0.0, f64::max) * self.step
            }
            _ => self.led(way, turn) * (self.step / seconds),
        };
        turn.norm() <= MAX_KNOT_ROTATION && in_a_step <= self.way
    }

    fn led(&self, way: Vec3, turn: Vec3) -> f64 {
        way.norm() + turn.norm() * self.lever
    }
}
