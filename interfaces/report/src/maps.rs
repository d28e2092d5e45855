//! Maps of the compactness in cells of a vertical section along the track.

use crate::plot::{HeatMap, Legend};
use crate::section;
use ballast::geometry::AxisBox;
use ballast::math::{Pose, Vec3};
use ballast::model::{Model, Role};
use ballast::observe::{self, Zone};
use ballast::state::State;

/// Grid of cells: edges along x and z, and extent across the track, m.
#[derive(Debug, Clone, PartialEq)]
pub struct CompactnessGrid {
    pub x: Vec<f64>,
    pub z: Vec<f64>,
    pub y: [f64; 2],
}

/// Maximum number of cells along an edge.
const MAX_CELLS: usize = 36;

impl CompactnessGrid {
    /// Creates cells of about `cell` m over the box of a bed up to `top`.
    pub fn over(size: &Vec3, top: f64, y: [f64; 2], cell: f64) -> Self {
        let edges = |length: f64| -> Vec<f64> {
            let count = ((length / cell).round() as usize).clamp(1, MAX_CELLS);
            (0..=count).map(|k| length * k as f64 / count as f64).collect()
        };
        Self { x: edges(size.x), z: edges(top), y }
    }

    /// Draws the map of bodies at `poses` `[nb]`; cells that driven bodies fill are absent.
    pub fn map(&self, title: &str, model: &Model, poses: &[Pose], legend: &Legend) -> String {
        let mut state = State::default();
        poses.iter().for_each(|pose| state.push(*pose));
        let mut values = Vec::new();
        for z in self.z.windows(2) {
            for x in self.x.windows(2) {
                let region = AxisBox {
                    low: Vec3::new(x[0], self.y[0], z[0]),
                    high: Vec3::new(x[1], self.y[1], z[1]),
                };
                let zone = Zone { name: title.into(), region };
                let found = observe::compactness(model, &state, &zone).ok();
                // In a sliver beside a sleeper a single stone decides.
                let free = found.filter(|f| f.accessible > 0.2 * region.volume());
                values.push(free.map_or(f64::NAN, |f| f.compactness));
            }
        }
        let title = title.to_string();
        let outlines = self.outlines(model, poses);
        HeatMap { title, x: self.x.clone(), z: self.z.clone(), values, outlines }.svg(legend)
    }
    /// Returns sleepers and tines, cut in the middle of the cells.
    fn outlines(&self, model: &Model, poses: &[Pose]) -> Vec<Vec<[f64; 2]>> {
        let middle = 0.5 * (self.y[0] + self.y[1]);
        let top = self.z.last().copied().unwrap_or(0.0);
        let tools = (0..model.driven.len()).filter(|d| model.driven[*d].role != Role::Boundary);
        let cuts = tools.flat_map(|d| section::cuts(model, d, poses, middle));
        cuts.map(|corners| section::below(&corners, top)).filter(|c| c.len() > 2).collect()
    }
}
