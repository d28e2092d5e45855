//! Collisions of sleepers and tines with each other and with the box, in plan view.

use crate::diagnostic::DiagnosticText;
use crate::layout::Layout;
use crate::placed_body::PlacedBody;
use crate::report::DiagnosticReport;
use ballast::geometry::AxisBox;
use ballast::track::plan::{SleeperPlan, TampingPlan, TinePlan};
use ballast::track::{ROUNDING_TOLERANCE, SweptArea, swept_area};
use std::collections::BTreeSet;

/// Rectangle in plan view: lower and upper corner, m.
#[derive(Clone, Copy)]
struct PlanRectangle {
    low: [f64; 2],
    high: [f64; 2],
}

impl PlanRectangle {
    fn around(centre: [f64; 2], size_x: f64, size_y: f64) -> Self {
        let half = [0.5 * size_x, 0.5 * size_y];
        Self {
            low: [centre[0] - half[0], centre[1] - half[1]],
            high: [centre[0] + half[0], centre[1] + half[1]],
        }
    }

    /// True if the rectangles overlap, or come closer than `margin`.
    fn overlaps(&self, other: &PlanRectangle, margin: f64) -> bool {
        (0..2).all(|i| self.low[i] < other.high[i] + margin && other.low[i] < self.high[i] + margin)
    }

    /// Returns the axis, 0 or 1, along which the rectangle leaves the box.
    fn axis_outside(&self, size: [f64; 2]) -> Option<usize> {
        (0..2).find(|&i| {
            self.low[i] < -ROUNDING_TOLERANCE || self.high[i] > size[i] + ROUNDING_TOLERANCE
        })
    }
}

fn blocks(sleeper: &SleeperPlan) -> impl Iterator<Item = PlanRectangle> {
    let [x, y] = sleeper.centre;
    sleeper
        .blocks
        .iter()
        .map(move |b| PlanRectangle::around([x, y + b.offset_y], b.size.x, b.size.y))
}

/// Returns the area that blade and shaft sweep while the tine vibrates by `amplitude` and closes by `stroke`, m.
fn tine_area(tine: &TinePlan, stroke: f64, amplitude: f64) -> PlanRectangle {
    let SweptArea { x, y } = swept_area(tine, stroke, amplitude);
    PlanRectangle { low: [x[0], y[0]], high: [x[1], y[1]] }
}

/// Checks all pairs of sleepers and tines, and each of them with the box of size `size`.
pub fn collisions(
    layout: &Layout,
    size: [f64; 2],
    tamping: Option<&TampingPlan>,
    report: &mut DiagnosticReport,
) {
    let mut reported = BTreeSet::new();
    sleepers(layout, size, report, &mut reported);
    let stroke = tamping.map_or(0.0, |t| t.squeeze.stroke);
    let amplitude = tamping.map_or(0.0, |t| t.vibration.amplitude);
    for (i, tine) in layout.tines.iter().enumerate() {
        if !in_box(tine, size, stroke, amplitude, report, &mut reported) {
            continue;
        }
        for sleeper in &layout.sleepers {
            tine_and_sleeper(tine, sleeper, stroke, amplitude, report, &mut reported);
        }
        for other in &layout.tines[..i] {
            tine_and_tine(tine, other, stroke, amplitude, report, &mut reported);
        }
    }
}

