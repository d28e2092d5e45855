//! Checks of `[bed]`.

use crate::case_file::{BedSection, CaseFile, GrainsSection};
use crate::report::{Finding, Report};
use ballast::track::plan::{BedPlan, EXPECTED_COMPACTNESS};
use ballast::track::{CELLS_PER_GRAIN, FALL_SPEED, MAX_CELLS, MAX_GRAINS};

/// More grains than this in a case are a slip of the pen.
const MOST_EXPECTED: f64 = 5e6;
// The core, which reckons without voids, refuses fewer.
const _: () = assert!(MOST_EXPECTED / EXPECTED_COMPACTNESS < MAX_GRAINS);
/// Rounding of sums of decimal numbers.
const SLACK: f64 = 1e-9;

/// Checks sizes, shares and levels of the bed.
pub fn bed(case: &CaseFile, plan: &BedPlan, report: &mut Report) {
    let fill_level = plan.preparation.fill_level;
    shares(&case.bed, report);
    axes(&case.bed, report);
    counts(&case.bed, report);
    levels(case, fill_level, report);
    grain_number(&case.bed, plan, report);
    pouring_step(&case.bed, report);
    weight(&case.bed, report);
}

fn shares(bed: &BedSection, report: &mut Report) {
    let sum: f64 = bed.grains.classes.iter().map(|c| c.number_fraction).sum();
    if report.clean(&["bed.grains.classes"]) && (sum - 1.0).abs() > 1e-6 {
        let finding = Finding {
            problem: "the number fractions of the size classes do not sum to 1".into(),
            found: format!("a sum of {sum}"),
            expected: "number fractions that sum to 1".into(),
            hint: None,
        };
        report.error("bed.grains.classes", finding);
    }
}

fn axes(bed: &BedSection, report: &mut Report) {
    for (name, [mean, half]) in
        [("elongation", bed.grains.elongation), ("flatness", bed.grains.flatness)]
    {
        let key = format!("bed.grains.{name}");
        let is_within = mean - half >= 0.05 - SLACK && mean + half <= 1.0 + SLACK;
        if report.clean(&[&key]) && !is_within {
            let finding = Finding {
                problem: format!("`{name}` leaves the range of grain shapes"),
                found: format!("{:.3} to {:.3}", mean - half, mean + half),
                expected: "mean ± half-width within 0.05 to 1".into(),
                hint: None,
            };
            report.error(&key, finding);
        }
    }
}

fn counts(bed: &BedSection, report: &mut Report) {
    let [least, most] = bed.grains.vertices;
    if least > most {
        let finding = Finding {
            problem: "`vertices` is upside down".into(),
            found: format!("[{least}, {most}]"),
            expected: "the smallest number first".into(),
            hint: Some(format!("write [{most}, {least}]")),
        };
        report.error("bed.grains.vertices", finding);
    }
    let classes = bed.grains.classes.len();
    if (bed.grains.shape_count as usize) < classes {
        let finding = Finding {
            problem: "fewer shapes than size classes".into(),
            found: bed.grains.shape_count.to_string(),
            expected: format!("at least {classes}, one for each class"),
            hint: None,
        };
        report.error("bed.grains.shape_count", finding);
    }
}

fn levels(case: &CaseFile, fill_level: f64, report: &mut Report) {
    let bed = &case.bed;
    let height = bed.size_m[2];
    if !report.clean(&["bed.size_m", "bed.sleeper_underside_z_m", "bed.preparation.fill_level_m"]) {
        return;
    }
    if bed.sleeper_underside_z_m >= height {
        let finding = Finding {
            problem: "the sleepers' underside is above the box".into(),
            found: format!("{} m", bed.sleeper_underside_z_m),
            expected: format!("less than the box's height, {height} m"),
            hint: None,
        };
        report.error("bed.sleeper_underside_z_m", finding);
        return;
    }
    let given = bed.preparation.fill_level_m.is_some();
    if fill_level < bed.sleeper_underside_z_m || fill_level > height {
        let key = if given { "bed.preparation.fill_level_m" } else { "bed.size_m[2]" };
        let finding = Finding {
            problem: "the fill level is outside the box or below the sleepers".into(),
            found: format!("a fill level of {fill_level} m"),
            expected: format!(
                "from the sleepers' underside, {} m, to the box's height, {height} m",
                bed.sleeper_underside_z_m
            ),
            hint: (!given).then(|| "the cribs are filled to the top of the highest block".into()),
        };
        report.error(key, finding);
    }
}

