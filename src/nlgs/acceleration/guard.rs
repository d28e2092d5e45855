//! What keeps the acceleration from doing harm: it notices when changes grow or do not fall.

/// Growth of a change after which the acceleration is taken back.
const ASTRAY: f64 = 100.0;
/// Sweeps within which the least change has to be halved.
const PATIENCE: u64 = 200;
/// Plain sweeps after a failure; twice as many after each further one.
const REST: u64 = 20;
const MOST_DOUBLINGS: u32 = 5;

/// What a change says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The least since the last failure: these impulses are safe.
    Best,
    Fair,
    /// Go back to the safe impulses, and forget.
    Astray,
}

/// Watches the changes of the sweeps.
#[derive(Debug)]
pub struct Guard {
    /// Least change since the last failure.
    least: f64,
    /// Least change of all, counted when it is halved, and the sweep of that.
    halved: f64,
    halved_at: u64,
    rests_until: u64,
    failures: u32,
}

impl Guard {
    pub fn new(sweeps: u64) -> Self {
        let (least, halved) = (f64::INFINITY, f64::INFINITY);
        Self { least, halved, halved_at: sweeps, rests_until: 0, failures: 0 }
    }

    /// Whether only plain sweeps are wanted after this one.
    pub fn rests(&self, sweeps: u64) -> bool {
        sweeps < self.rests_until
    }

    /// Judges the change of sweep number `sweeps`; one that is not a number is astray.
    pub fn judge(&mut self, change: f64, sweeps: u64) -> Verdict {
        let stalled = sweeps > self.rests_until && sweeps > self.halved_at + PATIENCE;
        if stalled || change.is_nan() || change > ASTRAY * self.least {
            self.least = f64::INFINITY;
            self.rests_until = sweeps + (REST << self.failures);
            self.failures = (self.failures + 1).min(MOST_DOUBLINGS);
            if stalled {
                self.halved_at = self.rests_until;
            }
            return Verdict::Astray;
        }
        if change < 0.5 * self.halved {
            self.halved = change;
            self.halved_at = sweeps;
            self.failures = 0;
        }
        if change < self.least {
            self.least = change;
            return Verdict::Best;
        }
        Verdict::Fair
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_grows_stalls_or_is_no_number_is_astray() {
        let mut guard = Guard::new(0);
        assert_eq!(guard.judge(1.0, 3), Verdict::Best);
        assert_eq!(guard.judge(99.0, 6), Verdict::Fair);
        assert_eq!(guard.judge(101.0, 9), Verdict::Astray);
        assert!(guard.rests(28) && !guard.rests(29));
        // The least is forgotten with the failure, so that the way back counts from anew.
        assert_eq!(guard.judge(50.0, 12), Verdict::Best);
        assert_eq!(guard.judge(f64::NAN, 15), Verdict::Astray);
        assert!(guard.rests(54) && !guard.rests(55));
        assert_eq!(guard.judge(0.8, 203), Verdict::Best);
        assert_eq!(guard.judge(0.7, 204), Verdict::Astray);
    }
}
