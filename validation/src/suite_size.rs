//! Sizes of the samples.

/// Sizes of the samples of all checks: quick (a few minutes) or full.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SuiteSize {
    /// True for small samples.
    pub quick: bool,
}

impl SuiteSize {
    /// Number of beds per setting of a cycle. Tamping is chaotic, and small beds scatter most.
    pub fn beds(self) -> u64 {
        if self.quick { 8 } else { 5 }
    }

    /// Returns the number of grains for this size.
    pub fn grains(&self, quick: usize, full: usize) -> usize {
        if self.quick { quick } else { full }
    }
}
