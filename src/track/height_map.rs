//! Height map of a bed on a raster, on which falling grains come to rest.
//!
//! Reads: grains at rest or being poured. Writes: only the raster.
//! Cost: O(cells under the grain) per query.
//! Contract: bounds are conservative, so grains placed by it never overlap, whatever the cell.

use crate::error::{Error, Result};
use crate::geometry::{AxisBox, Polyhedron};
use crate::math::Quat;

/// Faces steeper than this (z component of their normal) bound nothing from above or below.
const STEEP: f64 = 1e-6;
/// Maximum number of cells of the raster that a bed is poured on, 1.6 GB: a box of 28 m × 28 m at 2 mm, with more stones than fit a
/// machine.
pub const MAX_CELLS: f64 = 2e8;

/// Upper surface of the bed over square cells.
#[derive(Debug, Clone)]
pub(super) struct HeightMap {
    /// Edge of a cell, m.
    pub cell: f64,
    columns: usize,
    rows: usize,
    /// Upper bound of the surface in each cell, m; infinite where nothing may be placed.
    height: Vec<f64>,
}

/// Cells that a grain of one orientation covers, relative to the cell of its origin.
#[derive(Debug, Clone, Default)]
pub(super) struct Footprint {
    cells: Vec<CoveredCell>,
}

#[derive(Debug, Clone, Copy)]
struct CoveredCell {
    column: i64,
    row: i64,
    /// Bounds of the grain over the cell, relative to its origin, m.
    low: f64,
    high: f64,
}

impl Footprint {
    /// Computes the footprint of a grain whose origin is at `within` (0 to 1, in cells) of its cell.
    pub fn cover(&mut self, grain: &Polyhedron, turn: &Quat, within: [f64; 2], cell: f64) {
        self.cells.clear();
        let bounds = turned_bounds(grain, turn);
        let faces: Vec<[f64; 4]> = grain
            .face_normals
            .iter()
            .zip(&grain.face_offsets)
            .map(|(normal, offset)| {
                let n = turn * normal;
                [n.x, n.y, n.z, *offset]
            })
            .collect();
        let span = |axis: usize| {
            let first = (bounds.low[axis] / cell + within[axis]).floor() as i64;
            let last = (bounds.high[axis] / cell + within[axis]).floor() as i64;
            first..=last
        };
        for row in span(1) {
            for column in span(0) {
                let x = (column as f64 + 0.5 - within[0]) * cell;
                let y = (row as f64 + 0.5 - within[1]) * cell;
                let within_cell = over_cell(&faces, x, y, 0.5 * cell);
                let Some((low, high)) = within_cell else { continue };
                let (low, high) = (low.max(bounds.low.z), high.min(bounds.high.z));
                if low <= high {
                    self.cells.push(CoveredCell { column, row, low, high });
                }
            }
        }
    }
}

/// Bounds over the square of half edge `half` around (x, y) of a solid given by its faces
/// (normal, offset); `None` if no point of the solid is above the square.
///
/// The least value of a maximum of planes is at least the maximum of the planes' least values.
fn over_cell(faces: &[[f64; 4]], x: f64, y: f64, half: f64) -> Option<(f64, f64)> {
    let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
    for &[nx, ny, nz, offset] in faces {
        let slack = (nx.abs() + ny.abs()) * half;
        let rest = offset - nx * x - ny * y + slack;
        if nz > STEEP {
            high = high.min(rest / nz);
        } else if nz < -STEEP {
            low = low.max(rest / nz);
        } else if rest < 0.0 {
            return None;
        }
    }
    (low <= high).then_some((low, high))
}

/// Bounding box of a turned grain about its origin.
pub(super) fn turned_bounds(grain: &Polyhedron, turn: &Quat) -> AxisBox {
    AxisBox::around(grain.vertices.iter().map(|v| turn * v))
}

impl HeightMap {
    /// An empty floor, `size` in x and y (m), with cells of about `cell`.
    pub fn flat(size: [f64; 2], cell: f64) -> Result<Self> {
        let count = |length: f64| (length / cell).ceil();
        if !(count(size[0]) * count(size[1]) <= MAX_CELLS) {
            return Err(Error::Model {
                place: "bed.size".into(),
                expected: format!("at most {MAX_CELLS} cells of {cell} m in plan view"),
                found: format!("{} x {} m", size[0], size[1]),
            });
        }
        let (columns, rows) = (count(size[0]) as usize, count(size[1]) as usize);
        Ok(Self { cell, columns, rows, height: vec![0.0; columns * rows] })
    }

    /// Keeps grains clear of a rectangle.
    pub fn forbid(&mut self, low: [f64; 2], high: [f64; 2]) {
        let index = |x: f64, count: usize| ((x / self.cell).floor().max(0.0) as usize).min(count);
        let columns = index(low[0], self.columns)..index(high[0] + self.cell, self.columns);
        for row in index(low[1], self.rows)..index(high[1] + self.cell, self.rows) {
            let start = row * self.columns;
            self.height[start + columns.start..start + columns.end].fill(f64::INFINITY);
        }
    }

    /// Height of a grain's origin at which it comes to lie on the relief, its origin in the cell
    /// (column, row); not below `better`: what is at least as high as that is not looked at.
    pub fn rest(&self, grain: &Footprint, at: [i64; 2], better: f64) -> f64 {
        let mut z = f64::NEG_INFINITY;
        for cell in &grain.cells {
            if let Some(i) = self.index(at[0] + cell.column, at[1] + cell.row) {
                z = z.max(self.height[i] - cell.low);
                if z >= better {
                    return f64::INFINITY;
                }
            }
        }
        z
    }

    /// Raises the relief by a grain whose origin is at height `z` in the cell (column, row).
    pub fn add(&mut self, grain: &Footprint, at: [i64; 2], z: f64) {
        for cell in &grain.cells {
            if let Some(i) = self.index(at[0] + cell.column, at[1] + cell.row) {
                self.height[i] = self.height[i].max(z + cell.high);
            }
        }
    }

    /// Returns the missing volume below a level where grains may be placed, m³, and the area there, m².
    pub fn lacking(&self, level: f64) -> [f64; 2] {
        let area = self.cell * self.cell;
        let open = self.height.iter().filter(|height| height.is_finite());
        open.fold([0.0; 2], |[volume, whole], height| {
            [volume + area * (level - height).max(0.0), whole + area]
        })
    }

    /// Returns the share of the area where grains may be placed.
    pub fn open_share(&self) -> f64 {
        let open = self.height.iter().filter(|height| height.is_finite()).count();
        open as f64 / self.height.len() as f64
    }

    fn index(&self, column: i64, row: i64) -> Option<usize> {
        let inside = column >= 0
            && row >= 0
            && (column as usize) < self.columns
            && (row as usize) < self.rows;
        inside.then(|| row as usize * self.columns + column as usize)
    }

    /// Largest difference to a relief of the same raster, m.
    #[cfg(test)]
    pub fn largest_difference(&self, other: &Self) -> f64 {
        assert_eq!(self.height.len(), other.height.len());
        let differences = self.height.iter().zip(&other.height).map(|(a, b)| (a - b).abs());
        differences.fold(0.0, f64::max)
    }
}
