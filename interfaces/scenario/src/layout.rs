//! Expansion of rows of sleepers and tines to single bodies, and plates, each with the keys that define it.

use crate::case_file::{
    BlockSection, CaseFile, SleeperSection, SqueezeDirection, TineRows, TineSection,
};
use crate::diagnostic::DiagnosticText;
use crate::mount;
use crate::placed_body::PlacedBody;
use crate::plate;
use crate::report::DiagnosticReport;
use crate::tine_shape::tine_shape;
use ballast::math::Vec3;
use ballast::track::plan::{BlockPlan, PlatePlan, SleeperPlan, TinePlan};

/// Sleepers, tines and plates of a case.
#[derive(Default)]
pub struct Layout {
    pub sleepers: Vec<PlacedBody<SleeperPlan>>,
    pub tines: Vec<PlacedBody<TinePlan>>,
    pub plates: Vec<PlacedBody<PlatePlan>>,
}

/// Maximum number of sleepers, tines and plates: far more than any machine has, few enough to compare all pairs.
const MAX_BODIES: usize = 2000;

impl Layout {
    /// Creates the bodies of `case`; reports rows and mounts with errors.
    pub fn of(case: &CaseFile, report: &mut DiagnosticReport) -> Self {
        let mut layout = Self::default();
        if !report.is_clean(&["bed.size_m", "sleepers", "sleeper", "tines", "tine", "plate"]) {
            return layout;
        }
        let single = case.sleeper.len() + case.tine.len() + case.plate.len();
        if single > MAX_BODIES {
            let lists = [("plate", case.plate.len()), ("tine", case.tine.len())];
            let key = lists.iter().find(|(_, count)| *count > 0).map_or("sleeper", |(key, _)| key);
            too_many(report, key, single);
            return layout;
        }
        add_sleeper_row(case, report, &mut layout);
        for (i, sleeper) in case.sleeper.iter().enumerate() {
            layout.sleepers.push(single_sleeper(i, sleeper, lifts(case), report));
        }
        let tamped = layout.sleepers.iter().filter(|s| s.plan.tamped).count();
        let tines_per_sleeper = case.tines.as_ref().map_or(0, |tines| 2 * tines.y_offsets_m.len());
        let count =
            layout.sleepers.len() + tamped * tines_per_sleeper + case.tine.len() + case.plate.len();
        if count > MAX_BODIES {
            let key = if case.tines.is_some() { "tines" } else { "sleepers" };
            too_many(report, key, count);
            return layout;
        }
        if let Some(tines) = &case.tines {
            add_tine_rows(tines, report, &mut layout);
        }
        let single = case.tine.iter().enumerate().map(|(i, tine)| single_tine(i, tine, report));
        layout.tines.extend(single);
        let plates = case.plate.iter().enumerate().map(|(i, p)| plate::placed(i, p, case, report));
        layout.plates.extend(plates);
        layout
    }
}

fn too_many(report: &mut DiagnosticReport, key: &str, count: usize) {
    let text = DiagnosticText {
        problem: "too many sleepers, tines and plates".into(),
        found: count.to_string(),
        expected: format!("at most {MAX_BODIES} together"),
        hint: None,
    };
    report.error(key, text);
}

