//! Checks of `[bed]`.

use crate::case_file::{BedSection, CaseFile, GrainsSection};
use crate::check::machine::load_range;
use crate::diagnostic::DiagnosticText;
use crate::report::DiagnosticReport;
use ballast::error::Error;
use ballast::geometry::stone_with_corners;
use ballast::track::plan::{BedPlan, EXPECTED_COMPACTNESS, StiffnessPlan};
use ballast::track::{CELLS_PER_GRAIN, FALL_SPEED, MAX_CELLS, MAX_GRAINS};

/// Maximum number of grains of a bed that is meant.
const MAX_EXPECTED_GRAINS: f64 = 5e6;
// The core, which estimates without voids, refuses fewer beds.
const _: () = assert!(MAX_EXPECTED_GRAINS / EXPECTED_COMPACTNESS < MAX_GRAINS);
/// Accelerations of gravity on the surface of the Earth, m/s², generously.
const EARTH_GRAVITIES: std::ops::RangeInclusive<f64> = 9.7..=9.9;
/// Tolerance for the rounding of sums of decimal numbers.
const ROUNDING: f64 = 1e-9;

/// Checks sizes, fractions and levels of the bed.
pub fn bed(case: &CaseFile, plan: &BedPlan, report: &mut DiagnosticReport) {
    let fill_level = plan.preparation.fill_level;
    fractions(&case.bed, report);
    grading(&case.bed, report);
    axes(&case.bed, report);
    counts(&case.bed, report);
    stones(&case.bed, plan, report);
    levels(case, fill_level, report);
    grain_number(&case.bed, plan, report);
    pouring_step(&case.bed, report);
    weight(&case.bed, report);
    rebound(case, plan, report);
    if let Some(traffic) = &plan.traffic {
        load_range(&traffic.load, "bed.traffic", report);
        if case.sleepers.is_none() && case.sleeper.is_empty() {
            let text = DiagnosticText {
                problem: "traffic needs sleepers".into(),
                found: "a bed without sleepers".into(),
                expected: "`[sleepers]` or `[[sleeper]]`".into(),
                hint: None,
            };
            report.error("bed.traffic", text);
        }
    }
}

/// Refuses a coefficient of restitution of contacts whose springs return the bodies.
fn rebound(case: &CaseFile, plan: &BedPlan, report: &mut DiagnosticReport) {
    let StiffnessPlan { grain, sleeper, tine, boundary } = &plan.stiffness;
    let has_springs = [grain, sleeper, tine].into_iter().chain(boundary).any(|s| !s.is_rigid());
    let (key, restitution) = ("run.restitution", case.run.restitution);
    if has_springs && restitution != 0.0 && report.is_clean(&[key]) {
        let text = DiagnosticText {
            problem: "contacts with a stiffness have no coefficient of restitution".into(),
            found: restitution.to_string(),
            expected: "0, or rigid contacts (no `bed.stiffness`)".into(),
            hint: Some(
                "the springs of the contacts return the bodies; `damping_s` lowers it".into(),
            ),
        };
        report.error(key, text);
    }
}

fn fractions(bed: &BedSection, report: &mut DiagnosticReport) {
    let sum: f64 = bed.grains.classes.iter().map(|c| c.number_fraction).sum();
    if report.is_clean(&["bed.grains.classes"]) && (sum - 1.0).abs() > 1e-6 {
        let text = DiagnosticText {
            problem: "the number fractions of the size classes do not sum to 1".into(),
            found: format!("a sum of {sum}"),
            expected: "number fractions that sum to 1".into(),
            hint: None,
        };
        report.error("bed.grains.classes", text);
    }
}

/// Checks that a sieve curve rises from 0 to 1 over ascending sieves, and that it stands alone.
fn grading(bed: &BedSection, report: &mut DiagnosticReport) {
    let key = "bed.grains.grading";
    let Some(points) = bed.grains.grading.as_ref().filter(|_| report.is_clean(&[key])) else {
        return;
    };
    if report.document.has("bed.grains.classes") {
        let text = DiagnosticText {
            problem: "the sizes of the grains are given twice".into(),
            found: "`classes` and `grading`".into(),
            expected: "one of them: `classes` by number or `grading` by mass".into(),
            hint: None,
        };
        report.error(key, text);
    }
    for (k, pair) in points.windows(2).enumerate() {
        let ([before, after], place) = ([pair[0], pair[1]], format!("{key}[{}]", k + 1));
        let text = |problem: &str, found: f64, than: f64, hint: Option<&str>| DiagnosticText {
            problem: problem.into(),
            found: format!("{found:?} after {than:?}"),
            expected: "ascending sieves, and shares that do not fall".into(),
            hint: hint.map(String::from),
        };
        if after.sieve_m <= before.sieve_m {
            let text = text("the sieves do not ascend", after.sieve_m, before.sieve_m, None);
            report.error(&format!("{place}.sieve_m"), text);
        } else if after.passing < before.passing {
            let hint = "a larger sieve passes at least as much as a smaller one";
            let text = text("the sieve curve falls", after.passing, before.passing, Some(hint));
            report.error(&format!("{place}.passing"), text);
        }
    }
    let last = points.len() - 1;
    for (k, verb, end, hint) in [
        (0, "start", 0.0, "add the sieve that retains all stones"),
        (last, "end", 1.0, "add the sieve that passes all stones"),
    ] {
        let passing = points[k].passing;
        if passing != end && report.is_clean(&[key]) {
            let text = DiagnosticText {
                problem: format!("the sieve curve does not {verb} at {end}"),
                found: format!("a share of {passing:?} that passes"),
                expected: format!("{end}"),
                hint: Some(hint.into()),
            };
            report.error(&format!("{key}[{k}].passing"), text);
        }
    }
}