fn sleepers(
    layout: &Layout,
    size: [f64; 2],
    report: &mut DiagnosticReport,
    reported: &mut BTreeSet<String>,
) {
    for (i, sleeper) in layout.sleepers.iter().enumerate() {
        let name = &sleeper.plan.name;
        let areas: Vec<PlanRectangle> = blocks(&sleeper.plan).collect();
        if let Some(axis) = areas.iter().find_map(|a| a.axis_outside(size)) {
            let key = [&sleeper.key_x, &sleeper.key_y][axis];
            let centre = sleeper.plan.centre[axis];
            report_once(report, reported, key, || DiagnosticText {
                problem: format!("`{name}` stands outside the box"),
                found: format!("its centre at {} = {centre:.4} m", ["x", "y"][axis]),
                expected: format!("all of its blocks between 0 and {} m", size[axis]),
                hint: None,
            });
        }
        let inside = (1..areas.len())
            .any(|j| areas[..j].iter().any(|a| a.overlaps(&areas[j], -ROUNDING_TOLERANCE)));
        if inside {
            report_once(report, reported, &format!("{}.blocks", sleeper.key), || DiagnosticText {
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
                report_once(report, reported, key, || DiagnosticText {
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
    tine: &PlacedBody<TinePlan>,
    size: [f64; 2],
    stroke: f64,
    amplitude: f64,
    report: &mut DiagnosticReport,
    reported: &mut BTreeSet<String>,
) -> bool {
    let plan = &tine.plan;
    // The first motion that leaves the box is the cause.
    let at_rest = (tine_area(plan, 0.0, 0.0), "at rest");
    let swinging = (tine_area(plan, 0.0, amplitude), "with its vibration");
    let closing = (tine_area(plan, stroke, amplitude), "with vibration and squeeze");
    let keys = [None, Some("tamping.vibration.amplitude_m"), Some("tamping.squeeze.stroke_m")];
    let outside = [at_rest, swinging, closing]
        .into_iter()
        .zip(keys)
        .find_map(|((area, how), key)| Some((area.axis_outside(size)?, area, how, key)));
    let Some((axis, area, how, key)) = outside else { return true };
    let name = &plan.name;
    let along = ["x", "y"][axis];
    report_once(report, reported, key.unwrap_or([&tine.key_x, &tine.key_y][axis]), || {
        DiagnosticText {
            problem: format!("`{name}` leaves the box"),
            found: format!(
                "{how} it is between {along} = {:.4} and {:.4} m",
                area.low[axis], area.high[axis]
            ),
            expected: format!("all of it between 0 and {} m", size[axis]),
            hint: None,
        }
    });
    false
}

fn tine_and_sleeper(
    tine: &PlacedBody<TinePlan>,
    sleeper: &PlacedBody<SleeperPlan>,
    stroke: f64,
    amplitude: f64,
    report: &mut DiagnosticReport,
    reported: &mut BTreeSet<String>,
) {
    // Touching counts as a hit.
    let hits = |area: PlanRectangle| {
        blocks(&sleeper.plan).any(|block| area.overlaps(&block, ROUNDING_TOLERANCE))
    };
    let (name, other) = (&tine.plan.name, &sleeper.plan.name);
    // The first motion that hits the block is the cause.
    if hits(tine_area(&tine.plan, 0.0, 0.0)) {
        let AxisBox { low, high } = tine.plan.bounds();
        report_once(report, reported, &tine.key_x, || DiagnosticText {
            problem: format!("`{name}` is inserted into `{other}`"),
            found: format!("its middle at x = {:.4} m", tine.plan.position[0]),
            expected: format!(
                "blade, shaft and vibration ({:.3} m to each side) clear of the blocks",
                high.x.max(-low.x) + amplitude
            ),
            hint: Some("sizes, positions and `amplitude_m` matter, too".into()),
        });
    } else if hits(tine_area(&tine.plan, 0.0, amplitude)) {
        report_once(report, reported, "tamping.vibration.amplitude_m", || DiagnosticText {
            problem: format!("its vibration drives `{name}` into `{other}`"),
            found: format!("an amplitude of {amplitude} m"),
            expected: format!("less than {:.4} m", clearance(&tine.plan, &sleeper.plan, 0.0)),
            hint: Some("or tines farther away from the blocks".into()),
        });
    } else if hits(tine_area(&tine.plan, stroke, amplitude)) {
        report_once(report, reported, "tamping.squeeze.stroke_m", || DiagnosticText {
            problem: format!("the squeeze drives `{name}` into `{other}`"),
            found: format!("a stroke of {stroke} m"),
            expected: format!("less than {:.4} m", clearance(&tine.plan, &sleeper.plan, amplitude)),
            hint: None,
        });
    }
}

/// Returns the closing at which the tine touches the sleeper, m.
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
    tine: &PlacedBody<TinePlan>,
    other: &PlacedBody<TinePlan>,
    stroke: f64,
    amplitude: f64,
    report: &mut DiagnosticReport,
    reported: &mut BTreeSet<String>,
) {
    let (a, b) = (&tine.plan, &other.plan);
    let begin = [a, b].map(|t| tine_area(t, 0.0, amplitude));
    if begin[0].overlaps(&begin[1], -ROUNDING_TOLERANCE) {
        report_once(report, reported, &tine.key_y, || DiagnosticText {
            problem: format!("`{}` and `{}` overlap at the start", a.name, b.name),
            found: format!("middles {:.4?} and {:.4?} m", a.position, b.position),
            expected: "tines that are a blade apart".into(),
            hint: None,
        });
        return;
    }
    // Tines of one direction keep their distance. Of the others, only those that close on each other sweep the same area.
    let swept = [a, b].map(|t| tine_area(t, stroke, amplitude));
    if a.direction != b.direction && swept[0].overlaps(&swept[1], -ROUNDING_TOLERANCE) {
        let gap = (begin[0].low[0] - begin[1].high[0]).max(begin[1].low[0] - begin[0].high[0]);
        report_once(report, reported, &tine.key_x, || DiagnosticText {
            problem: format!("the squeeze drives `{}` and `{}` into each other", a.name, b.name),
            found: format!("a gap of {gap:.4} m, closed by {stroke} m from each side"),
            expected: format!("a gap of at least {:.4} m, or a shorter stroke", 2.0 * stroke),
            hint: None,
        });
    }
}

/// Adds an error unless its key has one: a row of bodies with one wrong number needs one message.
fn report_once(
    report: &mut DiagnosticReport,
    reported: &mut BTreeSet<String>,
    key: &str,
    text: impl FnOnce() -> DiagnosticText,
) {
    if reported.insert(key.to_string()) {
        report.error(key, text());
    }
}
