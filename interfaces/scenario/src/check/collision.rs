//! Sleepers and tines stand in the box and do not run into each other, seen from above.

use crate::layout::{Layout, Placed};
use crate::report::{Finding, Report};
use ballast::track::plan::{SleeperPlan, TampingPlan, TinePlan};
use ballast::track::{ROUNDING_TOLERANCE, SweptArea, swept_area};
use std::collections::BTreeSet;

/// A rectangle in plan view: lower and upper corner, m.
#[derive(Clone, Copy)]
struct Area {
    low: [f64; 2],
    high: [f64; 2],
}

impl Area {
    fn around(centre: [f64; 2], size_x: f64, size_y: f64) -> Self {
        let half = [0.5 * size_x, 0.5 * size_y];
        Self {
            low: [centre[0] - half[0], centre[1] - half[1]],
            high: [centre[0] + half[0], centre[1] + half[1]],
        }
    }

    /// Whether the areas overlap, or come closer than `margin`.
    fn overlaps(&self, other: &Area, margin: f64) -> bool {
        (0..2).all(|i| self.low[i] < other.high[i] + margin && other.low[i] < self.high[i] + margin)
    }

    /// The axis, 0 or 1, along which this area leaves the box.
    fn leaves(&self, size: [f64; 2]) -> Option<usize> {
        (0..2).find(|&i| {
            self.low[i] < -ROUNDING_TOLERANCE || self.high[i] > size[i] + ROUNDING_TOLERANCE
        })
    }
}

fn blocks(sleeper: &SleeperPlan) -> impl Iterator<Item = Area> {
    let [x, y] = sleeper.centre;
    sleeper.blocks.iter().map(move |b| Area::around([x, y + b.offset_y], b.size.x, b.size.y))
}

/// What blade and shaft sweep while the tine swings by `amplitude` and closes by `stroke`, m.
fn tine_area(tine: &TinePlan, stroke: f64, amplitude: f64) -> Area {
    let SweptArea { x, y } = swept_area(tine, stroke, amplitude);
    Area { low: [x[0], y[0]], high: [x[1], y[1]] }
}

/// Checks all pairs of sleepers and tines, and each of them with the box of size `size`.
pub fn collisions(
    layout: &Layout,
    size: [f64; 2],
    tamping: Option<&TampingPlan>,
    report: &mut Report,
) {
    let mut told = BTreeSet::new();
    sleepers(layout, size, report, &mut told);
    let stroke = tamping.map_or(0.0, |t| t.squeeze.stroke);
    let amplitude = tamping.map_or(0.0, |t| t.vibration.amplitude);
    for (i, tine) in layout.tines.iter().enumerate() {
        if !in_box(tine, size, stroke, amplitude, report, &mut told) {
            continue;
        }
        for sleeper in &layout.sleepers {
            tine_and_sleeper(tine, sleeper, stroke, amplitude, report, &mut told);
        }
        for other in &layout.tines[..i] {
            tine_and_tine(tine, other, stroke, amplitude, report, &mut told);
        }
    }
}

fn sleepers(layout: &Layout, size: [f64; 2], report: &mut Report, told: &mut BTreeSet<String>) {
    for (i, sleeper) in layout.sleepers.iter().enumerate() {
        let name = &sleeper.plan.name;
        let areas: Vec<Area> = blocks(&sleeper.plan).collect();
        if let Some(axis) = areas.iter().find_map(|a| a.leaves(size)) {
            let key = [&sleeper.key_x, &sleeper.key_y][axis];
            let centre = sleeper.plan.centre[axis];
            tell(report, told, key, || Finding {
                problem: format!("`{name}` stands outside the box"),
                found: format!("its centre at {} = {centre:.4} m", ["x", "y"][axis]),
                expected: format!("all of its blocks between 0 and {} m", size[axis]),
                hint: None,
            });
        }
        let inside = (1..areas.len())
            .any(|j| areas[..j].iter().any(|a| a.overlaps(&areas[j], -ROUNDING_TOLERANCE)));
        if inside {
            tell(report, told, &format!("{}.blocks", sleeper.key), || Finding {
                problem: format!("blocks of `{name}` overlap"),
                found: "two blocks in the same place".into(),
                expected: "different `offset_y_m`, at least a block's width apart".into(),
                hint: None,
            });
        }
        for other in &layout.sleepers[..i] {
            if blocks(&other.plan).any(|a| areas.iter().any(|b| a.overlaps(b, -ROUNDING_TOLERANCE)))
            {
                let both = sleeper.key == "sleepers" && other.key == "sleepers";
                let key = if both { "sleepers.pitch_m" } else { &sleeper.key_x };
                let distance = (sleeper.plan.centre[0] - other.plan.centre[0]).abs();
                tell(report, told, key, || Finding {
                    problem: format!("`{name}` overlaps `{}`", other.plan.name),
                    found: format!("centres {distance:.4} m apart"),
                    expected: "more than a block's length between sleepers".into(),
                    hint: None,
                });
            }
        }
    }
}

