//! Warnings of allowed values that are probably mistakes, for example in a unit or a sign.

use crate::case_file::CaseFile;
use crate::diagnostic::DiagnosticText;
use crate::layout::Layout;
use crate::placed_body::PlacedBody;
use crate::report::DiagnosticReport;
use ballast::track::plan::{TampingPlan, TinePlan};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

/// Densities of stones, kg/m³, from the lightest that sink to ores and slags.
const STONE_DENSITIES: std::ops::RangeInclusive<f64> = 1000.0..=8000.0;
/// Maximum friction coefficient of stones on any material.
const MAX_FRICTION: f64 = 2.0;
/// Maximum duration of a phase of the cycle on a machine, s.
const MAX_PHASE_DURATION: f64 = 10.0;
/// Minimum force limit that is not reached at the first contact, N.
const MIN_FORCE_LIMIT: f64 = 100.0;

/// Warns of implausible values of the bed, and of the tines if there is a cycle.
pub fn plausibility(
    case: &CaseFile,
    layout: &Layout,
    tamping: Option<&TampingPlan>,
    report: &mut DiagnosticReport,
) {
    density(case, report);
    friction(case, report);
    if let Some(tamping) = tamping {
        durations(tamping, report);
        force_limits(tamping, report);
        soft_mounts(layout, tamping, report);
        pairs(layout, report);
    }
}

fn density(case: &CaseFile, report: &mut DiagnosticReport) {
    let (key, density) = ("bed.density_kg_per_m3", case.bed.density_kg_per_m3);
    if report.is_clean(&[key]) && !STONE_DENSITIES.contains(&density) {
        let text = DiagnosticText {
            problem: "no stone has this density".into(),
            found: format!("{density} kg/m³"),
            expected: format!("{} to {} kg/m³", STONE_DENSITIES.start(), STONE_DENSITIES.end()),
            hint: Some("2700 is usual: of the grains, not of the bed".into()),
        };
        report.warn(key, text);
    }
}

fn friction(case: &CaseFile, report: &mut DiagnosticReport) {
    let friction = &case.bed.friction;
    let of_walls =
        case.bed.walls.by_name().into_iter().filter_map(|(name, wall)| {
            Some((format!("bed.walls.{name}.friction"), wall.friction?))
        });
    let of_plates = case.plate.iter().enumerate();
    let of_plates =
        of_plates.filter_map(|(i, plate)| Some((format!("plate[{i}].friction"), plate.friction?)));
    let of_kinds = [
        ("bed.friction.grain", friction.grain),
        ("bed.friction.sleeper", friction.sleeper),
        ("bed.friction.tine", friction.tine),
        ("bed.friction.boundary", friction.boundary),
        ("bed.preparation.friction", case.bed.preparation.friction),
    ];
    let of_kinds = of_kinds.into_iter().map(|(key, coefficient)| (String::from(key), coefficient));
    for (key, coefficient) in of_kinds.chain(of_walls).chain(of_plates) {
        if report.is_clean(&[&key]) && coefficient > MAX_FRICTION {
            let text = DiagnosticText {
                problem: "no material has this friction".into(),
                found: coefficient.to_string(),
                expected: format!("a friction coefficient of at most {MAX_FRICTION}"),
                hint: Some("it is the tangent of the angle, not the angle in degrees".into()),
            };
            report.warn(&key, text);
        }
    }
}