fn axes(bed: &BedSection, report: &mut DiagnosticReport) {
    for (name, [mean, half]) in
        [("elongation", bed.grains.elongation), ("flatness", bed.grains.flatness)]
    {
        let key = format!("bed.grains.{name}");
        let is_within = mean - half >= 0.05 - ROUNDING && mean + half <= 1.0 + ROUNDING;
        if report.is_clean(&[&key]) && !is_within {
            let text = DiagnosticText {
                problem: format!("`{name}` leaves the range of grain shapes"),
                found: format!("{:.3} to {:.3}", mean - half, mean + half),
                expected: "mean ± half-width within 0.05 to 1".into(),
                hint: None,
            };
            report.error(&key, text);
        }
    }
}

fn counts(bed: &BedSection, report: &mut DiagnosticReport) {
    let [min, max] = bed.grains.vertices;
    if min > max {
        let text = DiagnosticText {
            problem: "the minimum of `vertices` is above its maximum".into(),
            found: format!("[{min}, {max}]"),
            expected: "the minimum first".into(),
            hint: Some(format!("write [{max}, {min}]")),
        };
        report.error("bed.grains.vertices", text);
    }
    let classes =
        bed.grains.grading.as_ref().map_or(bed.grains.classes.len(), |g| g.len().saturating_sub(1));
    if (bed.grains.shape_count as usize) < classes {
        let text = DiagnosticText {
            problem: "fewer shapes than size classes".into(),
            found: bed.grains.shape_count.to_string(),
            expected: format!("at least {classes}, one for each class"),
            hint: None,
        };
        report.error("bed.grains.shape_count", text);
    }
}

/// Checks the given stones, and that they are all used and stand alone.
fn stones(bed: &BedSection, plan: &BedPlan, report: &mut DiagnosticReport) {
    let key = "bed.grains.stones";
    let stones = &plan.grains.stones;
    if stones.is_empty() || !report.is_clean(&[key]) {
        return;
    }
    for (k, corners) in stones.iter().enumerate() {
        if let Err(Error::Geometry { expected, found }) = stone_with_corners(corners) {
            let text = DiagnosticText {
                problem: "these corners make no stone".into(),
                found,
                expected: expected.into(),
                hint: Some("`ballast stones` chooses corners from a surface mesh".into()),
            };
            report.error(&format!("{key}[{k}].corners"), text);
        }
    }
    if (bed.grains.shape_count as usize) < stones.len() {
        let text = DiagnosticText {
            problem: "fewer shapes than stones".into(),
            found: bed.grains.shape_count.to_string(),
            expected: format!("at least {}, one for each stone", stones.len()),
            hint: None,
        };
        report.error(report.written_key(&["bed.grains.shape_count", key]), text);
    }
    for name in ["vertices", "elongation", "flatness", "angularity"] {
        let other = format!("bed.grains.{name}");
        if report.document.has(&other) {
            let text = DiagnosticText {
                problem: "the shapes of the grains are given twice".into(),
                found: format!("`stones` and `{name}` of random shapes"),
                expected: "one of them".into(),
                hint: Some(format!("remove `{name}`: stones have their own")),
            };
            report.error(&other, text);
        }
    }
}

fn levels(case: &CaseFile, fill_level: f64, report: &mut DiagnosticReport) {
    let bed = &case.bed;
    let height = bed.size_m[2];
    if !report.is_clean(&[
        "bed.size_m",
        "bed.sleeper_underside_z_m",
        "bed.preparation.fill_level_m",
    ]) {
        return;
    }
    if bed.sleeper_underside_z_m >= height {
        let text = DiagnosticText {
            problem: "the sleepers' underside is above the box".into(),
            found: format!("{} m", bed.sleeper_underside_z_m),
            expected: format!("less than the box's height, {height} m"),
            hint: None,
        };
        report.error("bed.sleeper_underside_z_m", text);
        return;
    }
    let given = bed.preparation.fill_level_m.is_some();
    if fill_level < bed.sleeper_underside_z_m || fill_level > height {
        let key = if given { "bed.preparation.fill_level_m" } else { "bed.size_m[2]" };
        let text = DiagnosticText {
            problem: "the fill level is outside the box or below the sleepers".into(),
            found: format!("a fill level of {fill_level} m"),
            expected: format!(
                "from the sleepers' underside, {} m, to the box's height, {height} m",
                bed.sleeper_underside_z_m
            ),
            hint: (!given).then(|| "the cribs are filled to the top of the highest block".into()),
        };
        report.error(key, text);
    }
}

