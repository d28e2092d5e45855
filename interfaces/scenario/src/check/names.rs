//! Names of the case, of sleepers, tines and plates.

use crate::case_file::CaseFile;
use crate::diagnostic::DiagnosticText;
use crate::layout::Layout;
use crate::report::DiagnosticReport;
use ballast::track::boundary::BOUNDARY_NAMES;
use std::collections::BTreeSet;

/// Suffix of a body's name in the table columns of its force. `_x`, `_y` or `_z` follows; columns of positions have these
/// directly after the name.
const FORCE_SUFFIX: &str = "_force";

/// Checks that names are usable in files and messages, and that no two bodies have the same name or table columns.
pub fn names(case: &CaseFile, layout: &Layout, report: &mut DiagnosticReport) {
    check_usable("name", &case.name, report);
    let sleepers = layout.sleepers.iter().map(|s| (&s.key, &s.plan.name));
    let tines = layout.tines.iter().map(|t| (&t.key, &t.plan.name));
    let plates = layout.plates.iter().map(|p| (&p.key, &p.plan.name));
    let mut taken: BTreeSet<String> = BOUNDARY_NAMES.map(String::from).into();
    let mut earlier: BTreeSet<&str> = BTreeSet::new();
    for (key, name) in sleepers.chain(tines).chain(plates) {
        let key = format!("{key}.name");
        check_usable(&key, name, report);
        // Names of topics have `_` in place of `-`.
        if !taken.insert(name.replace('-', "_")) {
            let text = DiagnosticText {
                problem: "this name is taken".into(),
                found: format!("`{name}`"),
                expected:
                    "a name that no other sleeper, tine, plate or wall has, also with `_` in place of `-`"
                        .into(),
                hint: None,
            };
            report.error(&key, text);
        } else if has_same_columns(name, &earlier) {
            let text = DiagnosticText {
                problem: "table columns of this name are taken".into(),
                found: format!("`{name}`"),
                expected: format!(
                    "a name that differs from that of each other sleeper, tine and plate by more than `{FORCE_SUFFIX}` at the end"
                ),
                hint: None,
            };
            report.error(&key, text);
        }
        earlier.insert(name);
    }
}

/// True if a table would have two columns with the same name.
fn has_same_columns(name: &str, earlier: &BTreeSet<&str>) -> bool {
    earlier.contains(&format!("{name}{FORCE_SUFFIX}")[..])
        || name.strip_suffix(FORCE_SUFFIX).is_some_and(|stem| earlier.contains(stem))
}

fn check_usable(key: &str, name: &str, report: &mut DiagnosticReport) {
    let fits = (1..=64).contains(&name.len())
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if !fits {
        let text = DiagnosticText {
            problem: "this name cannot be used in files and messages".into(),
            found: crate::diagnostic::quoted(name),
            expected: "1 to 64 letters (a-z, A-Z), digits, `_` and `-`".into(),
            hint: None,
        };
        report.error(key, text);
    }
}
