//! Equal boxes, as in the paper.

use crate::geometry::AxisBox;
use crate::math::Vec3;

/// Assigns the box of a regular grid to each position; returns the number of boxes.
///
/// The grid spans the bounding box of the positions.
pub(super) fn assign(grid: [u32; 3], position: &[Vec3], owner: &mut [u32]) -> usize {
    let grid = grid.map(|n| n.max(1));
    let AxisBox { low, high } = AxisBox::around(position.iter().copied());
    let cell = |x: &Vec3, axis: usize| {
        let extent = high[axis] - low[axis];
        let share = if extent > 0.0 { (x[axis] - low[axis]) / extent } else { 0.0 };
        ((share * grid[axis] as f64) as u32).min(grid[axis] - 1)
    };
    for (x, o) in position.iter().zip(owner) {
        *o = (cell(x, 2) * grid[1] + cell(x, 1)) * grid[0] + cell(x, 0);
    }
    grid.iter().map(|&n| n as usize).product()
}
