//! The cycle of the machine: it fits the run, the bed and the time step.

use crate::layout::Layout;
use crate::report::{Finding, Report};
use ballast::track::motion_law::{SMOOTH_STEP_PEAK, TRAVEL_PEAK};
use ballast::track::plan::{BedPlan, RunPlan, TampingPlan};
use ballast::track::{MAX_AVERAGING_STEPS, MAX_PROTRUSION, MIN_STEPS_PER_PERIOD};
use std::f64::consts::PI;

/// Clearance, in mean grain sizes, below which some bed has a grain in the way of a tine: trimmed at half a size, they may rise.
const CLOSE: f64 = 0.6;
/// Fastest insertion that machines reach, m/s.
const FAST_INSERTION: f64 = 1.0;
/// Fewest steps per period that show a sine.
const STEPS_OF_A_SINE: f64 = 10.0;
// The core refuses fewer: only what would be another motion.
const _: () = assert!(STEPS_OF_A_SINE > MIN_STEPS_PER_PERIOD);

/// Checks the cycle against bed, layout and time stepping.
pub fn machine(
    tamping: Option<&TampingPlan>,
    bed: &BedPlan,
    layout: &Layout,
    run: &RunPlan,
    report: &mut Report,
) {
    let Some(tamping) = tamping else {
        if !layout.tines.is_empty() {
            let key = layout.tines[0].key.clone();
            let finding = Finding {
                problem: "the tines move only where a partner moves them".into(),
                found: "tines without `[tamping]`".into(),
                expected: "a table `[tamping]`, which may be empty, for a run by itself".into(),
                hint: None,
            };
            report.warn(&key, finding);
        }
        return;
    };
    if !layout.sleepers.iter().any(|s| s.plan.tamped) && layout.tines.is_empty() {
        let finding = Finding {
            problem: "the machine has nothing to do".into(),
            found: "neither tines nor a tamped sleeper".into(),
            expected: "`[tines]`, and a sleeper that is tamped".into(),
            hint: None,
        };
        report.warn("tamping", finding);
    }
    cycle_fits(tamping, run, report);
    if !report.clean(&["tamping", "bed", "run", "tines", "tine"]) {
        return;
    }
    above_floor(tamping, bed, layout, report);
    among_grains(tamping, bed, layout, report);
    above_grains(tamping, bed, layout, report);
    step_resolves(tamping, bed, layout, run, report);
}

fn cycle_fits(tamping: &TampingPlan, run: &RunPlan, report: &mut Report) {
    if !report.clean(&["tamping", "run"]) {
        return;
    }
    let duration = run.duration_ns as f64 * 1e-9;
    let before = tamping.start
        + tamping.lift.duration
        + tamping.insertion.duration
        + tamping.squeeze.duration
        + tamping.hold;
    if before >= duration {
        let finding = Finding {
            problem: "the run ends before the tines are withdrawn".into(),
            found: format!("{duration} s"),
            expected: format!("more than {before:.4} s: lift, insertion, squeeze and hold"),
            hint: None,
        };
        report.error("run.duration_s", finding);
    } else if before + tamping.withdrawal > duration * (1.0 + 1e-9) {
        let finding = Finding {
            problem: "the run ends during the withdrawal".into(),
            found: format!("{} s", tamping.withdrawal),
            expected: format!("at most {:.4} s", duration - before),
            hint: None,
        };
        report.warn("tamping.withdrawal_s", finding);
    }
}

fn above_floor(tamping: &TampingPlan, bed: &BedPlan, layout: &Layout, report: &mut Report) {
    let edge = tamping.deep_edge(bed);
    for tine in &layout.tines {
        let lowest = edge - tine.plan.blade.z;
        if lowest <= 0.0 {
            let finding = Finding {
                problem: format!("`{}` reaches the floor", tine.plan.name),
                found: format!("its lower edge at z = {lowest:.4} m"),
                expected: format!(
                    "an insertion depth below {:.4} m",
                    tamping.insertion.depth + lowest
                ),
                hint: None,
            };
            report.error("tamping.insertion.depth_m", finding);
            return;
        }
    }
}

/// Tines that never reach the bed tamp nothing.
fn among_grains(tamping: &TampingPlan, bed: &BedPlan, layout: &Layout, report: &mut Report) {
    let (edge, level) = (tamping.deep_edge(bed), bed.preparation.fill_level);
    for tine in &layout.tines {
        let lowest = edge - tine.plan.blade.z;
        if lowest >= level {
            let finding = Finding {
                problem: format!("`{}` never reaches the bed", tine.plan.name),
                found: format!("its lower edge at z = {lowest:.4} m where it is deepest"),
                expected: format!("below the fill level, {level:.4} m"),
                hint: None,
            };
            report.warn("tamping.insertion.depth_m", finding);
            return;
        }
    }
}

/// Tines that begin among grains are refused once the bed is there. Whether a grain sticks out right under a blade is known only
/// then.
fn above_grains(tamping: &TampingPlan, bed: &BedPlan, layout: &Layout, report: &mut Report) {
    let size = bed.grains.mean_size();
    let clearance = tamping.insertion.clearance;
    if clearance >= CLOSE * size || layout.tines.is_empty() {
        return;
    }
    let highest = MAX_PROTRUSION * size;
    let finding = Finding {
        problem: "the tines may begin among grains, and the run fail".into(),
        found: format!("a clearance of {clearance} m"),
        expected: format!(
            "at least {highest:.4} m, as far as grains may stick out of the prepared bed"
        ),
        hint: None,
    };
    report.warn("tamping.insertion.clearance_m", finding);
}