fn add_sleeper_row(case: &CaseFile, report: &mut DiagnosticReport, layout: &mut Layout) {
    let Some(row) = &case.sleepers else { return };
    if row.count > 1 && row.pitch_m.is_none() {
        let text = DiagnosticText {
            problem: "missing key `pitch_m`".into(),
            found: format!("{} sleepers", row.count),
            expected: "`pitch_m`: a number above 0 — distance between neighbours, m".into(),
            hint: None,
        };
        report.error("sleepers.pitch_m", text);
        return;
    }
    for (i, number) in row.tamped.iter().enumerate() {
        let repeated = row.tamped[..i].contains(number);
        if *number > row.count || repeated {
            let text = DiagnosticText {
                problem: match repeated {
                    true => "a sleeper is listed twice".into(),
                    false => "no sleeper has this number".into(),
                },
                found: number.to_string(),
                expected: format!("different numbers from 1 to {}", row.count),
                hint: None,
            };
            report.error(&format!("sleepers.tamped[{i}]"), text);
        }
    }
    let [size_x, size_y, _] = case.bed.size_m;
    let pitch = row.pitch_m.unwrap_or(0.0);
    let first = row.first_x_m.unwrap_or(0.5 * (size_x - pitch * f64::from(row.count - 1)));
    let blocks: Vec<BlockPlan> = row.blocks.iter().map(block).collect();
    let mount = row.mount.and_then(|m| {
        let is_lifted = lifts(case) && !row.tamped.is_empty();
        mount::sleeper_mount(&m, &blocks, is_lifted, "sleepers.mount", report)
    });
    for number in 1..=row.count {
        let centre = [first + pitch * f64::from(number - 1), row.y_m.unwrap_or(0.5 * size_y)];
        layout.sleepers.push(PlacedBody {
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

/// True if the cycle lifts tamped sleepers.
fn lifts(case: &CaseFile) -> bool {
    case.tamping.as_ref().is_some_and(|tamping| tamping.lift.height_m > 0.0)
}

fn single_sleeper(
    i: usize,
    sleeper: &SleeperSection,
    lifts: bool,
    report: &mut DiagnosticReport,
) -> PlacedBody<SleeperPlan> {
    let blocks: Vec<BlockPlan> = sleeper.blocks.iter().map(block).collect();
    let key = format!("sleeper[{i}].mount");
    let is_lifted = lifts && sleeper.tamped;
    let mount =
        sleeper.mount.and_then(|m| mount::sleeper_mount(&m, &blocks, is_lifted, &key, report));
    PlacedBody {
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

/// Adds a facing pair at each y offset of each tamped sleeper.
fn add_tine_rows(tines: &TineRows, report: &mut DiagnosticReport, layout: &mut Layout) {
    let tamped: Vec<SleeperPlan> =
        layout.sleepers.iter().filter(|s| s.plan.tamped).map(|s| s.plan.clone()).collect();
    // An error in `[sleepers]` has been reported already.
    if tamped.is_empty() && report.is_clean(&["sleepers"]) {
        let key = if report.document.has("sleepers.tamped") { "sleepers.tamped" } else { "tines" };
        let text = DiagnosticText {
            problem: "rows of tines need a tamped sleeper".into(),
            found: "no sleeper is tamped".into(),
            expected: "`tamped = [1]` in `[sleepers]`, or `tamped = true` in a `[[sleeper]]`"
                .into(),
            hint: None,
        };
        report.error(key, text);
    }
    let sizes = [tines.blade_size_m, tines.shaft_size_m];
    let shape = tine_shape(sizes, &tines.parts, "tines", report);
    let mount = mount::tine_mount(&tines.mount, &shape, "tines.mount", report);
    let mut pair = 0;
    for sleeper in &tamped {
        for (i, offset) in tines.y_offsets_m.iter().enumerate() {
            let key_y = format!("tines.y_offsets_m[{i}]");
            let Some(half) = half_length(sleeper, *offset) else {
                outside_block(report, &key_y, sleeper, *offset);
                continue;
            };
            let distance = half + tines.gap_to_sleeper_m + shape.blade_bounds().high.x;
            // The tine at the larger x squeezes towards -x.
            for (side, direction) in [("plus", 1.0), ("minus", -1.0)] {
                let x = sleeper.centre[0] - direction * distance;
                layout.tines.push(PlacedBody {
                    plan: TinePlan {
                        name: format!("tine_{}_{side}", pair + 1),
                        position: [x, sleeper.centre[1] + offset],
                        direction,
                        pair,
                        shape: shape.clone(),
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

/// Returns half the length along x of the block that a tine at this offset faces, m.
fn half_length(sleeper: &SleeperPlan, offset: f64) -> Option<f64> {
    let faced = sleeper.blocks.iter().filter(|b| (offset - b.offset_y).abs() <= 0.5 * b.size.y);
    faced.map(|b| 0.5 * b.size.x).reduce(f64::max)
}

fn outside_block(report: &mut DiagnosticReport, key: &str, sleeper: &SleeperPlan, offset: f64) {
    let ranges: Vec<String> = sleeper
        .blocks
        .iter()
        .map(|b| {
            format!("{:.3} to {:.3}", b.offset_y - 0.5 * b.size.y, b.offset_y + 0.5 * b.size.y)
        })
        .collect();
    let text = DiagnosticText {
        problem: format!("a tine next to `{}` faces none of its blocks", sleeper.name),
        found: format!("{offset} m"),
        expected: format!("an offset within a block: {} m", ranges.join(", ")),
        hint: None,
    };
    report.error(key, text);
}

fn single_tine(
    i: usize,
    tine: &TineSection,
    report: &mut DiagnosticReport,
) -> PlacedBody<TinePlan> {
    let sizes = [tine.blade_size_m, tine.shaft_size_m];
    let shape = tine_shape(sizes, &tine.parts, &format!("tine[{i}]"), report);
    let mount = mount::tine_mount(&tine.mount, &shape, &format!("tine[{i}].mount"), report);
    PlacedBody {
        plan: TinePlan {
            name: tine.name.clone(),
            position: [tine.x_m, tine.y_m],
            direction: match tine.squeeze_direction {
                SqueezeDirection::PlusX => 1.0,
                SqueezeDirection::MinusX => -1.0,
            },
            pair: tine.pair,
            shape,
            mount,
        },
        key: format!("tine[{i}]"),
        key_x: format!("tine[{i}].x_m"),
        key_y: format!("tine[{i}].y_m"),
    }
}
