//! How much is computed.

/// Sizes of the checks: a few minutes, or as long as good figures take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Size {
    pub quick: bool,
}

impl Size {
    /// One of two numbers of grains.
    pub fn grains(&self, quick: usize, full: usize) -> usize {
        if self.quick { quick } else { full }
    }
}
