//! How far around a body a step looks for contacts: as far as the step can close a gap (T-35).
//!
//! Reads: model, motion, solved velocities. Writes: [`DetectionRange`]. Cost: a root per body and step, two per pair.
//! Contract: a gap in which no contact was looked for stays open as long as the solve changes the velocities of both bodies
//! by no more than was allowed for; [`DetectionRange::raise`] tells where it does.
//!
//! How two bodies approach each other without contacts is known beforehand. By how much contacts change that is known
//! after the solve: each body is allowed some change, and where it was more, its surroundings are looked at again.

use crate::math::Vec3;
use crate::model::{DrivenBody, Model, Part};
use crate::motion::Motion;
use rayon::prelude::*;

/// What is allowed for on looking again, over what the solve has just asked for.
const AMPLE: f64 = 1.5;
/// How many radii of the largest grain a solve may carry a body further before a half-space, which nothing is ever past: far
/// more than any stone is flung in a step, and an end to looking again.
const FLUNG: f64 = 64.0;

/// Distances up to which contacts are looked for.
#[derive(Debug, Clone, Default)]
pub struct DetectionRange {
    h: f64,
    /// The alert distance: the least that is looked for, m.
    least: f64,
    /// How far the free velocity carries any point of a body in the step, m `[nb]`.
    way: Vec<f64>,
    /// How much further, or elsewhere, the solve may carry it, m `[nb]`; before half-spaces alone more than `most`.
    allowance: Vec<f64>,
    /// Allowances with which contacts were looked for last `[nb]`.
    before: Vec<f64>,
    /// The radius of the largest grain: what moves that far in a step is past all but half-spaces anyway, m.
    most: f64,
    /// What is allowed for where there are half-spaces, m; else `most`.
    furthest: f64,
    /// Whether the driven body has half-spaces `[nd]`. Beside them its convex parts are looked for up to [`DetectionRange::at_most`] only.
    is_endless: Vec<bool>,
}

impl DetectionRange {
    /// Allows a quarter of the alert distance to each body.
    pub fn new(model: &Model, motion: &Motion) -> Self {
        let mut reach = Self::default();
        reach.reset(model, motion);
        reach
    }

    /// The same in place.
    pub fn reset(&mut self, model: &Model, motion: &Motion) {
        let (h, least) = (model.stepping.h(), model.stepping.detection_distance);
        let allowance = 0.25 * least;
        let radii = (0..model.grains.len())
            .into_par_iter()
            .with_min_len(4096)
            .map(|i| model.grain_radius(i));
        let most = radii.reduce(|| allowance, f64::max);
        (self.h, self.least, self.most) = (h, least, most);
        self.is_endless.clear();
        self.is_endless.extend(model.driven.iter().map(is_endless));
        let has_walls = self.is_endless.iter().any(|is_endless| *is_endless);
        self.furthest = if has_walls { FLUNG * most } else { most };
        (&motion.velocity, &motion.angular_velocity)
            .into_par_iter()
            .enumerate()
            .with_min_len(1024)
            .map(|(b, (v, w))| round_up(h * max_point_speed(model, b, v, w)).min(most))
            .collect_into_vec(&mut self.way);
        self.allowance.clear();
        self.allowance.resize(self.way.len(), allowance);
        self.before.clone_from(&self.allowance);
    }

    /// Raises the allowances of bodies that the solve has changed by more; whether any is above those with which contacts
    /// were looked for. `change` is the largest change of velocity of a body's points, m/s.
    pub fn enlarge(&mut self, change: impl Fn(usize) -> f64 + Sync) -> bool {
        let (h, most) = (self.h, self.furthest);
        let bodies = self.allowance.par_iter_mut().zip(&self.before).enumerate();
        let raised = bodies.with_min_len(1024).map(|(b, (allowance, before))| {
            let needed = h * change(b);
            if *allowance < needed && *allowance < most {
                *allowance = round_up(AMPLE * needed).min(most);
            }
            *allowance > *before
        });
        raised.reduce(|| false, |a, b| a | b)
    }

    /// Takes note that contacts are looked for with the present allowances.
    pub fn mark_searched(&mut self) {
        self.before.clone_from(&self.allowance);
    }

    /// Whether the allowance of body `b` was raised.
    pub fn is_enlarged(&self, b: usize) -> bool {
        self.allowance[b] > self.before[b]
    }

    /// Distance up to which contacts of a grain of this radius with another body are looked for, m.
    pub fn distance(&self, motion: &Motion, radius: f64, pair: [usize; 2]) -> f64 {
        self.with(&self.allowance, motion, radius, pair)
    }

