//! Checks of plates: their place, motions and loads.

use super::machine::{MIN_STEPS_PER_SINE, TravelLimit};
use crate::diagnostic::DiagnosticText;
use crate::layout::Layout;
use crate::placed_body::PlacedBody;
use crate::report::DiagnosticReport;
use ballast::geometry::AxisBox;
use ballast::math::Vec3;
use ballast::model::DofMode;
use ballast::track::plan::{BedPlan, PlatePlan, RunPlan, TampingPlan, VectorKnot};
use ballast::track::{ROUNDING_TOLERANCE, plate_boxes, swept_area};

const AXES: [&str; 3] = ["x", "y", "z"];

/// Checks all plates against bed, other bodies and time stepping.
pub fn plates(
    tamping: Option<&TampingPlan>,
    bed: &BedPlan,
    layout: &Layout,
    run: &RunPlan,
    report: &mut DiagnosticReport,
) {
    if !report.is_clean(&["plate", "bed", "run"]) {
        return;
    }
    for plate in &layout.plates {
        place(plate, bed, report);
        let PlacedBody { plan, key, .. } = plate;
        knots(&plan.motion, &format!("{key}.motion"), run, report);
        knots(&plan.load, &format!("{key}.load"), run, report);
        starts_at_rest(plan, key, report);
        modes(plan, key, report);
    }
    if !report.is_clean(&["plate"]) {
        return;
    }
    for plate in &layout.plates {
        step_resolves(plate, bed, run, report);
    }
    let obstacles = obstacles(tamping, bed, layout);
    for (i, plate) in layout.plates.iter().enumerate() {
        for (name, region) in &obstacles {
            meets_box(plate, name, region, report);
        }
        for other in &layout.plates[..i] {
            meets_plate(plate, &other.plan, report);
        }
    }
}

/// Refuses a plate beside the bed, and one in the preparation that cannot stand there.
fn place(plate: &PlacedBody<PlatePlan>, bed: &BedPlan, report: &mut DiagnosticReport) {
    let PlacedBody { plan, key, key_x, key_y } = plate;
    let at = Vec3::new(plan.position[0], plan.position[1], plan.z.unwrap_or(0.0));
    let is_beside = |k: usize| {
        plate_boxes(plan, at).all(|part| part.high[k] <= 0.0 || part.low[k] >= bed.size[k])
    };
    if let Some(k) = (0..2).find(|k| is_beside(*k)) {
        let text = DiagnosticText {
            problem: format!("`{}` stands outside the box", plan.name),
            found: format!("its reference point at {} = {} m", AXES[k], plan.position[k]),
            expected: format!("a box of it between 0 and {} m", bed.size[k]),
            hint: None,
        };
        report.error([key_x, key_y][k], text);
    }
    if !plan.in_preparation {
        return;
    }
    if plan.z.is_none() {
        let text = DiagnosticText {
            problem: "missing key `z_m`".into(),
            found: "a plate that stands in the bed while it is prepared".into(),
            expected: "`z_m`: a number — height of its reference point, m".into(),
            hint: Some("only a plate of the run can be lowered onto the grains".into()),
        };
        report.error(&format!("{key}.in_preparation"), text);
    }
    if bed.traffic.is_some() {
        let text = DiagnosticText {
            problem: format!("`bed.traffic` moves the bed along `{}`", plan.name),
            found: "traffic over a bed in which a plate stands".into(),
            expected: "no `bed.traffic`, or a plate without `in_preparation`".into(),
            hint: None,
        };
        report.error(&format!("{key}.in_preparation"), text);
    }
}

/// Refuses entries of the list at `key` that are not in order of time; warns of those after the run.
fn knots(knots: &[VectorKnot], key: &str, run: &RunPlan, report: &mut DiagnosticReport) {
    let seconds = |ns: u64| ns as f64 / 1e9;
    for (i, pair) in knots.windows(2).enumerate() {
        if pair[0].time_ns >= pair[1].time_ns {
            let text = DiagnosticText {
                problem: "entries are not in order of time".into(),
                found: format!(
                    "{} s after {} s",
                    seconds(pair[1].time_ns),
                    seconds(pair[0].time_ns)
                ),
                expected: format!("more than {} s", seconds(pair[0].time_ns)),
                hint: None,
            };
            report.error(&format!("{key}[{}].time_s", i + 1), text);
            return;
        }
    }
    if let Some(i) = knots.iter().position(|knot| knot.time_ns > run.duration_ns) {
        let text = DiagnosticText {
            problem: "the run ends before this time".into(),
            found: format!("{} s", seconds(knots[i].time_ns)),
            expected: format!("at most `run.duration_s`, {} s", seconds(run.duration_ns)),
            hint: None,
        };
        report.warn(&format!("{key}[{i}].time_s"), text);
    }
}

