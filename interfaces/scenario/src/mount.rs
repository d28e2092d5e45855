//! Mounts of tines, sleepers and plates.

use crate::case_file::{self, DofModeName, MountSection};
use crate::diagnostic::DiagnosticText;
use crate::report::DiagnosticReport;
use ballast::model::{DofMode, Mount};
use ballast::track::plan::{BlockPlan, PlateBox, TineShape};
use ballast::track::{self, steel_cantilever};

/// Returns the mount of a tine, whose section is at `key`; `None` if it is rigid or invalid.
///
/// Absent values are those of a steel tine of blade and shaft. Parts tell too little about the shaft: they need all values.
pub fn tine_mount(
    case: &case_file::TineMountSection,
    shape: &TineShape,
    key: &str,
    report: &mut DiagnosticReport,
) -> Option<Mount> {
    if case.rigid {
        let default_ratio = case_file::TineMountSection::default().damping_ratio;
        let unused = [
            ("mass_kg", case.mass_kg.is_some()),
            ("stiffness_N_per_m", case.stiffness.is_some()),
            ("damping_ratio", case.damping_ratio != default_ratio),
        ];
        warn_unused(unused.into_iter(), "`rigid = true`: a tine without a spring", key, report);
        return None;
    }
    let (stiffness, mass) = match (shape, case.stiffness, case.mass_kg) {
        (_, Some(stiffness), Some(mass)) => (stiffness, mass),
        (TineShape::Boxes { blade, shaft }, stiffness, mass) => {
            let steel = steel_cantilever(blade, shaft);
            let [steel_stiffness, _] = steel.dof_modes[0].spring();
            (stiffness.unwrap_or(steel_stiffness), mass.unwrap_or(steel.mass))
        }
        (TineShape::Parts(_), stiffness, _) => {
            let name = if stiffness.is_none() { "stiffness_N_per_m" } else { "mass_kg" };
            let text = DiagnosticText {
                problem: format!("missing key `{name}`"),
                found: "a tine of `parts`".into(),
                expected: "`mount` with `stiffness_N_per_m` and `mass_kg`, or `rigid = true`"
                    .into(),
                hint: Some("only `blade_size_m` and `shaft_size_m` have a default mount".into()),
            };
            report.error(&format!("{key}.{name}"), text);
            return None;
        }
    };
    let damping = 2.0 * case.damping_ratio * (stiffness * mass).sqrt();
    Some(Mount::spring(mass, stiffness, damping))
}

/// Warns of keys that have no effect.
fn warn_unused<'n>(
    keys: impl Iterator<Item = (&'n str, bool)>,
    found: &str,
    key: &str,
    report: &mut DiagnosticReport,
) {
    for (name, _) in keys.filter(|(_, is_written)| *is_written) {
        let text = DiagnosticText {
            problem: format!("`{name}` has no effect"),
            found: found.into(),
            expected: format!("no `{name}`"),
            hint: None,
        };
        report.warn(&format!("{key}.{name}"), text);
    }
}

/// Returns the mount of a sleeper of these blocks, whose section is at `key`; `None` if it is invalid.
pub fn sleeper_mount(
    case: &MountSection,
    blocks: &[BlockPlan],
    is_lifted: bool,
    key: &str,
    report: &mut DiagnosticReport,
) -> Option<Mount> {
    if is_lifted && case.z == DofModeName::Free {
        let text = DiagnosticText {
            problem: "the lift cannot move a sleeper that is free in z".into(),
            found: "`z = \"free\"` and a tamped sleeper".into(),
            expected: "`z = \"prescribed\"` or `\"spring\"`, or a sleeper that is not tamped"
                .into(),
            hint: None,
        };
        report.error(&format!("{key}.z"), text);
        return None;
    }
    let build = |mass, dof_modes| track::sleeper_mount(blocks, mass, dof_modes);
    mount_with_modes(case, build, key, report)
}

/// Returns the mount of a plate of these boxes, whose section is at `key`; `None` if it is invalid.
pub fn plate_mount(
    case: &MountSection,
    boxes: &[PlateBox],
    key: &str,
    report: &mut DiagnosticReport,
) -> Option<Mount> {
    let build = |mass, dof_modes| track::plate_mount(boxes, mass, dof_modes);
    mount_with_modes(case, build, key, report)
}

/// Returns the mount that `build` makes of mass and modes of a section at `key`; `None` if it is invalid.
fn mount_with_modes(
    case: &MountSection,
    build: impl FnOnce(Option<f64>, [DofMode; 6]) -> Mount,
    key: &str,
    report: &mut DiagnosticReport,
) -> Option<Mount> {
    let modes = [case.x, case.y, case.z, case.rx, case.ry, case.rz];
    let springs = [
        ("translation", ["stiffness_N_per_m", "damping_N_s_per_m"], case.stiffness, case.damping),
        (
            "rotation",
            ["rotational_stiffness_N_m_per_rad", "rotational_damping_N_m_s_per_rad"],
            case.rotational_stiffness,
            case.rotational_damping,
        ),
    ];
    for ((what, names, stiffness, damping), modes) in springs.into_iter().zip(modes.chunks(3)) {
        let [name, _] = names;
        if !modes.contains(&DofModeName::Spring) {
            let unused = [stiffness.is_some(), damping != 0.0];
            let found = format!("no {what} with a spring");
            warn_unused(names.into_iter().zip(unused), &found, key, report);
        } else if stiffness.is_none() {
            let text = DiagnosticText {
                problem: format!("missing key `{name}`"),
                found: "a degree of freedom with a spring".into(),
                expected: format!("`{name}`: a number above 0"),
                hint: None,
            };
            report.error(&format!("{key}.{name}"), text);
            return None;
        }
    }
    let freedom = |(k, mode): (usize, DofModeName)| {
        let (_, _, stiffness, damping) = springs[k / 3];
        match mode {
            DofModeName::Prescribed => DofMode::Prescribed,
            DofModeName::Free => DofMode::Free,
            DofModeName::Spring => DofMode::Spring { stiffness: stiffness.unwrap_or(0.0), damping },
        }
    };
    let mut freedoms = [DofMode::Prescribed; 6];
    modes.into_iter().enumerate().for_each(|m| freedoms[m.0] = freedom(m));
    let mount = build(case.mass_kg, freedoms);
    let free = mount.free_dofs().count();
    if free == 0 || (free > 3 && !mount.has_isotropic_translations()) {
        let text = DiagnosticText {
            problem: "unsupported combination of modes".into(),
            found: format!("{free} degrees of freedom that are not prescribed"),
            expected: "one to three, or more with all translations free, or all with springs"
                .into(),
            hint: None,
        };
        report.error(key, text);
        return None;
    }
    Some(mount)
}
