//! Checks of the tamping cycle against run, bed and time step.

use crate::diagnostic::DiagnosticText;
use crate::layout::Layout;
use crate::placed_body::PlacedBody;
use crate::report::DiagnosticReport;
use ballast::model::DofMode;
use ballast::track::motion_law::{SMOOTH_STEP_PEAK, TRAVEL_PEAK};
use ballast::track::plan::{BedPlan, LoadCycles, RunPlan, SleeperPlan, TampingPlan};
use ballast::track::{MAX_AVERAGING_STEPS, MAX_PROTRUSION, MIN_STEPS_PER_PERIOD};
use std::f64::consts::PI;

/// Minimum clearance at which no prepared bed has a grain in the way of a tine, in mean grain sizes. Grains are trimmed at
/// half a size, and may rise afterwards.
const MIN_CLEARANCE: f64 = 0.6;
/// Maximum speed of insertion that machines reach, m/s.
const MAX_INSERTION_SPEED: f64 = 1.0;
/// Minimum number of steps per period that resolve a sine.
pub(super) const MIN_STEPS_PER_SINE: f64 = 10.0;
// The core refuses only fewer steps, which would be another motion.
const _: () = assert!(MIN_STEPS_PER_SINE > MIN_STEPS_PER_PERIOD);

/// Keys that decide on the depth of the tines.
const DEPTH_KEYS: [&str; 2] = ["tamping.insertion.depth_m", "bed.sleeper_underside_z_m"];

/// Checks the cycle against bed, layout and time stepping.
pub fn machine(
    tamping: Option<&TampingPlan>,
    bed: &BedPlan,
    layout: &Layout,
    run: &RunPlan,
    report: &mut DiagnosticReport,
) {
    let Some(tamping) = tamping else {
        if !layout.tines.is_empty() {
            let key = layout.tines[0].key.clone();
            let text = DiagnosticText {
                problem: "the tines move only if a partner moves them".into(),
                found: "tines without `[tamping]`".into(),
                expected: "a table `[tamping]`, which may be empty, for a run without a partner"
                    .into(),
                hint: None,
            };
            report.warn(&key, text);
        }
        return;
    };
    if !layout.sleepers.iter().any(|s| s.plan.tamped) && layout.tines.is_empty() {
        let text = DiagnosticText {
            problem: "the tamping cycle moves nothing".into(),
            found: "neither tines nor a tamped sleeper".into(),
            expected: "`[tines]`, and a sleeper that is tamped".into(),
            hint: None,
        };
        report.warn("tamping", text);
    }
    cycle_fits(tamping, run, report);
    load_cycles(tamping, layout, report);
    if !report.is_clean(&["tamping", "bed", "run", "tines", "tine"]) {
        return;
    }
    above_floor(tamping, bed, layout, report);
    among_grains(tamping, bed, layout, report);
    above_grains(tamping, bed, layout, report);
    step_resolves(tamping, bed, layout, run, report);
}

fn cycle_fits(tamping: &TampingPlan, run: &RunPlan, report: &mut DiagnosticReport) {
    if !report.is_clean(&["tamping", "run"]) {
        return;
    }
    let duration = run.duration_ns as f64 * 1e-9;
    let withdrawal_start = tamping.start
        + tamping.lift.duration
        + tamping.insertion.duration
        + tamping.squeeze.duration
        + tamping.hold;
    let after = tamping.ends()[6] - tamping.ends()[4];
    if withdrawal_start + after >= duration {
        let text = DiagnosticText {
            problem: "the run ends before the tines are withdrawn".into(),
            found: format!("{duration} s"),
            expected: match after {
                0.0 => {
                    format!("more than {withdrawal_start:.4} s: lift, insertion, squeeze and hold")
                }
                _ => format!(
                    "more than {:.4} s: all phases beside the withdrawal",
                    withdrawal_start + after
                ),
            },
            hint: None,
        };
        report.error("run.duration_s", text);
    } else if withdrawal_start + tamping.withdrawal + after > duration * (1.0 + 1e-9) {
        let text = DiagnosticText {
            problem: match after {
                0.0 => "the run ends during the withdrawal".into(),
                _ => "the run ends before the cycle".into(),
            },
            found: format!("{} s", tamping.withdrawal),
            expected: format!("at most {:.4} s", duration - withdrawal_start - after),
            hint: None,
        };
        report.warn("tamping.withdrawal_s", text);
    }
}

