//! Detection range: distance around a body within which the step can close a gap (T-35).
//!
//! Reads: model, motion, solved velocities. Writes: [`DetectionRange`]. Cost: a square root per body and step, two
//! per pair. Contract: a gap outside the range stays open as long as the solve changes the velocities of both bodies
//! by no more than the margin; [`DetectionRange::enlarge`] finds the bodies with larger changes.
//!
//! The approach of two bodies without contacts is known before the solve, its change by contacts only after it. Each
//! body has a margin for that change; where the margin was too small, detection is repeated.

use crate::math::Vec3;
use crate::model::{DrivenBody, Model, Part};
use crate::motion::Motion;
use rayon::prelude::*;

/// Factor of an enlarged margin over the margin that the last solve needed.
const MARGIN_GROWTH: f64 = 1.5;
/// Maximum margin before half-spaces, in radii of the largest grain.
///
/// Far more than any displacement in a step; ensures that repeated detection ends.
const MAX_DISPLACEMENT_RADII: f64 = 64.0;

/// Distances up to which contacts are detected.
#[derive(Debug, Clone, Default)]
pub struct DetectionRange {
    h: f64,
    /// Minimum detection distance, m.
    min_distance: f64,
    /// Displacement of the fastest point of a body by the free velocity in the step, m `[nb]`.
    free_displacement: Vec<f64>,
    /// Margin for the change of this displacement by the solve, m `[nb]`; exceeds `max_displacement` before
    /// half-spaces only.
    margin: Vec<f64>,
    /// Margins of the last detection, m `[nb]`.
    searched_margin: Vec<f64>,
    /// Radius of the largest grain, m; a larger displacement in a step passes any body without half-spaces.
    max_displacement: f64,
    /// Maximum margin, m; larger than `max_displacement` if the model has half-spaces.
    max_half_space_displacement: f64,
    /// True if the driven body has half-spaces `[nd]`. Its convex parts are detected up to
    /// [`DetectionRange::max_distance`] only.
    has_half_space: Vec<bool>,
}

impl DetectionRange {
    /// Returns the range before the solve, with a quarter of the minimum distance as margin of each body.
    pub fn new(model: &Model, motion: &Motion) -> Self {
        let mut range = Self::default();
        range.reset(model, motion);
        range
    }

    /// Resets the range to that of [`DetectionRange::new`].
    pub fn reset(&mut self, model: &Model, motion: &Motion) {
        let (h, min_distance) = (model.stepping.h(), model.stepping.detection_distance);
        let margin = 0.25 * min_distance;
        let radii = (0..model.grains.len())
            .into_par_iter()
            .with_min_len(4096)
            .map(|i| model.grain_radius(i));
        let max_displacement = radii.reduce(|| margin, f64::max);
        (self.h, self.min_distance, self.max_displacement) = (h, min_distance, max_displacement);
        self.has_half_space.clear();
        self.has_half_space.extend(model.driven.iter().map(has_half_space));
        let has_walls = self.has_half_space.iter().any(|has_half_space| *has_half_space);
        self.max_half_space_displacement =
            if has_walls { MAX_DISPLACEMENT_RADII * max_displacement } else { max_displacement };
        (&motion.velocity, &motion.angular_velocity)
            .into_par_iter()
            .enumerate()
            .with_min_len(1024)
            .map(|(b, (v, w))| round_up(h * max_point_speed(model, b, v, w)).min(max_displacement))
            .collect_into_vec(&mut self.free_displacement);
        self.margin.clear();
        self.margin.resize(self.free_displacement.len(), margin);
        self.searched_margin.clone_from(&self.margin);
    }

    /// Enlarges the margins of bodies whose motion the solve has changed by more.
    ///
    /// `change` is the largest change of velocity of a body's points, m/s. Returns true if a margin exceeds that of
    /// the last detection.
    pub fn enlarge(&mut self, change: impl Fn(usize) -> f64 + Sync) -> bool {
        let (h, max_displacement) = (self.h, self.max_half_space_displacement);
        let bodies = self.margin.par_iter_mut().zip(&self.searched_margin).enumerate();
        let raised = bodies.with_min_len(1024).map(|(b, (margin, searched_margin))| {
            let needed = h * change(b);
            if *margin < needed && *margin < max_displacement {
                *margin = round_up(MARGIN_GROWTH * needed).min(max_displacement);
            }
            *margin > *searched_margin
        });
        raised.reduce(|| false, |a, b| a | b)
    }

    /// Records that contacts were detected with the present margins.
    pub fn mark_searched(&mut self) {
        self.searched_margin.clone_from(&self.margin);
    }

    /// True if the margin of body `b` exceeds that of the last detection.
    pub fn is_enlarged(&self, b: usize) -> bool {
        self.margin[b] > self.searched_margin[b]
    }

