//! Building blocks of the caches of a pair: reference pose, back-off, and bounded lists.

use super::pair::BodyPair;
use crate::math::{Vec3, round, widen};

/// Rounding error of a distance in single precision, over the sum of the radii.
const ROUNDING: f64 = 2e-6;

/// Relative configuration of two bodies for comparison with later ones.
///
/// Let c be any point, displaced by Δc, and let a rotation move unit vectors by at most φ. Then no point of B has
/// moved by more than |Δc| + φ l in the frame of A, nor a point of A in that of B, l being its distance from c.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReferencePose {
    set: bool,
    /// Point c in the frames of A and B, m.
    point: [[f32; 3]; 2],
    /// Quaternion from B to A.
    turn: [f32; 4],
}

/// Bounds on a relative motion: displacement of the reference point (Δc), m, and of unit vectors (φ).
#[derive(Debug, Clone, Copy)]
pub struct RelativeMotion {
    pub at_point: f64,
    pub rotation: f64,
}

impl ReferencePose {
    /// Returns the configuration of `pair`; `c` is in the frame of A, ideally near both bodies.
    pub fn new(pair: &BodyPair, c: &Vec3) -> Self {
        let point = [*c, pair.point_in_b(c)].map(|x| round(&x));
        let q = pair.orientation.coords;
        let turn = [q.x as f32, q.y as f32, q.z as f32, q.w as f32];
        Self { set: true, point, turn }
    }

    /// Returns the motion of the bodies since the reference, or `None` without one.
    pub fn moved(&self, pair: &BodyPair) -> Option<RelativeMotion> {
        if !self.set {
            return None;
        }
        let [a, b] = &self.point;
        let (a, b) = (widen(a), widen(b));
        let at_point = (pair.rotation * b + pair.offset - a).norm() + ROUNDING * pair.size;
        let [x, y, z, w] = self.turn;
        let old = nalgebra::Vector4::new(x.into(), y.into(), z.into(), w.into());
        let turn = pair.orientation.coords;
        let turn = 2.0 * (turn - old).norm_squared().min((turn + old).norm_squared()).sqrt();
        Some(RelativeMotion { at_point, rotation: turn })
    }
}

/// Exponential back-off for a feature cache of a pair. Affects cost only, never results.
///
/// Fast relative motion invalidates a cache before its first use; building it is then wasted work.
#[derive(Debug, Clone, Copy, Default)]
pub struct CacheBackoff {
    /// True if the last cache has not been used yet; it may not have been built.
    pending: bool,
    /// Caches in a row that were never used, at most [`MAX_FAILURES`].
    failures: u8,
    /// Invalidations to skip before the next rebuild.
    cooldown: u8,
}

/// Maximum number of times that the cooldown doubles.
const MAX_FAILURES: u8 = 4;

impl CacheBackoff {
    /// Records that the cache was used.
    pub fn record_hit(&mut self) {
        *self = Self::default();
    }

    /// Decides whether to rebuild the cache after it was invalidated.
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

/// List of at most `N` numbers below 256, or a mark that they were too many.
#[derive(Debug, Clone, Copy)]
pub struct IndexList<const N: usize> {
    /// Number of items; above N after an overflow.
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

    /// Returns an overflowed list.
    pub fn overflowed() -> Self {
        Self { count: u8::MAX, items: [0; N] }
    }

    /// Marks that there are more numbers than the list can hold.
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

    /// Returns item `k`.
    #[inline]
    pub fn item(&self, k: usize) -> usize {
        usize::from(self.items[k])
    }

    /// Returns the number of stored items.
    pub fn len(&self) -> usize {
        usize::from(self.count).min(N)
    }

    /// Returns the position of an item and appends it if it is new; any position after an overflow.
    pub fn position_or_push(&mut self, item: usize) -> usize {
        let known = self.iter().position(|i| i == item);
        known.unwrap_or_else(|| {
            self.push(item);
            self.len() - 1
        })
    }

    /// Returns the items in order, padded with the first one; zeros if there is none.
    pub fn padded(mut self) -> [u8; N] {
        let (first, count) = (self.items[0], self.len());
        self.items[count..].fill(first);
        self.items
    }

    /// True if the list has not overflowed.
    pub fn is_complete(&self) -> bool {
        usize::from(self.count) <= N
    }

    /// Iterates over the items in order; after an overflow over some of them.
    pub fn iter(&self) -> impl Iterator<Item = usize> + Clone {
        self.items.iter().take(usize::from(self.count)).map(|i| usize::from(*i))
    }
}

/// List of at most `N` pairs of numbers below 256 by descending bound, or a mark that they were too many.
#[derive(Debug, Clone, Copy)]
pub struct RankedList<const N: usize> {
    /// Number of items; above N after an overflow.
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

    /// True if the list has not overflowed.
    pub fn is_complete(&self) -> bool {
        usize::from(self.count) <= N
    }

    /// Iterates over the items and their bounds, in single precision; after an overflow over some of them.
    pub fn iter(&self) -> impl Iterator<Item = ([usize; 2], f64)> {
        let bounds = self.bounds.iter().map(|b| f64::from(*b));
        let items = self.items.iter().map(|item| item.map(usize::from));
        items.zip(bounds).take(usize::from(self.count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps that build a list, if a list built at step k is useful in the next step when `serves(k)`.
    fn rebuilding_steps(count: usize, serves: impl Fn(usize) -> bool) -> Vec<usize> {
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
    fn unused_caches_are_rebuilt_ever_more_rarely() {
        assert_eq!(rebuilding_steps(60, |_| false), [0, 2, 6, 14, 30, 46]);
    }

    #[test]
    fn a_used_cache_resets_the_backoff() {
        assert_eq!(rebuilding_steps(60, |_| true), [0]);
        assert_eq!(rebuilding_steps(60, |made| made >= 6), [0, 2, 6]);
    }
}
