//! How much is computed.

/// Sizes of the checks: a few minutes, or as long as good figures take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    pub quick: bool,
}

impl Size {
    /// How many beds each setting of a cycle is tried on: a single one says nothing, for tamping is chaotic. Those of few
    /// stones differ most.
    pub fn beds(self) -> u64 {
        if self.quick { 8 } else { 5 }
    }

    /// How many heaps of stones have their slopes measured: of 120 stones, one differs from another by 9°.
    pub fn heaps(self) -> u64 {
        if self.quick { 6 } else { 3 }
    }

    /// One of two numbers of grains.
    pub fn grains(&self, quick: usize, full: usize) -> usize {
        if self.quick { quick } else { full }
    }
}