/// Tools must not jump over grains, nor the steps over the vibration.
fn step_resolves(
    tamping: &TampingPlan,
    bed: &BedPlan,
    layout: &Layout,
    run: &RunPlan,
    report: &mut Report,
) {
    let h = run.stepping.h();
    let smallest = bed.grains.classes.iter().map(|c| c.size).fold(f64::INFINITY, f64::min);
    let limit = Limit { h, smallest };
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
        let finding = Finding {
            problem: format!("the time step is too small for the {slow}"),
            found: format!("{steps:.0} steps {found}"),
            expected: format!(
                "at most {MAX_AVERAGING_STEPS}, over which the machine averages its forces"
            ),
            hint: None,
        };
        report.error(&format!("tamping.{key}"), finding);
    }
    let Some(travel) = farthest(tamping, bed, layout) else { return };
    // Over a step: the chord of a sine is flatter than its tangent.
    let angle = (PI * tamping.vibration.frequency * h).min(0.5 * PI);
    let swing = 2.0 * tamping.vibration.amplitude * angle.sin() / h;
    // What is too fast alone is told once.
    let vibration = if limit.check("tamping.vibration", swing, 0.0, report) { swing } else { 0.0 };
    let insertion = TRAVEL_PEAK * travel / tamping.insertion.duration;
    let squeeze = TRAVEL_PEAK * tamping.squeeze.stroke / tamping.squeeze.duration;
    // They open in its first half, while they go up.
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
    if tamping.vibration.amplitude > 0.0 && steps < STEPS_OF_A_SINE {
        let finding = Finding {
            problem: "the time step is too large for the vibration".into(),
            found: format!("{steps:.1} steps per period"),
            expected: format!("at least {STEPS_OF_A_SINE}"),
            hint: Some(format!(
                "a step of {:e} s would do",
                two_digits_down(1.0 / (STEPS_OF_A_SINE * tamping.vibration.frequency))
            )),
        };
        report.error("tamping.vibration.frequency_Hz", finding);
    }
    if tamping.vibration.period().is_some_and(|period| period > tamping.squeeze.duration) {
        let finding = Finding {
            problem: "the vibration is slower than the squeeze".into(),
            found: format!("{} Hz", tamping.vibration.frequency),
            expected: format!("a period within the {} s of a squeeze", tamping.squeeze.duration),
            hint: Some("machines vibrate at about 35 Hz".into()),
        };
        report.warn("tamping.vibration.frequency_Hz", finding);
    }
    if insertion > FAST_INSERTION {
        let finding = Finding {
            problem: "the insertion is faster than machines are".into(),
            found: format!("{insertion:.2} m/s at its peak"),
            expected: format!("about {FAST_INSERTION} m/s at most"),
            hint: None,
        };
        report.warn("tamping.insertion.duration_s", finding);
    }
}

/// The longest way of a tine down to full depth, or up to it, m; none without tines.
fn farthest(tamping: &TampingPlan, bed: &BedPlan, layout: &Layout) -> Option<f64> {
    let start = bed.preparation.fill_level + tamping.insertion.clearance;
    let deep = tamping.deep_edge(bed);
    layout.tines.iter().map(|t| (start + t.plan.blade.z - deep).abs()).reduce(f64::max)
}

/// `x` with two digits, rounded down: what is offered as a remedy has to be one.
fn two_digits_down(x: f64) -> f64 {
    let near = format!("{x:.1e}");
    let (digits, exponent) = near.split_once('e').unwrap_or((&near, "0"));
    let digits: i32 = digits.replace('.', "").parse().unwrap_or(0);
    let exponent = exponent.parse().unwrap_or(0) - 1;
    // Decimals are read as they are from a case.
    let told = |digits: i32| format!("{digits}e{exponent}").parse().unwrap_or(0.0);
    if told(digits) <= x { told(digits) } else { told(digits - 1) }
}

/// What a step allows: half of the smallest grain.
struct Limit {
    /// Time step, s.
    h: f64,
    /// m.
    smallest: f64,
}

impl Limit {
    /// Refuses a motion, with the `vibration` in it, whose peak `speed` leads too far in a step; both in m/s.
    fn check(&self, key: &str, speed: f64, vibration: f64, report: &mut Report) -> bool {
        let Self { h, smallest } = self;
        let is_slow = speed * h <= 0.5 * smallest;
        if !is_slow {
            let included = if vibration > 0.0 { ", the vibration included" } else { "" };
            let finding = Finding {
                problem: "the time step is too large for this motion".into(),
                found: format!("{speed:.3} m/s, {:.4} m per step{included}", speed * h),
                expected: format!("at most half the smallest grain, {:.4} m", 0.5 * smallest),
                hint: Some(format!(
                    "a step of {:e} s would do",
                    two_digits_down(0.4 * smallest / speed)
                )),
            };
            report.error(key, finding);
        }
        is_slow
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_remedy_is_rounded_down() {
        for (x, told) in [
            (1.0 / (STEPS_OF_A_SINE * 35.0), 2.8e-3),
            (2.8e-3, 2.8e-3),
            (1.04e-3, 1.0e-3),
            (9.99e-4, 9e-4),
            (0.0, 0.0),
        ] {
            let found = two_digits_down(x);
            assert!(found == told && found <= x, "{x}: {found}");
        }
    }
}