/// Refuses load cycles whose smallest load is not below the largest; their section is at `key`.
pub fn load_range(load: &LoadCycles, key: &str, report: &mut DiagnosticReport) {
    if load.min_load < load.max_load {
        return;
    }
    let text = DiagnosticText {
        problem: "the smallest load is not below the largest".into(),
        found: format!("{} N", load.min_load),
        expected: format!("less than `max_load_N`, {} N", load.max_load),
        hint: None,
    };
    report.error(&format!("{key}.min_load_N"), text);
}

/// Checks the loads after the cycle, and that the sleepers can carry them.
fn load_cycles(tamping: &TampingPlan, layout: &Layout, report: &mut DiagnosticReport) {
    let Some(traffic) = &tamping.traffic else { return };
    load_range(traffic, "tamping.traffic", report);
    let is_prescribed = |s: &&PlacedBody<SleeperPlan>| {
        s.plan.tamped && s.plan.mount.is_none_or(|m| m.dof_modes[2] == DofMode::Prescribed)
    };
    if let Some(sleeper) = layout.sleepers.iter().find(is_prescribed) {
        let text = DiagnosticText {
            problem: format!("no load moves `{}`", sleeper.plan.name),
            found: "a tamped sleeper without a mount that is free or has a spring in z".into(),
            expected: "a table `mount` with `z = \"spring\"`".into(),
            hint: None,
        };
        report.error("tamping.traffic", text);
    }
}

fn above_floor(
    tamping: &TampingPlan,
    bed: &BedPlan,
    layout: &Layout,
    report: &mut DiagnosticReport,
) {
    let edge = tamping.deep_edge(bed);
    for tine in &layout.tines {
        let lowest = edge + tine.plan.bounds().low.z;
        if lowest <= 0.0 {
            let text = DiagnosticText {
                problem: format!("`{}` reaches the floor", tine.plan.name),
                found: format!("its lower edge at z = {lowest:.4} m"),
                expected: format!(
                    "an insertion depth below {:.4} m",
                    tamping.insertion.depth + lowest
                ),
                hint: None,
            };
            report.error(report.written_key(&DEPTH_KEYS), text);
            return;
        }
    }
}

/// Warns of tines that never reach the bed.
fn among_grains(
    tamping: &TampingPlan,
    bed: &BedPlan,
    layout: &Layout,
    report: &mut DiagnosticReport,
) {
    let edge = tamping.deep_edge(bed);
    let level = bed.preparation.fill_level;
    for tine in &layout.tines {
        let lowest = edge + tine.plan.bounds().low.z;
        if lowest >= level {
            let text = DiagnosticText {
                problem: format!("`{}` never reaches the bed", tine.plan.name),
                found: format!("its lower edge at z = {lowest:.4} m at full depth"),
                expected: format!("below the fill level, {level:.4} m"),
                hint: None,
            };
            report.warn(report.written_key(&DEPTH_KEYS), text);
            return;
        }
    }
}