/// Refuses a motion that begins with a jump.
fn starts_at_rest(plan: &PlatePlan, key: &str, report: &mut DiagnosticReport) {
    let Some(first) = plan.motion.first() else { return };
    if first.time_ns == 0 && first.value != Vec3::zeros() {
        let text = DiagnosticText {
            problem: format!("the motion of `{}` begins with a jump", plan.name),
            found: format!("{:?} m at 0 s", first.value.as_slice()),
            expected: "`displacement_m = [0, 0, 0]` at 0 s, or a later time".into(),
            hint: Some("displacements count from where the plate starts".into()),
        };
        report.error(&format!("{key}.motion[0].displacement_m"), text);
    }
}

/// Refuses loads that the mount does not let act, and motions that do not move the plate.
fn modes(plan: &PlatePlan, key: &str, report: &mut DiagnosticReport) {
    let mode = |k: usize| plan.mount.map_or(DofMode::Prescribed, |mount| mount.dof_modes[k]);
    let axis_of = |knots: &[VectorKnot], refuses: fn(DofMode) -> bool| {
        (0..3).find(|&k| refuses(mode(k)) && knots.iter().any(|knot| knot.value[k] != 0.0))
    };
    if let Some(k) = axis_of(&plan.load, DofMode::is_prescribed) {
        let axis = AXES[k];
        let text = DiagnosticText {
            problem: format!("no load moves `{}` along {axis}", plan.name),
            found: match plan.mount {
                None => "a plate without a mount".into(),
                Some(_) => format!("`{axis} = \"prescribed\"` in its mount"),
            },
            expected: format!("a table `mount` with `{axis} = \"free\"` or `\"spring\"`"),
            hint: None,
        };
        report.error(&format!("{key}.load"), text);
    }
    let swing = plan.vibration.map(|v| VectorKnot { time_ns: 0, value: v.amplitude });
    let moves = [("motion", &plan.motion[..]), ("vibration", swing.as_slice())];
    for (name, knots) in moves {
        if let Some(k) = axis_of(knots, |mode| mode == DofMode::Free) {
            let axis = AXES[k];
            let text = DiagnosticText {
                problem: format!("`{name}` cannot move `{}` along {axis}", plan.name),
                found: format!("`{axis} = \"free\"` in its mount"),
                expected: format!("`{axis} = \"prescribed\"` or `\"spring\"`, or a `load`"),
                hint: None,
            };
            report.error(&format!("{key}.{name}"), text);
        }
    }
}

/// Refuses motions that jump over grains in a step, and vibrations that steps do not resolve.
fn step_resolves(
    plate: &PlacedBody<PlatePlan>,
    bed: &BedPlan,
    run: &RunPlan,
    report: &mut DiagnosticReport,
) {
    let PlacedBody { plan, key, .. } = plate;
    let h = run.stepping.h();
    if let Some(v) = &plan.vibration {
        let key = format!("{key}.vibration");
        let periods = (v.end - v.start) * v.frequency;
        if !(periods >= 1.0) {
            let text = DiagnosticText {
                problem: format!("the vibration of `{}` is shorter than its period", plan.name),
                found: format!("{} to {} s at {} Hz", v.start, v.end, v.frequency),
                expected: "a whole period or more, within the run".into(),
                hint: None,
            };
            report.error(&key, text);
            return;
        }
        let steps = 1.0 / (v.frequency * h);
        if !(steps >= MIN_STEPS_PER_SINE) {
            let text = DiagnosticText {
                problem: "the time step is too large for the vibration".into(),
                found: format!("{steps:.1} steps per period"),
                expected: format!("at least {MIN_STEPS_PER_SINE}"),
                hint: None,
            };
            report.error(&format!("{key}.frequency_Hz"), text);
            return;
        }
    }
    let speed = plan.max_displacement(run.stepping.step_ns) / h;
    let vibration = plan.vibration.map_or(0.0, |v| v.amplitude.norm());
    let limit = TravelLimit { h, smallest: bed.grains.min_size() };
    if let Some(text) = limit.excess(speed, vibration) {
        let name = if plan.motion.is_empty() { "vibration" } else { "motion" };
        report.error(&format!("{key}.{name}"), text);
    }
}

/// Returns the boxes in which sleepers stand and tines move, with their names.
fn obstacles(
    tamping: Option<&TampingPlan>,
    bed: &BedPlan,
    layout: &Layout,
) -> Vec<(String, AxisBox)> {
    let depth = bed.preparation.ballast_depth;
    let mut obstacles = Vec::new();
    for sleeper in &layout.sleepers {
        let lift = tamping.filter(|_| sleeper.plan.tamped).map_or(0.0, |t| t.lift.height);
        for block in &sleeper.plan.blocks {
            let [x, y] = sleeper.plan.centre;
            let (half, y) = (block.size * 0.5, y + block.offset_y);
            let low = Vec3::new(x - half.x, y - half.y, depth);
            let high = Vec3::new(x + half.x, y + half.y, depth + block.size.z + lift);
            obstacles.push((sleeper.plan.name.clone(), AxisBox { low, high }));
        }
    }
    // Without a cycle the start of the run shows whether a plate stands in a tine.
    for (tine, tamping) in layout.tines.iter().flat_map(|t| Some((&t.plan, tamping?))) {
        let area = swept_area(tine, tamping.squeeze.stroke, tamping.vibration.amplitude);
        let bounds = tine.bounds();
        let deep = tamping.deep_edge(bed) + bounds.low.z;
        let start = bed.preparation.fill_level + tamping.insertion.clearance;
        let low = Vec3::new(area.x[0], area.y[0], deep.min(start));
        let high = start.max(deep) + bounds.high.z - bounds.low.z;
        let high = Vec3::new(area.x[1], area.y[1], high);
        obstacles.push((tine.name.clone(), AxisBox { low, high }));
    }
    obstacles
}