    /// Returns the detection distance of a grain of this radius and another body, m.
    pub fn distance(&self, motion: &Motion, radius: f64, pair: [usize; 2]) -> f64 {
        self.distance_with(&self.margin, motion, radius, pair)
    }

    /// True if a grain of this radius and another body may close a gap outside the last detection distance.
    ///
    /// `twist` are the bodies' velocities (m/s) and angular velocities (rad/s).
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

    /// Returns the detection distance with the margins of the last detection, m.
    pub fn searched_distance(&self, motion: &Motion, radius: f64, pair: [usize; 2]) -> f64 {
        self.distance_with(&self.searched_margin, motion, radius, pair)
    }

    /// Returns the detection distance with these margins, m.
    fn distance_with(
        &self,
        margin: &[f64],
        motion: &Motion,
        radius: f64,
        [a, b]: [usize; 2],
    ) -> f64 {
        let free = |b: usize| (motion.velocity[b], motion.angular_velocity[b]);
        let approach = round_up(self.h * approach_speed(motion, radius, [a, b], free));
        let driven = b.checked_sub(self.free_displacement.len() - self.has_half_space.len());
        if driven.is_some_and(|d| self.has_half_space[d]) {
            return self.min_distance.max(approach + (margin[a] + margin[b]));
        }
        let approach = approach.min(self.free_displacement[a] + self.free_displacement[b]);
        let allowed = |b: usize| margin[b].min(self.max_displacement);
        self.min_distance.max(approach + (allowed(a) + allowed(b)))
    }

    /// Returns the maximum detection distance of two bodies without half-spaces, m.
    pub(super) fn max_distance(&self, [a, b]: [usize; 2]) -> f64 {
        self.body_range(a) + self.body_range(b)
    }

    /// Returns the contribution of body `b` to the maximum detection distance, m.
    pub(super) fn body_range(&self, b: usize) -> f64 {
        (0.5 * self.min_distance)
            .max(self.free_displacement[b] + self.margin[b].min(self.max_displacement))
    }

    /// Returns the displacement of body `b` by its free velocity in the step, at most the radius of the largest
    /// grain, m.
    pub(super) fn free_displacement(&self, b: usize) -> f64 {
        self.free_displacement[b]
    }

    /// Returns the number of bodies.
    pub(super) fn body_count(&self) -> usize {
        self.free_displacement.len()
    }
}

/// Returns an upper bound of the speed of points of a grain of this radius relative to another body, m/s.
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

/// Returns an upper bound of the speed of the points of a body with this twist, m/s.
pub fn max_point_speed(model: &Model, b: usize, velocity: &Vec3, angular_velocity: &Vec3) -> f64 {
    let turning = angular_velocity.norm();
    if turning == 0.0 {
        return velocity.norm();
    }
    match b.checked_sub(model.grains.len()) {
        Some(d) if has_half_space(&model.driven[d]) => f64::INFINITY,
        _ => velocity.norm() + turning * bounding_radius(model, b),
    }
}

/// True if a driven body has half-spaces.
fn has_half_space(body: &DrivenBody) -> bool {
    body.parts.iter().any(|part| matches!(part, Part::HalfSpace { .. }))
}

/// Returns the largest distance of a point of body `b` from its origin, without half-spaces, m.
pub(super) fn bounding_radius(model: &Model, b: usize) -> f64 {
    let radius = |shape: u32| model.shapes[shape as usize].radius;
    let Some(d) = b.checked_sub(model.grains.len()) else { return model.grain_radius(b) };
    let parts = model.driven[d].parts.iter().map(|part| match part {
        Part::Convex { shape, pose } => pose.position.norm() + radius(*shape),
        Part::HalfSpace { .. } => 0.0,
    });
    parts.fold(0.0, f64::max)
}

/// Rounds up to 1, 1.5, 2, 3, 4, 6 ..., so that small changes of a speed do not change the range.
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
    fn only_margins_below_the_change_are_enlarged() {
        let margin = vec![1e-4; 4];
        let searched_margin = margin.clone();
        let (h, min_distance, free_displacement, max_displacement, max_half_space_displacement) =
            (1e-3, 0.0, vec![0.0; 4], 0.02, 0.02);
        let has_half_space = vec![];
        let mut range = DetectionRange {
            h,
            min_distance,
            free_displacement,
            margin,
            searched_margin,
            max_displacement,
            max_half_space_displacement,
            has_half_space,
        };
        let changes = [0.09, 0.11, 1.0, 1e9];
        assert!(range.enlarge(|b| changes[b]));
        assert_eq!([0, 1, 2, 3].map(|b| range.is_enlarged(b)), [false, true, true, true]);
        assert!(range.max_distance([1, 2]) >= 1e-3 * (changes[1] + changes[2]));
        assert_eq!(range.body_range(3), 0.02);
        assert!(range.enlarge(|_| 0.0), "not looked for yet");
        range.mark_searched();
        assert!(!range.enlarge(|b| changes[b]), "as far as asked for, or as far as may be");
    }
}