fn in_box(
    tine: &Placed<TinePlan>,
    size: [f64; 2],
    stroke: f64,
    amplitude: f64,
    report: &mut Report,
    told: &mut BTreeSet<String>,
) -> bool {
    let plan = &tine.plan;
    // What takes it out of the box is what it was still inside without.
    let at_rest = (tine_area(plan, 0.0, 0.0), "at rest");
    let swinging = (tine_area(plan, 0.0, amplitude), "with its vibration");
    let closing = (tine_area(plan, stroke, amplitude), "with vibration and squeeze");
    let keys = [None, Some("tamping.vibration.amplitude_m"), Some("tamping.squeeze.stroke_m")];
    let outside = [at_rest, swinging, closing]
        .into_iter()
        .zip(keys)
        .find_map(|((area, how), key)| Some((area.leaves(size)?, area, how, key)));
    let Some((axis, area, how, key)) = outside else { return true };
    let (name, along) = (&plan.name, ["x", "y"][axis]);
    tell(report, told, key.unwrap_or([&tine.key_x, &tine.key_y][axis]), || Finding {
        problem: format!("`{name}` leaves the box"),
        found: format!(
            "{how} it is between {along} = {:.4} and {:.4} m",
            area.low[axis], area.high[axis]
        ),
        expected: format!("all of it between 0 and {} m", size[axis]),
        hint: None,
    });
    false
}

fn tine_and_sleeper(
    tine: &Placed<TinePlan>,
    sleeper: &Placed<SleeperPlan>,
    stroke: f64,
    amplitude: f64,
    report: &mut Report,
    told: &mut BTreeSet<String>,
) {
    // Tools need more than no room: touching counts.
    let hits =
        |area: Area| blocks(&sleeper.plan).any(|block| area.overlaps(&block, ROUNDING_TOLERANCE));
    let (name, other) = (&tine.plan.name, &sleeper.plan.name);
    // What drives it into the block is what it was still clear without.
    if hits(tine_area(&tine.plan, 0.0, 0.0)) {
        tell(report, told, &tine.key_x, || Finding {
            problem: format!("`{name}` goes down into `{other}`"),
            found: format!("its middle at x = {:.4} m", tine.plan.position[0]),
            expected: format!(
                "blade, shaft and vibration ({:.3} m to each side) clear of the blocks",
                0.5 * tine.plan.blade.x.max(tine.plan.shaft.x) + amplitude
            ),
            hint: Some("their sizes, `amplitude_m` and where the blocks are decide it, too".into()),
        });
    } else if hits(tine_area(&tine.plan, 0.0, amplitude)) {
        tell(report, told, "tamping.vibration.amplitude_m", || Finding {
            problem: format!("its vibration drives `{name}` into `{other}`"),
            found: format!("an amplitude of {amplitude} m"),
            expected: format!("less than {:.4} m", clearance(&tine.plan, &sleeper.plan, 0.0)),
            hint: Some("or tines farther away from the blocks".into()),
        });
    } else if hits(tine_area(&tine.plan, stroke, amplitude)) {
        tell(report, told, "tamping.squeeze.stroke_m", || Finding {
            problem: format!("the squeeze drives `{name}` into `{other}`"),
            found: format!("a stroke of {stroke} m"),
            expected: format!("less than {:.4} m", clearance(&tine.plan, &sleeper.plan, amplitude)),
            hint: None,
        });
    }
}

/// How far the tine can close before it touches the sleeper, m.
fn clearance(tine: &TinePlan, sleeper: &SleeperPlan, amplitude: f64) -> f64 {
    let area = tine_area(tine, 0.0, amplitude);
    let mut clear = f64::INFINITY;
    for block in blocks(sleeper) {
        if area.low[1] < block.high[1] + ROUNDING_TOLERANCE
            && block.low[1] < area.high[1] + ROUNDING_TOLERANCE
        {
            let gap = match tine.direction > 0.0 {
                true => block.low[0] - area.high[0],
                false => area.low[0] - block.high[0],
            };
            clear = if gap >= 0.0 { clear.min(gap) } else { clear };
        }
    }
    clear
}

fn tine_and_tine(
    tine: &Placed<TinePlan>,
    other: &Placed<TinePlan>,
    stroke: f64,
    amplitude: f64,
    report: &mut Report,
    told: &mut BTreeSet<String>,
) {
    let (a, b) = (&tine.plan, &other.plan);
    let begin = [a, b].map(|t| tine_area(t, 0.0, amplitude));
    if begin[0].overlaps(&begin[1], -ROUNDING_TOLERANCE) {
        tell(report, told, &tine.key_y, || Finding {
            problem: format!("`{}` and `{}` overlap at the start", a.name, b.name),
            found: format!("middles {:.4?} and {:.4?} m", a.position, b.position),
            expected: "tines that are a blade apart".into(),
            hint: None,
        });
        return;
    }
    // Those of one direction keep their distance; of the others only those that close on each other sweep the same
    // place.
    let way = [a, b].map(|t| tine_area(t, stroke, amplitude));
    if a.direction != b.direction && way[0].overlaps(&way[1], -ROUNDING_TOLERANCE) {
        let gap = (begin[0].low[0] - begin[1].high[0]).max(begin[1].low[0] - begin[0].high[0]);
        tell(report, told, &tine.key_x, || Finding {
            problem: format!("the squeeze drives `{}` and `{}` into each other", a.name, b.name),
            found: format!("a gap of {gap:.4} m, closed by {stroke} m from each side"),
            expected: format!("a gap of at least {:.4} m, or a shorter stroke", 2.0 * stroke),
            hint: None,
        });
    }
}

/// One error for each key: a row of bodies with one wrong number needs one message.
fn tell(
    report: &mut Report,
    told: &mut BTreeSet<String>,
    key: &str,
    finding: impl FnOnce() -> Finding,
) {
    if told.insert(key.to_string()) {
        report.error(key, finding());
    }
}