    /// Whether a grain of this radius and another body may close a gap in which no contact was looked for before
    /// allowances were raised; `twist` are the bodies' velocities and spins, m/s and rad/s.
    pub fn may_have_missed_contact(
        &self,
        motion: &Motion,
        radius: f64,
        pair: [usize; 2],
        twist: impl Fn(usize) -> (Vec3, Vec3),
    ) -> bool {
        let [a, b] = pair;
        (self.is_enlarged(a) || self.is_enlarged(b))
            && self.h * approach_speed(motion, radius, pair, twist)
                > self.searched_distance(motion, radius, pair)
    }

    /// [`DetectionRange::between`] before allowances were raised.
    pub fn searched_distance(&self, motion: &Motion, radius: f64, pair: [usize; 2]) -> f64 {
        self.with(&self.before, motion, radius, pair)
    }

    /// What the free velocities and these allowances make of the distance.
    fn with(&self, allowance: &[f64], motion: &Motion, radius: f64, [a, b]: [usize; 2]) -> f64 {
        let free = |b: usize| (motion.velocity[b], motion.angular_velocity[b]);
        let approach = round_up(self.h * approach_speed(motion, radius, [a, b], free));
        let driven = b.checked_sub(self.way.len() - self.is_endless.len());
        if driven.is_some_and(|d| self.is_endless[d]) {
            return self.least.max(approach + (allowance[a] + allowance[b]));
        }
        let approach = approach.min(self.way[a] + self.way[b]);
        let allowed = |b: usize| allowance[b].min(self.most);
        self.least.max(approach + (allowed(a) + allowed(b)))
    }

    /// What no distance between two bodies without half-spaces that is asked for exceeds, m.
    pub(super) fn max_distance(&self, [a, b]: [usize; 2]) -> f64 {
        self.body_range(a) + self.body_range(b)
    }

    /// The part of body `b` in this, m.
    pub(super) fn body_range(&self, b: usize) -> f64 {
        (0.5 * self.least).max(self.way[b] + self.allowance[b].min(self.most))
    }

    /// How far the free velocity carries body `b` in the step, m; no more than the radius of the largest grain.
    pub(super) fn free_displacement(&self, b: usize) -> f64 {
        self.way[b]
    }

    /// Number of bodies.
    pub(super) fn body_count(&self) -> usize {
        self.way.len()
    }
}

/// No point of the grain, of this radius, moves faster against the other body, m/s.
fn approach_speed(
    motion: &Motion,
    radius: f64,
    [grain, other]: [usize; 2],
    twist: impl Fn(usize) -> (Vec3, Vec3),
) -> f64 {
    let lever = motion.position[grain] - motion.position[other];
    let ((v, w), (v_other, w_other)) = (twist(grain), twist(other));
    (v - v_other - w_other.cross(&lever)).norm() + radius * (w - w_other).norm()
}

/// No point of a body with this velocity and spin is faster, m/s.
pub fn max_point_speed(model: &Model, b: usize, velocity: &Vec3, angular_velocity: &Vec3) -> f64 {
    let turning = angular_velocity.norm();
    if turning == 0.0 {
        return velocity.norm();
    }
    match b.checked_sub(model.grains.len()) {
        Some(d) if is_endless(&model.driven[d]) => f64::INFINITY,
        _ => velocity.norm() + turning * extent(model, b),
    }
}

/// Whether a driven body has half-spaces.
fn is_endless(body: &DrivenBody) -> bool {
    body.parts.iter().any(|part| matches!(part, Part::HalfSpace { .. }))
}

/// Largest distance of a point of body `b` from its origin, half-spaces left out, m.
pub(super) fn extent(model: &Model, b: usize) -> f64 {
    let radius = |shape: u32| model.shapes[shape as usize].radius;
    let Some(d) = b.checked_sub(model.grains.len()) else { return model.grain_radius(b) };
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

    #[test]
    fn lengths_are_rounded_up_to_halves_of_powers_of_two() {
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
    fn only_bodies_that_change_by_more_than_allowed_are_raised() {
        let allowance = vec![1e-4; 4];
        let before = allowance.clone();
        let (h, least, way, most, furthest) = (1e-3, 0.0, vec![0.0; 4], 0.02, 0.02);
        let is_endless = vec![];
        let mut reach =
            DetectionRange { h, least, way, allowance, before, most, furthest, is_endless };
        let changes = [0.09, 0.11, 1.0, 1e9];
        assert!(reach.enlarge(|b| changes[b]));
        assert_eq!([0, 1, 2, 3].map(|b| reach.is_enlarged(b)), [false, true, true, true]);
        assert!(reach.max_distance([1, 2]) >= 1e-3 * (changes[1] + changes[2]));
        assert_eq!(reach.body_range(3), 0.02);
        assert!(reach.enlarge(|_| 0.0), "not looked for yet");
        reach.mark_searched();
        assert!(!reach.enlarge(|b| changes[b]), "as far as asked for, or as far as may be");
    }
}
