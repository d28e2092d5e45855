//! How far around a body a step looks for contacts: as far as the step can carry it (T-35).
//!
//! Reads: model, motion, solved velocities. Writes: [`Reach`]. Cost: two roots per body and step.
//! Contract: a gap that no contact was looked for in stays open as long as both bodies keep within their shares;
//! [`Reach::raise`] tells which do not.
//!
//! Two bodies share the distance between them. What a body needs of it is known for certain only after the solve: so it
//! gets half as much again as it would need at its free velocity, and who turns out faster than that is looked at again.

use crate::math::Vec3;
use crate::model::{Model, Part};
use crate::motion::Motion;
use rayon::prelude::*;

/// How much faster than at its free velocity a body may get before it is looked at again.
const AMPLE: f64 = 1.5;

/// Shares of all bodies in the distances up to which contacts are looked for.
#[derive(Debug, Clone, Default)]
pub struct Reach {
    /// m `[nb]`
    share: Vec<f64>,
    /// Shares before some were raised `[nb]`.
    before: Vec<f64>,
    /// No share is larger than the largest grain: what moves that far in a step is past the others anyway, m.
    most: f64,
}

impl Reach {
    /// What the motion of the bodies without contacts asks for: half the alert distance each, and more for fast bodies.
    pub fn of(model: &Model, motion: &Motion) -> Self {
        let mut reach = Self::default();
        reach.predict(model, motion);
        reach
    }

    /// The same in place.
    pub fn predict(&mut self, model: &Model, motion: &Motion) {
        let (h, least) = (model.stepping.h(), 0.5 * model.stepping.alert);
        let radius = |s: &u32| model.shapes[*s as usize].radius;
        let most = model.grains.shape.iter().map(radius).fold(least, f64::max);
        self.most = most;
        (&motion.velocity, &motion.spin)
            .into_par_iter()
            .enumerate()
            .with_min_len(1024)
            .map(|(b, (v, w))| {
                let needed = AMPLE * h * top_speed(model, b, v, w);
                round_up(needed).max(least).min(most)
            })
            .collect_into_vec(&mut self.share);
        self.before.clone_from(&self.share);
    }

    /// Raises the shares of bodies that some of their points leave within the step; whether there are any. `speed` are the
    /// largest speeds of the bodies' points, m/s.
    pub fn raise(&mut self, h: f64, speed: impl Fn(usize) -> f64 + Sync) -> bool {
        self.before.clone_from(&self.share);
        let most = self.most;
        let faster = self.share.par_iter_mut().enumerate().with_min_len(1024).map(|(b, share)| {
            let needed = h * speed(b);
            let beyond = *share < needed && *share < most;
            if beyond {
                *share = round_up(AMPLE * needed).min(most);
            }
            beyond
        });
        faster.reduce(|| false, |a, b| a | b)
    }

    /// Whether the share of body `b` was raised.
    pub fn is_raised(&self, b: usize) -> bool {
        self.share[b] > self.before[b]
    }

    /// Distance up to which contacts of two bodies are looked for, m.
    pub fn between(&self, [a, b]: [usize; 2]) -> f64 {
        self.share[a] + self.share[b]
    }

    /// The same before shares were raised.
    pub fn between_before(&self, [a, b]: [usize; 2]) -> f64 {
        self.before[a] + self.before[b]
    }

    /// All shares, m `[nb]`.
    pub(super) fn shares(&self) -> &[f64] {
        &self.share
    }
}

/// No point of body `b` is faster, m/s.
pub fn top_speed(model: &Model, b: usize, velocity: &Vec3, spin: &Vec3) -> f64 {
    let turning = spin.norm();
    if turning == 0.0 {
        return velocity.norm();
    }
    let endless =
        |d: usize| model.driven[d].parts.iter().any(|part| matches!(part, Part::HalfSpace { .. }));
    match b.checked_sub(model.grains.len()) {
        Some(d) if endless(d) => f64::INFINITY,
        _ => velocity.norm() + turning * extent(model, b),
    }
}

/// Largest distance of a point of body `b` from its origin, half-spaces left out, m.
pub(super) fn extent(model: &Model, b: usize) -> f64 {
    let radius = |shape: u32| model.shapes[shape as usize].radius;
    let Some(d) = b.checked_sub(model.grains.len()) else { return radius(model.grains.shape[b]) };
    let parts = model.driven[d].parts.iter().map(|part| match part {
        Part::Convex { shape, pose } => pose.position.norm() + radius(*shape),
        Part::HalfSpace { .. } => 0.0,
    });
    parts.fold(0.0, f64::max)
}

/// The next of 1, 1.5, 2, 3, 4, 6 ... so that what is looked for does not change with every small change of a speed.
fn round_up(x: f64) -> f64 {
    const BELOW_THE_FIRST_DIGIT: u64 = (1 << 51) - 1;
    f64::from_bits((x.to_bits() + BELOW_THE_FIRST_DIGIT) & !BELOW_THE_FIRST_DIGIT)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reach(least: f64, most: f64, count: usize) -> Reach {
        Reach { share: vec![least; count], before: vec![least; count], most }
    }

    #[test]
    fn shares_are_rounded_up_to_halves_of_powers_of_two() {
        for (x, expected) in
            [(0.0, 0.0), (1.0, 1.0), (1.01, 1.5), (1.5, 1.5), (1.6, 2.0), (0.3, 0.375)]
        {
            assert_eq!(round_up(x), expected, "{x}");
        }
        assert_eq!(round_up(f64::INFINITY), f64::INFINITY);
        let mut x = 1e-9;
        while x < 1e3 {
            let up = round_up(x);
            assert!(up >= x && up <= 1.5 * x, "{x} {up}");
            x *= 1.01;
        }
    }

    #[test]
    fn only_bodies_that_leave_their_share_are_raised() {
        let mut reach = reach(1e-4, 0.02, 4);
        let speeds = [0.09, 0.11, 1.0, 1e9];
        assert!(reach.raise(1e-3, |b| speeds[b]));
        assert_eq!([0, 1, 2, 3].map(|b| reach.is_raised(b)), [false, true, true, true]);
        assert_eq!(reach.between_before([1, 2]), 2e-4);
        assert!(reach.between([1, 2]) >= 1e-3 * (speeds[1] + speeds[2]));
        assert_eq!(reach.shares()[3], 0.02);
        assert!(!reach.raise(1e-3, |b| speeds[b]), "as far as speeds ask for, or as far as may be");
    }
}
