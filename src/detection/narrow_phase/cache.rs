//! Building blocks of the caches of a pair: reference pose, back-off, and bounded lists.

use super::pair::BodyPair;
use crate::math::{Vec3, round, widen};

/// What single precision takes from a distance, over the sum of the radii.
const ROUNDING: f64 = 2e-6;

/// A configuration of two bodies to be compared with later ones.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReferencePose {
    set: bool,
    /// The point c in the frames of A and B.
    point: [[f32; 3]; 2],
    /// From B to A.
    turn: [f32; 4],
}

/// Bounds on a motion: of the anchor's point (Δc) in m, and of unit vectors (φ).
#[derive(Debug, Clone, Copy)]
pub struct RelativeMotion {
    pub at_point: f64,
    pub turn: f64,
}

impl ReferencePose {
    /// The configuration of `pair`; `c` is in the frame of A, best a point near both bodies.
    pub fn new(pair: &BodyPair, c: &Vec3) -> Self {
        let point = [*c, pair.point_in_b(c)].map(|x| round(&x));
        let q = pair.turn.coords;
        let turn = [q.x as f32, q.y as f32, q.z as f32, q.w as f32];
        Self { set: true, point, turn }
    }

    /// How far the bodies have moved, if a configuration is known.
    pub fn moved(&self, pair: &BodyPair) -> Option<RelativeMotion> {
        if !self.set {
            return None;
        }
        let [a, b] = &self.point;
        let (a, b) = (widen(a), widen(b));
        let at_point = (pair.rotation * b + pair.offset - a).norm() + ROUNDING * pair.size;
        let [x, y, z, w] = self.turn;
        let old = nalgebra::Vector4::new(x.into(), y.into(), z.into(), w.into());
        let turn = pair.turn.coords;
        let turn = 2.0 * (turn - old).norm_squared().min((turn + old).norm_squared()).sqrt();
        Some(RelativeMotion { at_point, turn })
    }
}

/// What became of a pair's lists.
#[derive(Debug, Clone, Copy, Default)]
pub struct CacheBackoff {
    /// Whether the list that was last wanted has never been used; it may not have come about.
    pending: bool,
    /// How many in a row were never used, at most [`MAX_FAILURES`].
    failures: u8,
    /// How often to do without before the next trial.
    cooldown: u8,
}

/// With each list that was made in vain pauses double, up to this many times.
const MAX_FAILURES: u8 = 4;

impl CacheBackoff {
    /// The list served.
    pub fn record_hit(&mut self) {
        *self = Self::default();
    }

    /// The list that there was, if any, does not hold any more; whether to make another.
    pub fn should_rebuild(&mut self) -> bool {
        if std::mem::take(&mut self.pending) {
            self.failures = MAX_FAILURES.min(self.failures + 1);
            self.cooldown = 1 << self.failures;
        }
        self.pending = self.cooldown <= 1;
        self.cooldown = self.cooldown.saturating_sub(1);
        self.pending
    }
}

/// At most `N` numbers below 256, or the note that they were too many.
#[derive(Debug, Clone, Copy)]
pub struct IndexList<const N: usize> {
    /// Above N: too many.
    count: u8,
    items: [u8; N],
}

impl<const N: usize> Default for IndexList<N> {
    fn default() -> Self {
        Self { count: 0, items: [0; N] }
    }
}

impl<const N: usize> IndexList<N> {
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// The note alone.
    pub fn overflowed() -> Self {
        Self { count: u8::MAX, items: [0; N] }
    }

    /// Notes that there are more than the list can hold.
    pub fn overflow(&mut self) {
        self.count = u8::MAX;
    }

    pub fn push(&mut self, item: usize) {
        match u8::try_from(item) {
            Ok(item) if usize::from(self.count) < N => {
                self.items[usize::from(self.count)] = item;
                self.count += 1;
            }
            _ => self.overflow(),
        }
    }

    /// The `k`-th.
    #[inline]
    pub fn item(&self, k: usize) -> usize {
        usize::from(self.items[k])
    }

    /// How many items are here.
    pub fn len(&self) -> usize {
        usize::from(self.count).min(N)
    }

    /// Where an item is, which is pushed if it is new; any place if there are too many.
    pub fn position_or_push(&mut self, item: usize) -> usize {
        let known = self.iter().position(|i| i == item);
        known.unwrap_or_else(|| {
            self.push(item);
            self.len() - 1
        })
    }

    /// What was pushed, in order, and the first of it over and over; of nothing, zeros.
    pub fn padded(mut self) -> [u8; N] {
        let (first, count) = (self.items[0], self.len());
        self.items[count..].fill(first);
        self.items
    }

    /// Whether all that were pushed are here.
    pub fn is_complete(&self) -> bool {
        usize::from(self.count) <= N
    }

    /// What was pushed, in order; of a list that is not whole, some.
    pub fn iter(&self) -> impl Iterator<Item = usize> + Clone {
        self.items.iter().take(usize::from(self.count)).map(|i| usize::from(*i))
    }
}

/// At most `N` pairs of numbers below 256, those of the largest bound first, or the note that they were too many.
#[derive(Debug, Clone, Copy)]
pub struct RankedList<const N: usize> {
    /// Above N: too many.
    count: u8,
    items: [[u8; 2]; N],
    bounds: [f32; N],
}

impl<const N: usize> Default for RankedList<N> {
    fn default() -> Self {
        Self { count: 0, items: [[0; 2]; N], bounds: [0.0; N] }
    }
}

impl<const N: usize> RankedList<N> {
    pub fn clear(&mut self) {
        self.count = 0;
    }

    pub fn push(&mut self, item: [usize; 2], bound: f64) {
        let count = usize::from(self.count);
        let ([Ok(a), Ok(b)], true) = (item.map(u8::try_from), count < N) else {
            self.count = u8::MAX;
            return;
        };
        let bound = bound as f32;
        let place = self.bounds[..count].partition_point(|b| *b >= bound);
        self.items.copy_within(place..count, place + 1);
        self.bounds.copy_within(place..count, place + 1);
        (self.items[place], self.bounds[place]) = ([a, b], bound);
        self.count += 1;
    }

    /// Whether all that were pushed are here.
    pub fn is_complete(&self) -> bool {
        usize::from(self.count) <= N
    }

    /// What was pushed and its bound, to single precision; of a list that is not whole, some.
    pub fn iter(&self) -> impl Iterator<Item = ([usize; 2], f64)> {
        let bounds = self.bounds.iter().map(|b| f64::from(*b));
        let items = self.items.iter().map(|item| item.map(usize::from));
        items.zip(bounds).take(usize::from(self.count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Which of so many steps make a list, if those at the given steps would be used in the next one.
    fn steps_that_make(count: usize, serves: impl Fn(usize) -> bool) -> Vec<usize> {
        let mut backoff = CacheBackoff::default();
        let mut list = None;
        let mut made = Vec::new();
        for step in 0..count {
            if list.is_some_and(&serves) {
                backoff.record_hit();
                continue;
            }
            list = None;
            if backoff.should_rebuild() {
                list = Some(step);
                made.push(step);
            }
        }
        made
    }

    #[test]
    fn lists_that_are_never_used_are_tried_ever_less_often() {
        assert_eq!(steps_that_make(60, |_| false), [0, 2, 6, 14, 30, 46]);
    }

    #[test]
    fn a_list_that_serves_is_kept_and_a_slow_pair_makes_lists_at_once() {
        assert_eq!(steps_that_make(60, |_| true), [0]);
        assert_eq!(steps_that_make(60, |made| made >= 6), [0, 2, 6]);
    }
}
