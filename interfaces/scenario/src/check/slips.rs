//! Numbers that may be meant but are more likely slips: of a unit, of a sign.

use crate::case_file::CaseFile;
use crate::layout::{Layout, Placed};
use crate::report::{Finding, Report};
use ballast::track::plan::{TampingPlan, TinePlan};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

/// Densities of stones, from the lightest that sink to ores and slags, kg/m³.
const STONES: std::ops::RangeInclusive<f64> = 1000.0..=8000.0;
/// Highest friction coefficient of stones and what they lie on.
const ROUGHEST: f64 = 2.0;

/// Force limits below this are reached by the first stones, N.
const LOWEST_LIMIT: f64 = 100.0;

/// Warns of likely slips of the bed, and of the tines where there is a cycle.
pub fn slips(case: &CaseFile, layout: &Layout, tamping: Option<&TampingPlan>, report: &mut Report) {
    density(case, report);
    friction(case, report);
    if let Some(tamping) = tamping {
        force_limits(tamping, report);
        soft_mounts(layout, tamping, report);
        pairs(layout, report);
    }
}

fn density(case: &CaseFile, report: &mut Report) {
    let (key, density) = ("bed.density_kg_per_m3", case.bed.density_kg_per_m3);
    if report.clean(&[key]) && !STONES.contains(&density) {
        let finding = Finding {
            problem: "no stone has this density".into(),
            found: format!("{density} kg/m³"),
            expected: format!("{} to {} kg/m³", STONES.start(), STONES.end()),
            hint: Some("2700 is usual: of the grains, not of the bed".into()),
        };
        report.warn(key, finding);
    }
}

fn friction(case: &CaseFile, report: &mut Report) {
    let friction = &case.bed.friction;
    for (key, coefficient) in [
        ("bed.friction.grain", friction.grain),
        ("bed.friction.sleeper", friction.sleeper),
        ("bed.friction.tine", friction.tine),
        ("bed.friction.boundary", friction.boundary),
        ("bed.preparation.friction", case.bed.preparation.friction),
    ] {
        if report.clean(&[key]) && coefficient > ROUGHEST {
            let finding = Finding {
                problem: "nothing is as rough as this".into(),
                found: coefficient.to_string(),
                expected: format!("a friction coefficient of at most {ROUGHEST}"),
                hint: Some("it is the tangent of the angle, not the angle in degrees".into()),
            };
            report.warn(key, finding);
        }
    }
}

fn force_limits(tamping: &TampingPlan, report: &mut Report) {
    let limits =
        [("insertion", tamping.insertion.force_limit), ("squeeze", tamping.squeeze.force_limit)];
    for (phase, limit) in limits {
        let key = format!("tamping.{phase}.force_limit_N");
        if report.clean(&[&key]) && limit < LOWEST_LIMIT {
            let finding = Finding {
                problem: format!("the {phase} waits as soon as tines touch the bed"),
                found: format!("a force limit of {limit} N"),
                expected: format!("{LOWEST_LIMIT} N or more"),
                hint: Some("limits are in N: 7800, not 7.8".into()),
            };
            report.warn(&key, finding);
        }
    }
}

/// A blade whose mount is too soft for the vibration stays behind, and swings the other way.
fn soft_mounts(layout: &Layout, tamping: &TampingPlan, report: &mut Report) {
    let vibration = &tamping.vibration;
    if vibration.amplitude == 0.0 {
        return;
    }
    let mut told = BTreeSet::new();
    for tine in &layout.tines {
        let Some(mount) = tine.plan.mount else { continue };
        let [stiffness, _] = mount.dof_modes[0].spring();
        let natural = (stiffness / mount.mass).sqrt() / TAU;
        let key = format!("{}.mount", tine.key);
        if natural < vibration.frequency && told.insert(key.clone()) {
            let finding = Finding {
                problem: format!("`{}` is too soft to follow its vibration", tine.plan.name),
                found: format!("a natural frequency of {natural:.1} Hz on its mount"),
                expected: format!("more than that of the vibration, {} Hz", vibration.frequency),
                hint: Some("stiffness is in N/m, mass in kg".into()),
            };
            report.warn(&key, finding);
        }
    }
}

fn pairs(layout: &Layout, report: &mut Report) {
    let mut pairs: BTreeMap<u32, Vec<&Placed<TinePlan>>> = BTreeMap::new();
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
        let way = |t: &TinePlan| if t.direction > 0.0 { "+x" } else { "-x" };
        let at =
            |t: &TinePlan| format!("`{}` at x = {} m towards {}", t.name, t.position[0], way(t));
        let finding = Finding {
            problem: format!("the two tines of pair {number} do not face each other"),
            found: format!("{} and {}", at(a), at(b)),
            expected: "the one at the smaller x towards +x, the other towards -x".into(),
            hint: Some("tines that do not close on each other have a `pair` each".into()),
        };
        report.warn(&format!("{}.squeeze_direction", second.key), finding);
    }
}