/// Warns of phases that take far longer than those of machines.
fn durations(tamping: &TampingPlan, report: &mut DiagnosticReport) {
    for (phase, key, duration) in [
        ("wait before the cycle", "tamping.start_s", tamping.start),
        ("lift", "tamping.lift.duration_s", tamping.lift.duration),
        ("insertion", "tamping.insertion.duration_s", tamping.insertion.duration),
        ("squeeze", "tamping.squeeze.duration_s", tamping.squeeze.duration),
        ("hold", "tamping.hold_s", tamping.hold),
        ("withdrawal", "tamping.withdrawal_s", tamping.withdrawal),
    ] {
        let rest = "without `tamping.withdrawal_s`, the withdrawal takes the rest of the run";
        let key = report.written_key(&[key, "run.duration_s"]);
        if report.is_clean(&[key]) && duration > MAX_PHASE_DURATION {
            let text = DiagnosticText {
                problem: format!("the {phase} takes far longer than on any machine"),
                found: format!("{:.4} s", duration),
                expected: format!("at most {MAX_PHASE_DURATION} s"),
                hint: (key == "run.duration_s").then(|| rest.into()),
            };
            report.warn(key, text);
        }
    }
}

fn force_limits(tamping: &TampingPlan, report: &mut DiagnosticReport) {
    let limits =
        [("insertion", tamping.insertion.force_limit), ("squeeze", tamping.squeeze.force_limit)];
    for (phase, limit) in limits {
        let key = format!("tamping.{phase}.force_limit_N");
        if report.is_clean(&[&key]) && limit < MIN_FORCE_LIMIT {
            let text = DiagnosticText {
                problem: format!("the {phase} pauses as soon as tines touch the bed"),
                found: format!("a force limit of {limit} N"),
                expected: format!("{MIN_FORCE_LIMIT} N or more"),
                hint: Some("limits are in N: 7800, not 7.8".into()),
            };
            report.warn(&key, text);
        }
    }
}

/// Warns of mounts whose natural frequency is below that of the vibration: the blade moves in opposition to its holder.
fn soft_mounts(layout: &Layout, tamping: &TampingPlan, report: &mut DiagnosticReport) {
    let vibration = &tamping.vibration;
    if vibration.amplitude == 0.0 {
        return;
    }
    let mut reported = BTreeSet::new();
    for tine in &layout.tines {
        let Some(mount) = tine.plan.mount else { continue };
        let [stiffness, _] = mount.dof_modes[0].spring();
        let natural = (stiffness / mount.mass).sqrt() / TAU;
        let key = format!("{}.mount", tine.key);
        if natural < vibration.frequency && reported.insert(key.clone()) {
            let text = DiagnosticText {
                problem: format!(
                    "the mount of `{}` is too soft to follow its vibration",
                    tine.plan.name
                ),
                found: format!("a natural frequency of {natural:.1} Hz on its mount"),
                expected: format!("more than that of the vibration, {} Hz", vibration.frequency),
                hint: Some("stiffness is in N/m, mass in kg".into()),
            };
            report.warn(report.written_key(&[&key, "tamping.vibration.frequency_Hz"]), text);
        }
    }
}

fn pairs(layout: &Layout, report: &mut DiagnosticReport) {
    let mut pairs: BTreeMap<u32, Vec<&PlacedBody<TinePlan>>> = BTreeMap::new();
    for tine in &layout.tines {
        pairs.entry(tine.plan.pair).or_default().push(tine);
    }
    for (number, tines) in pairs {
        let &[first, second] = tines.as_slice() else { continue };
        let (a, b) = (&first.plan, &second.plan);
        let faces =
            a.direction != b.direction && a.direction * (b.position[0] - a.position[0]) >= 0.0;
        if faces {
            continue;
        }
        let direction = |t: &TinePlan| if t.direction > 0.0 { "+x" } else { "-x" };
        let at = |t: &TinePlan| {
            format!("`{}` at x = {} m towards {}", t.name, t.position[0], direction(t))
        };
        let text = DiagnosticText {
            problem: format!("the two tines of pair {number} do not face each other"),
            found: format!("{} and {}", at(a), at(b)),
            expected: "the one at the smaller x towards +x, the other towards -x".into(),
            hint: Some(
                "give tines that do not close on each other different `pair` numbers".into(),
            ),
        };
        report.warn(&format!("{}.squeeze_direction", second.key), text);
    }
}