fn grain_number(bed: &BedSection, plan: &BedPlan, report: &mut DiagnosticReport) {
    if !report.is_clean(&[
        "bed.size_m",
        "bed.sleeper_underside_z_m",
        "bed.preparation",
        "bed.grains",
    ]) {
        return;
    }
    let [x, y, _] = bed.size_m;
    let grains = &bed.grains;
    let largest = plan.grains.max_size();
    // Grains have any orientation between the walls, and lie flat on the floor.
    let longest = largest * stretch(grains);
    let walls = ("bed.size_m", "a side of the box", x.min(y), longest, "the longest grain");
    let fill = (
        "bed.sleeper_underside_z_m",
        "the fill",
        plan.preparation.fill_level,
        largest,
        "the size of a grain",
    );
    for (key, what, found, min, of) in [walls, fill] {
        if found < min {
            let text = DiagnosticText {
                problem: format!("{what} is too small for one grain"),
                found: format!("{found:.3} m"),
                expected: format!("more than {of}, {min:.3} m"),
                hint: (min > 1.0).then(|| "all sizes are in metres".into()),
            };
            report.error(key, text);
            return;
        }
    }
    let expected = plan.expected_grains();
    // Written so that NaN is refused, too.
    if !(expected <= MAX_EXPECTED_GRAINS) {
        let text = DiagnosticText {
            problem: "the bed is too large".into(),
            found: format!("about {expected:.1e} grains"),
            expected: format!("at most {MAX_EXPECTED_GRAINS:.0e}"),
            hint: Some("all sizes are in metres".into()),
        };
        report.error("bed.size_m", text);
        return;
    }
    // Pouring uses a raster that resolves the smallest grain.
    let smallest = plan.grains.min_size();
    let cells = [x, y].map(|side| (side * CELLS_PER_GRAIN / smallest).ceil());
    if cells[0] * cells[1] > MAX_CELLS {
        let text = DiagnosticText {
            problem: "the bed is too wide for its smallest grains".into(),
            found: format!("{x} m x {y} m and grains of {smallest} m"),
            expected: format!(
                "at most {:.3e} times the square of these in plan view",
                MAX_CELLS / CELLS_PER_GRAIN.powi(2)
            ),
            hint: None,
        };
        report.error("bed.size_m", text);
    }
}

/// Returns the ratio of a grain's longest extent to its size, the diameter of the sphere of equal volume.
///
/// It is at least that of an ellipsoid of the same volume, because a hull of points on an ellipsoid has less volume.
fn stretch(grains: &GrainsSection) -> f64 {
    let min = |[mean, half]: [f64; 2]| mean - half;
    let (elongation, flatness) = (min(grains.elongation), min(grains.flatness));
    // Axes 1, e and e f have the product e² f.
    (elongation * elongation * flatness).cbrt().recip()
}

/// Checks that free fall gains less in a step than the speed to which pouring damps it.
fn pouring_step(bed: &BedSection, report: &mut DiagnosticReport) {
    let key = "bed.preparation.step_s";
    let step = bed.preparation.step_s;
    if report.is_clean(&[key, "bed.gravity_m_per_s2"]) && step * bed.gravity_m_per_s2 >= FALL_SPEED
    {
        let text = DiagnosticText {
            problem: "the time step is too large for pouring".into(),
            found: format!("{step} s"),
            expected: format!("a step in which free fall gains less than {FALL_SPEED} m/s"),
            hint: Some("1e-3 s is usual".into()),
        };
        report.error(key, text);
    }
}

/// Warns of a bed without gravity, or with another one than that of the Earth.
fn weight(bed: &BedSection, report: &mut DiagnosticReport) {
    let (key, gravity) = ("bed.gravity_m_per_s2", bed.gravity_m_per_s2);
    if !report.is_clean(&[key]) || EARTH_GRAVITIES.contains(&gravity) {
        return;
    }
    let text = if gravity == 0.0 {
        DiagnosticText {
            problem: "a bed without weight stays as loose as it was placed".into(),
            found: "no gravity".into(),
            expected: "9.81 m/s², or another one above 0".into(),
            hint: None,
        }
    } else {
        DiagnosticText {
            problem: "the gravity is not that of the Earth".into(),
            found: format!("{gravity} m/s²"),
            expected: "about 9.81 m/s²".into(),
            hint: (gravity > 100.0).then(|| "the unit is m/s², not cm/s²".into()),
        }
    };
    report.warn(key, text);
}
