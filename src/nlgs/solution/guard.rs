//! What keeps the acceleration (T-32) from doing harm: it notices when changes grow or do not fall.

use crate::math::Vec3;

/// Growth of a sweep's change after which the acceleration is taken back.
const ASTRAY: f64 = 100.0;
/// Sweeps within which the least change has to be halved.
const PATIENCE: u64 = 200;
/// Plain sweeps after a failure; twice as many after each further one.
const REST: u64 = 20;
const MOST_DOUBLINGS: u32 = 5;

/// Watches the changes of the sweeps.
pub(super) struct Guard {
    /// Impulses after the sweep of least change since the last failure `[nc]`.
    pub safe: Vec<Vec3>,
    least: f64,
    /// Least change of all, counted when it is halved, and the sweep of that.
    halved: f64,
    halved_at: u64,
    rests_until: u64,
    failures: u32,
}

impl Guard {
    pub fn new(impulse: &[Vec3], sweeps: u64) -> Self {
        let (least, halved) = (f64::INFINITY, f64::INFINITY);
        Self {
            safe: impulse.to_vec(),
            least,
            halved,
            halved_at: sweeps,
            rests_until: 0,
            failures: 0,
        }
    }

    /// Whether only plain sweeps are wanted after this one.
    pub fn rests(&self, sweeps: u64) -> bool {
        sweeps < self.rests_until
    }

    /// Takes note of a sweep; false when the iteration has to go back to the safe impulses.
    pub fn accepts(&mut self, change: f64, impulse: &[Vec3], sweeps: u64) -> bool {
        let stalled = sweeps > self.rests_until && sweeps > self.halved_at + PATIENCE;
        if stalled || change > ASTRAY * self.least {
            self.least = f64::INFINITY;
            self.rests_until = sweeps + (REST << self.failures);
            self.failures = (self.failures + 1).min(MOST_DOUBLINGS);
            if stalled {
                self.halved_at = self.rests_until;
            }
            return false;
        }
        if change < 0.5 * self.halved {
            self.halved = change;
            self.halved_at = sweeps;
            self.failures = 0;
        }
        if change < self.least {
            self.least = change;
            self.safe.copy_from_slice(impulse);
        }
        true
    }
}