fn grain_number(bed: &BedSection, plan: &BedPlan, report: &mut Report) {
    if !report.clean(&["bed.size_m", "bed.sleeper_underside_z_m", "bed.preparation", "bed.grains"])
    {
        return;
    }
    let [x, y, _] = bed.size_m;
    let grains = &bed.grains;
    let largest = grains.classes.iter().map(|c| c.size_m).fold(0.0, f64::max);
    // Grains stand in any way between the walls, and lie flat on the floor.
    let longest = largest * stretch(grains);
    let walls = ("bed.size_m", "a side of the box", x.min(y), longest, "the longest grain");
    let fill = (
        "bed.sleeper_underside_z_m",
        "the fill",
        plan.preparation.fill_level,
        largest,
        "the size of a grain",
    );
    for (key, what, found, least, of) in [walls, fill] {
        if found < least {
            let finding = Finding {
                problem: format!("{what} is too small for one grain"),
                found: format!("{found:.3} m"),
                expected: format!("more than {of}, {least:.3} m"),
                hint: (least > 1.0).then(|| "all sizes are in metres".into()),
            };
            report.error(key, finding);
            return;
        }
    }
    let expected = plan.expected_grains();
    // Written so that a number that is not one is refused, too.
    if !(expected <= MOST_EXPECTED) {
        let finding = Finding {
            problem: "the bed is too large".into(),
            found: format!("about {expected:.1e} grains"),
            expected: format!("at most {MOST_EXPECTED:.0e}"),
            hint: Some("all sizes are in metres".into()),
        };
        report.error("bed.size_m", finding);
        return;
    }
    // It is poured on a raster that shows the smallest.
    let smallest = grains.classes.iter().map(|c| c.size_m).fold(f64::INFINITY, f64::min);
    let cells = [x, y].map(|side| (side * CELLS_PER_GRAIN / smallest).ceil());
    if cells[0] * cells[1] > MAX_CELLS {
        let finding = Finding {
            problem: "the bed is too wide for its smallest grains".into(),
            found: format!("{x} m x {y} m and grains of {smallest} m"),
            expected: format!(
                "at most {:.3e} times the square of these in plan view",
                MAX_CELLS / CELLS_PER_GRAIN.powi(2)
            ),
            hint: None,
        };
        report.error("bed.size_m", finding);
    }
}

/// Longest extent of a grain over its size, the diameter of the sphere of equal volume: at least that of an ellipsoid of
/// the same volume, as a hull of corners on an ellipsoid fills less than that.
fn stretch(grains: &GrainsSection) -> f64 {
    let least = |[mean, half]: [f64; 2]| mean - half;
    let (elongation, flatness) = (least(grains.elongation), least(grains.flatness));
    // Axes 1, e and e f have the product e² f.
    (elongation * elongation * flatness).cbrt().recip()
}

/// Pouring damps falls; one step must not gain more than it lets through.
fn pouring_step(bed: &BedSection, report: &mut Report) {
    let key = "bed.preparation.step_s";
    let step = bed.preparation.step_s;
    if report.clean(&[key, "bed.gravity_m_per_s2"]) && step * bed.gravity_m_per_s2 >= FALL_SPEED {
        let finding = Finding {
            problem: "the time step is too large for pouring".into(),
            found: format!("{step} s"),
            expected: format!("a step in which free fall gains less than {FALL_SPEED} m/s"),
            hint: Some("1e-3 s is usual".into()),
        };
        report.error(key, finding);
    }
}

/// A bed is poured by its weight.
fn weight(bed: &BedSection, report: &mut Report) {
    let key = "bed.gravity_m_per_s2";
    if report.clean(&[key]) && bed.gravity_m_per_s2 == 0.0 {
        let finding = Finding {
            problem: "a bed without weight stays as loose as it is laid".into(),
            found: "no gravity".into(),
            expected: "9.81 m/s², or another one above 0".into(),
            hint: None,
        };
        report.warn(key, finding);
    }
}
