//! Writes rows of sleepers and tines out as single ones, each with the keys it came from.

use crate::case_file::{
    BlockSection, CaseFile, SleeperSection, SqueezeDirection, TineRows, TineSection,
};
use crate::mount;
use crate::report::{Finding, Report};
use ballast::math::Vec3;
use ballast::track::plan::{BlockPlan, SleeperPlan, TinePlan};

/// Sleepers and tines of a case, written out.
#[derive(Default)]
pub struct Layout {
    pub sleepers: Vec<Placed<SleeperPlan>>,
    pub tines: Vec<Placed<TinePlan>>,
}

/// A sleeper or tine and the keys that say where it stands.
pub struct Placed<T> {
    pub plan: T,
    /// Its own table.
    pub key: String,
    pub key_x: String,
    pub key_y: String,
}

/// Sleepers and tines together: far more than any machine has, few enough to compare all pairs.
const MOST_BODIES: usize = 2000;

/// Sleepers and tines of `case`.
pub fn lay_out(case: &CaseFile, report: &mut Report) -> Layout {
    let mut layout = Layout::default();
    if !report.clean(&["bed.size_m", "sleepers", "sleeper", "tines", "tine"]) {
        return layout;
    }
    let single = case.sleeper.len() + case.tine.len();
    if single > MOST_BODIES {
        let key = if case.tine.is_empty() { "sleeper" } else { "tine" };
        too_many(report, key, single);
        return layout;
    }
    row_of_sleepers(case, report, &mut layout);
    for (i, sleeper) in case.sleeper.iter().enumerate() {
        layout.sleepers.push(single_sleeper(i, sleeper, lifts(case), report));
    }
    let tamped = layout.sleepers.iter().filter(|s| s.plan.tamped).count();
    let beside_each = case.tines.as_ref().map_or(0, |tines| 2 * tines.y_offsets_m.len());
    let count = layout.sleepers.len() + tamped * beside_each + case.tine.len();
    if count > MOST_BODIES {
        let key = if case.tines.is_some() { "tines" } else { "sleepers" };
        too_many(report, key, count);
        return layout;
    }
    if let Some(tines) = &case.tines {
        rows_of_tines(tines, report, &mut layout);
    }
    let single = case.tine.iter().enumerate().map(|(i, tine)| single_tine(i, tine, report));
    layout.tines.extend(single);
    layout
}

fn too_many(report: &mut Report, key: &str, count: usize) {
    let finding = Finding {
        problem: "too many sleepers and tines".into(),
        found: count.to_string(),
        expected: format!("at most {MOST_BODIES} together"),
        hint: None,
    };
    report.error(key, finding);
}

fn row_of_sleepers(case: &CaseFile, report: &mut Report, layout: &mut Layout) {
    let Some(row) = &case.sleepers else { return };
    if row.count > 1 && row.pitch_m.is_none() {
        let finding = Finding {
            problem: "missing key `pitch_m`".into(),
            found: format!("{} sleepers", row.count),
            expected: "`pitch_m`: a number above 0 — distance between neighbours, m".into(),
            hint: None,
        };
        report.error("sleepers.pitch_m", finding);
        return;
    }
    for (i, number) in row.tamped.iter().enumerate() {
        let repeated = row.tamped[..i].contains(number);
        if *number > row.count || repeated {
            let finding = Finding {
                problem: match repeated {
                    true => "a sleeper is named twice".into(),
                    false => "there is no sleeper of this number".into(),
                },
                found: number.to_string(),
                expected: format!("different numbers from 1 to {}", row.count),
                hint: None,
            };
            report.error(&format!("sleepers.tamped[{i}]"), finding);
        }
    }
    let [size_x, size_y, _] = case.bed.size_m;
    let pitch = row.pitch_m.unwrap_or(0.0);
    let first = row.first_x_m.unwrap_or(0.5 * (size_x - pitch * f64::from(row.count - 1)));
    let blocks: Vec<BlockPlan> = row.blocks.iter().map(block).collect();
    let mount = row.mount.and_then(|m| {
        let is_lifted = lifts(case) && !row.tamped.is_empty();
        mount::of_sleeper(&m, &blocks, is_lifted, "sleepers.mount", report)
    });
    for number in 1..=row.count {
        let centre = [first + pitch * f64::from(number - 1), row.y_m.unwrap_or(0.5 * size_y)];
        layout.sleepers.push(Placed {
            plan: SleeperPlan {
                name: format!("sleeper_{number}"),
                centre,
                blocks: blocks.clone(),
                tamped: row.tamped.contains(&number),
                mount,
            },
            key: "sleepers".into(),
            key_x: match row.first_x_m {
                Some(_) => "sleepers.first_x_m".into(),
                None => "sleepers.pitch_m".into(),
            },
            key_y: "sleepers.y_m".into(),
        });
    }
}

/// Whether tamped sleepers are lifted.
fn lifts(case: &CaseFile) -> bool {
    case.tamping.as_ref().is_some_and(|tamping| tamping.lift.height_m > 0.0)
}