/// Refuses a plate that starts in a standing box or moves into it.
fn meets_box(
    plate: &PlacedBody<PlatePlan>,
    other: &str,
    region: &AxisBox,
    report: &mut DiagnosticReport,
) {
    let Some(start) = start(&plate.plan) else { return };
    let boxes = boxes_with_swing(&plate.plan, start);
    let hits = |from: Vec3, to: Vec3| boxes.iter().any(|part| meets_moving(part, region, from, to));
    report_meeting(plate, other, &times(&[&plate.plan]), |t| plate.plan.motion_at(t), hits, report);
}

/// Refuses a plate that starts in another one, or that meets it on their ways. How far weight, loads and grains move a plate on
/// a mount is not known here.
fn meets_plate(plate: &PlacedBody<PlatePlan>, other: &PlatePlan, report: &mut DiagnosticReport) {
    let (Some(at), Some(other_at)) = (start(&plate.plan), start(other)) else { return };
    let boxes = boxes_with_swing(&plate.plan, at);
    let others = boxes_with_swing(other, other_at);
    let hits = |from: Vec3, to: Vec3| {
        boxes.iter().any(|a| others.iter().any(|b| meets_moving(a, b, from, to)))
    };
    let relative = |t: u64| plate.plan.motion_at(t) - other.motion_at(t);
    report_meeting(plate, &other.name, &times(&[&plate.plan, other]), relative, hits, report);
}

/// Reports the first meeting of a plate with another body from one of the `times` to the next.
fn report_meeting(
    plate: &PlacedBody<PlatePlan>,
    other: &str,
    times: &[u64],
    displacement: impl Fn(u64) -> Vec3,
    hits: impl Fn(Vec3, Vec3) -> bool,
    report: &mut DiagnosticReport,
) {
    let name = &plate.plan.name;
    if hits(Vec3::zeros(), Vec3::zeros()) {
        let text = DiagnosticText {
            problem: format!("`{name}` overlaps `{other}` at the start"),
            found: "boxes in the same place, the vibration included".into(),
            expected: "bodies beside each other: they have no contacts with each other".into(),
            hint: None,
        };
        report.error(&plate.key_x, text);
        return;
    }
    let moving = times.windows(2).find(|t| hits(displacement(t[0]), displacement(t[1])));
    if let Some(pair) = moving {
        let seconds = pair[1] as f64 / 1e9;
        let text = DiagnosticText {
            problem: format!("`{name}` and `{other}` move into each other"),
            found: format!("an overlap before {seconds} s"),
            expected: "motions clear of each other: plates have contacts with grains only".into(),
            hint: None,
        };
        let moves = !plate.plan.motion.is_empty();
        report.error(&format!("{}.{}", plate.key, if moves { "motion" } else { "x_m" }), text);
    }
}

/// Returns the reference point at the start, m; `None` if only the prepared bed shows its height.
fn start(plan: &PlatePlan) -> Option<Vec3> {
    Some(Vec3::new(plan.position[0], plan.position[1], plan.z?))
}

/// Returns the boxes of a plate with the reach of its vibration.
fn boxes_with_swing(plan: &PlatePlan, at: Vec3) -> Vec<AxisBox> {
    let swing = plan.vibration.map_or(Vec3::zeros(), |v| v.amplitude.abs());
    plate_boxes(plan, at).map(|b| AxisBox { low: b.low - swing, high: b.high + swing }).collect()
}

/// Returns the times between which the displacements of plates are linear, from the start of the run.
fn times(plans: &[&PlatePlan]) -> Vec<u64> {
    let knots = plans.iter().flat_map(|plan| &plan.motion).map(|knot| knot.time_ns);
    let mut times: Vec<u64> = std::iter::once(0).chain(knots).collect();
    times.sort_unstable();
    times.dedup();
    times
}

/// True if box `a` overlaps box `b` somewhere on its straight way between two displacements.
fn meets_moving(a: &AxisBox, b: &AxisBox, from: Vec3, to: Vec3) -> bool {
    let (mut first, mut last) = (0.0f64, 1.0f64);
    for k in 0..3 {
        // Displacements of `a` between which it overlaps `b` along this axis.
        let low = b.low[k] - a.high[k] + ROUNDING_TOLERANCE;
        let high = b.high[k] - a.low[k] - ROUNDING_TOLERANCE;
        let way = to[k] - from[k];
        if way == 0.0 {
            if !(low < from[k] && from[k] < high) {
                return false;
            }
            continue;
        }
        let [enters, leaves] = [(low - from[k]) / way, (high - from[k]) / way];
        first = first.max(enters.min(leaves));
        last = last.min(enters.max(leaves));
    }
    first < last || (first == last && from == to)
}
