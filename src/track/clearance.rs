//! Clearance of the tools: driven bodies have no contacts with each other, so a run would not notice that a tine passes
//! through a sleeper or a wall.

use crate::error::{Error, Result};
use crate::geometry::AxisBox;
use crate::track::plan::{Plan, SleeperPlan, TampingPlan, TinePlan};

/// Rounding of positions that are sums of decimal numbers, m: what is flush with a wall is inside.
pub const ROUNDING_TOLERANCE: f64 = 1e-9;

/// Maximum protrusion of a grain above the fill level after trimming, in mean grain sizes.
pub const MAX_TRIMMED_PROTRUSION: f64 = 0.5;
/// Maximum protrusion of grains above a prepared bed, in mean grain sizes: one may rise while the trimmed bed settles.
pub const MAX_PROTRUSION: f64 = MAX_TRIMMED_PROTRUSION + 0.25;

/// Refuses a plan whose tines would meet a sleeper, an end, a side or the floor on their way.
pub(super) fn check(plan: &Plan, tamping: &TampingPlan) -> Result<()> {
    for tine in &plan.tines {
        let lowest = tamping.deep_edge(&plan.bed) + tine.bounds().low.z;
        if tine.direction.abs() != 1.0 {
            return Err(refused(tine, "direction +1 or -1", tine.direction.to_string()));
        }
        let swept_area = swept_area(tine, tamping.squeeze.stroke, tamping.vibration.amplitude);
        let size = &plan.bed.size;
        let inside = swept_area.x[0] >= -ROUNDING_TOLERANCE
            && swept_area.x[1] <= size.x + ROUNDING_TOLERANCE
            && swept_area.y[0] >= -ROUNDING_TOLERANCE
            && swept_area.y[1] <= size.y + ROUNDING_TOLERANCE
            && lowest > 0.0;
        if !inside {
            return Err(refused(
                tine,
                "a way inside the box of the bed",
                format!("{swept_area}, lowest point at z = {lowest} m"),
            ));
        }
        for sleeper in &plan.sleepers {
            check_sleeper(tine, &swept_area, sleeper)?;
        }
    }
    Ok(())
}

/// Area that a tine sweeps in plan view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SweptArea {
    /// Range along the track, m.
    pub x: [f64; 2],
    /// Range across the track, m.
    pub y: [f64; 2],
}

impl std::fmt::Display for SweptArea {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let [x0, x1] = self.x;
        let [y0, y1] = self.y;
        write!(f, "x from {x0:.4} to {x1:.4} m, y from {y0:.4} to {y1:.4} m")
    }
}

/// Returns the area that blade and shaft sweep while the tine closes by `stroke` (m) and vibrates by `amplitude` (m).
pub fn swept_area(tine: &TinePlan, stroke: f64, amplitude: f64) -> SweptArea {
    let AxisBox { low, high } = tine.bounds();
    let [x, y] = tine.position;
    let closed = x + tine.direction * stroke;
    SweptArea {
        x: [x.min(closed) + (low.x - amplitude), x.max(closed) + (high.x + amplitude)],
        y: [y + low.y, y + high.y],
    }
}

fn check_sleeper(tine: &TinePlan, swept_area: &SweptArea, sleeper: &SleeperPlan) -> Result<()> {
    for block in &sleeper.blocks {
        let [cx, cy] = [sleeper.centre[0], sleeper.centre[1] + block.offset_y];
        let half = block.size * 0.5;
        let apart = swept_area.x[0] >= cx + half.x
            || swept_area.x[1] <= cx - half.x
            || swept_area.y[0] >= cy + half.y
            || swept_area.y[1] <= cy - half.y;
        if !apart {
            return Err(refused(
                tine,
                &format!("a way clear of sleeper {:?}", sleeper.name),
                format!(
                    "{swept_area} across the block at x from {:.4} to {:.4} m",
                    cx - half.x,
                    cx + half.x
                ),
            ));
        }
    }
    Ok(())
}

fn refused(tine: &TinePlan, expected: &str, found: String) -> Error {
    Error::Model { place: format!("tine {:?}", tine.name), expected: expected.into(), found }
}
