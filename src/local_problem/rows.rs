//! Rows of numbers, one per lane.

use crate::lanes::LANES;

/// Row of f32, one per lane.
pub type Row32 = [f32; LANES];
/// Row of f64, one per lane.
pub type Row64 = [f64; LANES];
