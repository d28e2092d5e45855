//! The standard zones of a plan: boxes in which compactness and the like are observed.
//!
//! Reads: the plan. Writes: named boxes, fixed in space.
//!
//! * `under/<sleeper>` (`under/<sleeper>/1`, `/2` for the blocks of a twin-block sleeper): the
//!   block's footprint from its underside before the lift down to half the depth of the ballast. Tamping
//!   fills and packs this layer: the blades' upper edge is 15-20 mm below the lifted underside, so a
//!   blade of 70 mm and its squeeze act within about half of 0.3 m, and what lies below is there
//!   for comparison with the layer in published work.
//! * `under_lifted/<sleeper>`, where the cycle lifts it: the same up to the lifted underside, so that the space which the lift
//!   opens counts. The sleeper is in that space before, which is no room for stones then.
//! * `crib_minus_x/<sleeper>`, `crib_plus_x/<sleeper>`: between a sleeper and its neighbours (or the ends) along x, across its
//!   blocks, from the underside up to the fill level. The crib between two sleepers is a zone of each.
//! * `insertion/<tine>`: what the blade passes through below the sleeper's underside before it squeezes, from its lower
//!   edge at depth up to the level of the underside before the lift, or to its upper edge where that ends higher.

use crate::geometry::AxisBox;
use crate::math::Vec3;
use crate::observe::Zone;
use crate::track::plan::{BlockPlan, Plan, SleeperPlan, TinePlan};

/// The zones of a plan: under all blocks of all sleepers, the same of tamped sleepers up to where they are lifted, the cribs, the
/// tines' insertion zones, in this order; without those that have no volume to measure, such as a crib that is not filled at all.
pub fn zones(plan: &Plan) -> Vec<Zone> {
    let mut zones = Vec::new();
    for sleeper in &plan.sleepers {
        zones.extend(under_blocks(plan, sleeper, "under", 0.0));
    }
    let lift = plan.tamping.map_or(0.0, |tamping| tamping.lift.height);
    for sleeper in plan.sleepers.iter().filter(|sleeper| sleeper.tamped && lift > 0.0) {
        zones.extend(under_blocks(plan, sleeper, "under_lifted", lift));
    }
    for sleeper in &plan.sleepers {
        let [before, after] = cribs(plan, sleeper);
        zones.push(Zone { name: format!("crib_minus_x/{}", sleeper.name), region: before });
        zones.push(Zone { name: format!("crib_plus_x/{}", sleeper.name), region: after });
    }
    for tine in &plan.tines {
        if let Some(region) = insertion(plan, tine) {
            zones.push(Zone { name: format!("insertion/{}", tine.name), region });
        }
    }
    zones.retain(has_volume);
    zones
}

fn has_volume(zone: &Zone) -> bool {
    zone.region.low.iter().zip(&zone.region.high).all(|(low, high)| low < high)
}

/// The zones under the blocks of a sleeper, up to a height above its underside before the lift, m.
fn under_blocks(
    plan: &Plan,
    sleeper: &SleeperPlan,
    place: &str,
    height: f64,
) -> impl Iterator<Item = Zone> {
    let is_single = sleeper.blocks.len() == 1;
    sleeper.blocks.iter().enumerate().map(move |(i, block)| {
        let number = if is_single { String::new() } else { format!("/{}", i + 1) };
        let mut region = under(plan, sleeper, block);
        region.high.z += height;
        Zone { name: format!("{place}/{}{number}", sleeper.name), region }
    })
}

fn under(plan: &Plan, sleeper: &SleeperPlan, block: &BlockPlan) -> AxisBox {
    let depth = plan.bed.preparation.ballast_depth;
    let [x, y] = [sleeper.centre[0], sleeper.centre[1] + block.offset_y];
    let half = block.size * 0.5;
    AxisBox {
        low: Vec3::new(x - half.x, y - half.y, 0.5 * depth),
        high: Vec3::new(x + half.x, y + half.y, depth),
    }
}

/// Least and greatest coordinate of a sleeper's blocks along an axis.
fn span(sleeper: &SleeperPlan, axis: usize) -> [f64; 2] {
    let offset = |b: &BlockPlan| sleeper.centre[axis] + if axis == 1 { b.offset_y } else { 0.0 };
    sleeper.blocks.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], b| {
        let half = 0.5 * b.size[axis];
        [low.min(offset(b) - half), high.max(offset(b) + half)]
    })
}

fn cribs(plan: &Plan, sleeper: &SleeperPlan) -> [AxisBox; 2] {
    let [x0, x1] = span(sleeper, 0);
    let [y0, y1] = span(sleeper, 1);
    let others = || plan.sleepers.iter().map(|s| span(s, 0));
    let before = others().map(|s| s[1]).filter(|x| *x <= x0).fold(0.0, f64::max);
    let after = others().map(|s| s[0]).filter(|x| *x >= x1).fold(plan.bed.size.x, f64::min);
    let preparation = &plan.bed.preparation;
    let crib = |x: [f64; 2]| AxisBox {
        low: Vec3::new(x[0], y0, preparation.ballast_depth),
        high: Vec3::new(x[1], y1, preparation.fill_level),
    };
    [crib([before, x0]), crib([x1, after])]
}