/// Warns of tines that may start among grains. Only the prepared bed shows whether a grain sticks out under a blade; the run
/// is then refused.
fn above_grains(
    tamping: &TampingPlan,
    bed: &BedPlan,
    layout: &Layout,
    report: &mut DiagnosticReport,
) {
    let size = bed.grains.mean_size();
    let clearance = tamping.insertion.clearance;
    if clearance >= MIN_CLEARANCE * size || layout.tines.is_empty() {
        return;
    }
    let highest = MAX_PROTRUSION * size;
    let text = DiagnosticText {
        problem: "the tines may start among grains, and the run fail".into(),
        found: format!("a clearance of {clearance} m"),
        expected: format!(
            "at least {highest:.4} m, the height to which grains may stick out of the prepared bed"
        ),
        hint: Some("`tamping.insertion.clearance_m` lifts the tines before they begin".into()),
    };
    let keys = ["tamping.insertion.clearance_m", "bed.grains.classes"];
    report.warn(report.written_key(&keys), text);
}

/// Checks that a step resolves the motions: tools must not jump over grains, nor steps over the vibration.
fn step_resolves(
    tamping: &TampingPlan,
    bed: &BedPlan,
    layout: &Layout,
    run: &RunPlan,
    report: &mut DiagnosticReport,
) {
    let h = run.stepping.h();
    let smallest = bed.grains.min_size();
    let limit = TravelLimit { h, smallest };
    if layout.sleepers.iter().any(|s| s.plan.tamped) {
        let lift = SMOOTH_STEP_PEAK * tamping.lift.height / tamping.lift.duration;
        limit.check("tamping.lift.duration_s", lift, 0.0, report);
    }
    let steps = tamping.averaging() / h;
    if steps > MAX_AVERAGING_STEPS {
        let (key, slow, found) = match tamping.vibration.period() {
            Some(_) => ("vibration.frequency_Hz", "vibration", "per period"),
            None => ("squeeze.duration_s", "squeeze", "in a tenth of it"),
        };
        let text = DiagnosticText {
            problem: format!("the time step is too small for the {slow}"),
            found: format!("{steps:.0} steps {found}"),
            expected: format!(
                "at most {MAX_AVERAGING_STEPS}, over which the machine averages its forces"
            ),
            hint: None,
        };
        report.error(&format!("tamping.{key}"), text);
    }
    let Some(travel) = max_travel(tamping, bed, layout) else { return };
    // Mean speed over a step: the chord of a sine is flatter than its tangent.
    let angle = (PI * tamping.vibration.frequency * h).min(0.5 * PI);
    let swing = 2.0 * tamping.vibration.amplitude * angle.sin() / h;
    // A vibration that is too fast alone is reported once.
    let vibration = if limit.check("tamping.vibration", swing, 0.0, report) { swing } else { 0.0 };
    let insertion = TRAVEL_PEAK * travel / tamping.insertion.duration;
    let squeeze = TRAVEL_PEAK * tamping.squeeze.stroke / tamping.squeeze.duration;
    // The tines open in the first half of the withdrawal, while they rise.
    let opening = TRAVEL_PEAK * tamping.squeeze.stroke / (0.5 * tamping.withdrawal);
    let withdrawal = (opening + vibration).hypot(TRAVEL_PEAK * travel / tamping.withdrawal);
    let withdrawal_key = match report.document.has("tamping.withdrawal_s") {
        true => "tamping.withdrawal_s",
        false => "run.duration_s",
    };
    for (key, speed) in [
        ("tamping.insertion.duration_s", insertion.hypot(vibration)),
        ("tamping.squeeze.duration_s", squeeze + vibration),
        (withdrawal_key, withdrawal),
    ] {
        limit.check(key, speed, vibration, report);
    }
    if tamping.vibration.amplitude > 0.0 && steps < MIN_STEPS_PER_SINE {
        let text = DiagnosticText {
            problem: "the time step is too large for the vibration".into(),
            found: format!("{steps:.1} steps per period"),
            expected: format!("at least {MIN_STEPS_PER_SINE}"),
            hint: Some(format!(
                "a step of {:e} s would do",
                two_digits_down(1.0 / (MIN_STEPS_PER_SINE * tamping.vibration.frequency))
            )),
        };
        let keys = ["tamping.vibration.frequency_Hz", "run.step_s"];
        report.error(report.written_key(&keys), text);
    }
    if tamping.vibration.period().is_some_and(|period| period > tamping.squeeze.duration) {
        let text = DiagnosticText {
            problem: "the vibration is slower than the squeeze".into(),
            found: format!("{} Hz", tamping.vibration.frequency),
            expected: format!("a period within the {} s of a squeeze", tamping.squeeze.duration),
            hint: Some("machines vibrate at about 35 Hz".into()),
        };
        report.warn("tamping.vibration.frequency_Hz", text);
    }
    if insertion > MAX_INSERTION_SPEED {
        let text = DiagnosticText {
            problem: "the insertion is faster than machines can insert".into(),
            found: format!("{insertion:.2} m/s at its peak"),
            expected: format!("about {MAX_INSERTION_SPEED} m/s at most"),
            hint: None,
        };
        report.warn("tamping.insertion.duration_s", text);
    }
}

