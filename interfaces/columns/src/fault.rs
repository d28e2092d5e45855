//! Invalid values of columns.

use std::fmt;

/// Invalid value at a place in a file or a block of bytes that the caller knows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault {
    /// Name of the column.
    pub place: String,
    /// Expected content.
    pub expected: String,
    /// Found content.
    pub found: String,
}

impl Fault {
    /// Creates a fault.
    pub fn new(
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl ToString,
    ) -> Self {
        Self { place: place.into(), expected: expected.into(), found: found.to_string() }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}: expected {}, found {}", self.place, self.expected, self.found)
    }
}

impl std::error::Error for Fault {}