fn insertion(plan: &Plan, tine: &TinePlan) -> Option<AxisBox> {
    let tamping = plan.tamping?;
    let upper_edge = tamping.deep_edge(&plan.bed);
    let AxisBox { low, high } = tine.blade_bounds();
    let amplitude = tamping.vibration.amplitude;
    let [x, y] = tine.position;
    let top = plan.bed.preparation.ballast_depth.max(upper_edge);
    Some(AxisBox {
        low: Vec3::new(x + (low.x - amplitude), y + low.y, upper_edge + low.z),
        high: Vec3::new(x + (high.x + amplitude), y + high.y, top),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::test_plan::small_plan;

    fn region(zones: &[Zone], name: &str) -> AxisBox {
        zones.iter().find(|z| z.name == name).map(|z| z.region).unwrap_or_else(|| {
            panic!("{name:?} in {:?}", zones.iter().map(|z| &z.name).collect::<Vec<_>>())
        })
    }

    fn close(found: AxisBox, low: [f64; 3], high: [f64; 3]) {
        let (low, high) = (Vec3::from(low), Vec3::from(high));
        assert!(
            (found.low - low).norm() < 1e-12 && (found.high - high).norm() < 1e-12,
            "{found:?}"
        );
    }

    #[test]
    fn zones_of_one_short_block() {
        let zones = zones(&small_plan());
        assert_eq!(zones.len(), 6);
        close(region(&zones, "under/sleeper"), [0.155, 0.15, 0.14], [0.445, 0.55, 0.28]);
        let lift = small_plan().tamping.unwrap().lift.height;
        let high = [0.445, 0.55, 0.28 + lift];
        close(region(&zones, "under_lifted/sleeper"), [0.155, 0.15, 0.14], high);
        close(region(&zones, "crib_minus_x/sleeper"), [0.0, 0.15, 0.28], [0.155, 0.55, 0.43]);
        close(region(&zones, "crib_plus_x/sleeper"), [0.445, 0.15, 0.28], [0.6, 0.55, 0.43]);
        close(region(&zones, "insertion/left"), [0.034, 0.29, 0.21], [0.066, 0.41, 0.28]);
    }

    #[test]
    fn what_has_no_volume_is_no_zone() {
        let mut plan = small_plan();
        plan.bed.preparation.fill_level = plan.bed.preparation.ballast_depth;
        let zones = zones(&plan);
        let names: Vec<_> = zones.iter().map(|zone| &zone.name[..]).collect();
        assert_eq!(
            names,
            ["under/sleeper", "under_lifted/sleeper", "insertion/left", "insertion/right"]
        );
    }

    #[test]
    fn cribs_end_at_the_neighbours_and_twin_blocks_are_numbered() {
        let mut plan = small_plan();
        plan.bed.size = Vec3::new(1.8, 2.0, 0.45);
        let mut twin = plan.sleepers[0].clone();
        twin.blocks = vec![
            BlockPlan { offset_y: -0.6, size: Vec3::new(0.29, 0.67, 0.15) },
            BlockPlan { offset_y: 0.6, size: Vec3::new(0.29, 0.67, 0.15) },
        ];
        plan.sleepers = [0.3, 0.9, 1.5]
            .map(|x| SleeperPlan {
                name: format!("at {x}"),
                centre: [x, 1.0],
                tamped: x == 0.9,
                mount: None,
                ..twin.clone()
            })
            .to_vec();
        let zones = zones(&plan);
        close(region(&zones, "crib_minus_x/at 0.9"), [0.445, 0.065, 0.28], [0.755, 1.935, 0.43]);
        close(region(&zones, "crib_plus_x/at 0.9"), [1.045, 0.065, 0.28], [1.355, 1.935, 0.43]);
        close(region(&zones, "under/at 0.9/2"), [0.755, 1.265, 0.14], [1.045, 1.935, 0.28]);
        // Sleepers that are not tamped have zones too, for comparison.
        close(region(&zones, "crib_plus_x/at 0.3"), [0.445, 0.065, 0.28], [0.755, 1.935, 0.43]);
        close(region(&zones, "under/at 1.5/2"), [1.355, 1.265, 0.14], [1.645, 1.935, 0.28]);
        let lifted = zones.iter().filter(|zone| zone.name.starts_with("under_lifted/"));
        assert!(lifted.clone().count() == 2 && lifted.clone().all(|z| z.name.contains("at 0.9")));
    }
}