/// Returns the maximum vertical travel of a tine to full depth, m; `None` without tines.
fn max_travel(tamping: &TampingPlan, bed: &BedPlan, layout: &Layout) -> Option<f64> {
    let start = bed.preparation.fill_level + tamping.insertion.clearance;
    let deep = tamping.deep_edge(bed);
    layout.tines.iter().map(|t| (start - t.plan.bounds().low.z - deep).abs()).reduce(f64::max)
}

/// Rounds `x` down to two digits, so that a suggested value really satisfies the limit.
fn two_digits_down(x: f64) -> f64 {
    let nearest = format!("{x:.1e}");
    let (digits, exponent) = nearest.split_once('e').unwrap_or((&nearest, "0"));
    let digits: i32 = digits.replace('.', "").parse().unwrap_or(0);
    let exponent = exponent.parse().unwrap_or(0) - 1;
    // Parsed from decimals, as a case would be.
    let value = |digits: i32| format!("{digits}e{exponent}").parse().unwrap_or(0.0);
    if value(digits) <= x { value(digits) } else { value(digits - 1) }
}

/// Limit of the motion per step: half of the smallest grain.
pub(super) struct TravelLimit {
    /// Time step, s.
    pub h: f64,
    /// Size of the smallest grain, m.
    pub smallest: f64,
}

impl TravelLimit {
    /// Refuses a motion whose peak `speed`, which includes `vibration`, exceeds the limit; both in m/s. Returns true if it
    /// does not.
    fn check(&self, key: &str, speed: f64, vibration: f64, report: &mut DiagnosticReport) -> bool {
        let excess = self.excess(speed, vibration);
        let is_slow = excess.is_none();
        if let Some(text) = excess {
            report.error(report.written_key(&[key, "run.step_s"]), text);
        }
        is_slow
    }

    /// Returns what is wrong with a motion whose peak `speed`, which includes `vibration`, exceeds the limit; both in m/s.
    pub fn excess(&self, speed: f64, vibration: f64) -> Option<DiagnosticText> {
        let Self { h, smallest } = self;
        if speed * h <= 0.5 * smallest {
            return None;
        }
        let included = if vibration > 0.0 { ", the vibration included" } else { "" };
        Some(DiagnosticText {
            problem: "the time step is too large for this motion".into(),
            found: format!("{speed:.3} m/s, {:.4} m per step{included}", speed * h),
            expected: format!("at most half the smallest grain, {:.4} m", 0.5 * smallest),
            hint: Some(format!(
                "a step of {:e} s would do",
                two_digits_down(0.4 * smallest / speed)
            )),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_suggested_step_is_rounded_down() {
        for (x, expected) in [
            (1.0 / (MIN_STEPS_PER_SINE * 35.0), 2.8e-3),
            (2.8e-3, 2.8e-3),
            (1.04e-3, 1.0e-3),
            (9.99e-4, 9e-4),
            (0.0, 0.0),
        ] {
            let found = two_digits_down(x);
            assert!(found == expected && found <= x, "{x}: {found}");
        }
    }
}
