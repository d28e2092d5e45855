//! Safeguarding of Anderson acceleration: detects changes that grow or stagnate.

/// Growth over the smallest change that counts as divergence.
const DIVERGENCE_FACTOR: f64 = 100.0;
/// Sweeps within which the smallest change must halve.
const STALL_SWEEPS: u64 = 200;
/// Plain sweeps after the first failure; their number doubles with each further one.
const COOLDOWN_SWEEPS: u64 = 20;
/// Maximum number of doublings of the cooldown.
const MAX_COOLDOWN_DOUBLINGS: u32 = 5;

/// Assessment of a change of the impulses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SafeguardVerdict {
    /// Smallest change since the last failure: these impulses are safe.
    NewBest,
    /// No failure.
    Acceptable,
    /// Failure: restore the safe impulses and clear the history.
    Diverging,
}

/// Safeguard that assesses the changes of the sweeps.
#[derive(Debug)]
pub struct Safeguard {
    /// Smallest change since the last failure.
    min_change: f64,
    /// Smallest change of all, updated when it has halved.
    reference: f64,
    /// Sweep of the last update of the reference.
    reference_sweep: u64,
    /// Sweep at which the cooldown ends.
    cooldown_end: u64,
    failures: u32,
}

impl Safeguard {
    /// Starts after sweep number `sweeps`.
    pub fn new(sweeps: u64) -> Self {
        Self {
            min_change: f64::INFINITY,
            reference: f64::INFINITY,
            reference_sweep: sweeps,
            cooldown_end: 0,
            failures: 0,
        }
    }

    /// Returns true if plain sweeps follow sweep number `sweeps`.
    pub fn is_cooling_down(&self, sweeps: u64) -> bool {
        sweeps < self.cooldown_end
    }

    /// Assesses the change of sweep number `sweeps`; NaN is divergence.
    pub fn assess(&mut self, change: f64, sweeps: u64) -> SafeguardVerdict {
        let stalled = sweeps > self.cooldown_end && sweeps > self.reference_sweep + STALL_SWEEPS;
        if stalled || change.is_nan() || change > DIVERGENCE_FACTOR * self.min_change {
            self.min_change = f64::INFINITY;
            self.cooldown_end = sweeps + (COOLDOWN_SWEEPS << self.failures);
            self.failures = (self.failures + 1).min(MAX_COOLDOWN_DOUBLINGS);
            if stalled {
                self.reference_sweep = self.cooldown_end;
            }
            return SafeguardVerdict::Diverging;
        }
        if change < 0.5 * self.reference {
            self.reference = change;
            self.reference_sweep = sweeps;
            self.failures = 0;
        }
        if change < self.min_change {
            self.min_change = change;
            return SafeguardVerdict::NewBest;
        }
        SafeguardVerdict::Acceptable
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_stagnation_and_nan_are_divergence() {
        let mut safeguard = Safeguard::new(0);
        assert_eq!(safeguard.assess(1.0, 3), SafeguardVerdict::NewBest);
        assert_eq!(safeguard.assess(99.0, 6), SafeguardVerdict::Acceptable);
        assert_eq!(safeguard.assess(101.0, 9), SafeguardVerdict::Diverging);
        assert!(safeguard.is_cooling_down(28) && !safeguard.is_cooling_down(29));
        // A failure resets the smallest change.
        assert_eq!(safeguard.assess(50.0, 12), SafeguardVerdict::NewBest);
        assert_eq!(safeguard.assess(f64::NAN, 15), SafeguardVerdict::Diverging);
        assert!(safeguard.is_cooling_down(54) && !safeguard.is_cooling_down(55));
        assert_eq!(safeguard.assess(0.8, 203), SafeguardVerdict::NewBest);
        assert_eq!(safeguard.assess(0.7, 204), SafeguardVerdict::Diverging);
    }
}