fn single_sleeper(
    i: usize,
    sleeper: &SleeperSection,
    lifts: bool,
    report: &mut Report,
) -> Placed<SleeperPlan> {
    let blocks: Vec<BlockPlan> = sleeper.blocks.iter().map(block).collect();
    let key = format!("sleeper[{i}].mount");
    let is_lifted = lifts && sleeper.tamped;
    let mount = sleeper.mount.and_then(|m| mount::of_sleeper(&m, &blocks, is_lifted, &key, report));
    Placed {
        plan: SleeperPlan {
            name: sleeper.name.clone(),
            centre: [sleeper.x_m, sleeper.y_m],
            blocks,
            tamped: sleeper.tamped,
            mount,
        },
        key: format!("sleeper[{i}]"),
        key_x: format!("sleeper[{i}].x_m"),
        key_y: format!("sleeper[{i}].y_m"),
    }
}

fn block(block: &BlockSection) -> BlockPlan {
    BlockPlan { offset_y: block.offset_y_m, size: Vec3::from(block.size_m) }
}

/// A facing pair at each y offset of each tamped sleeper.
fn rows_of_tines(tines: &TineRows, report: &mut Report, layout: &mut Layout) {
    let tamped: Vec<SleeperPlan> =
        layout.sleepers.iter().filter(|s| s.plan.tamped).map(|s| s.plan.clone()).collect();
    // Where `tamped` names sleepers that are not there, or the row has no pitch, that is told already.
    if tamped.is_empty() && report.clean(&["sleepers"]) {
        let key = if report.document.has("sleepers.tamped") { "sleepers.tamped" } else { "tines" };
        let finding = Finding {
            problem: "rows of tines need a tamped sleeper".into(),
            found: "no sleeper is tamped".into(),
            expected: "`tamped = [1]` in `[sleepers]`, or `tamped = true` in a `[[sleeper]]`"
                .into(),
            hint: None,
        };
        report.error(key, finding);
    }
    let sizes = [tines.blade_size_m, tines.shaft_size_m];
    let mount = mount::of_tine(&tines.mount, sizes, "tines.mount", report);
    let mut pair = 0;
    for sleeper in &tamped {
        for (i, offset) in tines.y_offsets_m.iter().enumerate() {
            let key_y = format!("tines.y_offsets_m[{i}]");
            let Some(half) = half_length(sleeper, *offset) else {
                outside_block(report, &key_y, sleeper, *offset);
                continue;
            };
            let distance = half + tines.gap_to_sleeper_m + 0.5 * tines.blade_size_m[0];
            // The tine on the far side squeezes back.
            for (side, direction) in [("plus", 1.0), ("minus", -1.0)] {
                let x = sleeper.centre[0] - direction * distance;
                layout.tines.push(Placed {
                    plan: TinePlan {
                        name: format!("tine_{}_{side}", pair + 1),
                        position: [x, sleeper.centre[1] + offset],
                        direction,
                        pair,
                        blade: Vec3::from(tines.blade_size_m),
                        shaft: Vec3::from(tines.shaft_size_m),
                        mount,
                    },
                    key: "tines".into(),
                    key_x: "tines.gap_to_sleeper_m".into(),
                    key_y: key_y.clone(),
                });
            }
            pair += 1;
        }
    }
}

/// Half the length along x of the block that a tine at this offset faces.
fn half_length(sleeper: &SleeperPlan, offset: f64) -> Option<f64> {
    let faced = sleeper.blocks.iter().filter(|b| (offset - b.offset_y).abs() <= 0.5 * b.size.y);
    faced.map(|b| 0.5 * b.size.x).reduce(f64::max)
}

fn outside_block(report: &mut Report, key: &str, sleeper: &SleeperPlan, offset: f64) {
    let ranges: Vec<String> = sleeper
        .blocks
        .iter()
        .map(|b| {
            format!("{:.3} to {:.3}", b.offset_y - 0.5 * b.size.y, b.offset_y + 0.5 * b.size.y)
        })
        .collect();
    let finding = Finding {
        problem: format!("a tine beside `{}` faces none of its blocks", sleeper.name),
        found: format!("{offset} m"),
        expected: format!("an offset within a block: {} m", ranges.join(", ")),
        hint: None,
    };
    report.error(key, finding);
}

fn single_tine(i: usize, tine: &TineSection, report: &mut Report) -> Placed<TinePlan> {
    let sizes = [tine.blade_size_m, tine.shaft_size_m];
    let mount = mount::of_tine(&tine.mount, sizes, &format!("tine[{i}].mount"), report);
    Placed {
        plan: TinePlan {
            name: tine.name.clone(),
            position: [tine.x_m, tine.y_m],
            direction: match tine.squeeze_direction {
                SqueezeDirection::PlusX => 1.0,
                SqueezeDirection::MinusX => -1.0,
            },
            pair: tine.pair,
            blade: Vec3::from(tine.blade_size_m),
            shaft: Vec3::from(tine.shaft_size_m),
            mount,
        },
        key: format!("tine[{i}]"),
        key_x: format!("tine[{i}].x_m"),
        key_y: format!("tine[{i}].y_m"),
    }
}
