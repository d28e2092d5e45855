//! Names: of the case, of sleepers and tines.

use crate::case_file::CaseFile;
use crate::layout::Layout;
use crate::report::{Finding, Report};
use std::collections::BTreeSet;

/// What a table adds to a body's name for the components of its force, `_x`, `_y` and `_z` after it; the places of a
/// body have these after its name alone.
const FORCE: &str = "_force";

/// Checks that names can be used in files and messages, and that no two bodies share one, or columns of a table.
pub fn names(case: &CaseFile, layout: &Layout, report: &mut Report) {
    usable("name", &case.name, report);
    let sleepers = layout.sleepers.iter().map(|s| (&s.key, &s.plan.name));
    let tines = layout.tines.iter().map(|t| (&t.key, &t.plan.name));
    // The names of the box's floor, ends and sides.
    let parts = ["floor", "wall_x_min", "wall_x_max", "wall_y_min", "wall_y_max"];
    let mut taken = BTreeSet::from(parts.map(String::from));
    let mut earlier: BTreeSet<&str> = BTreeSet::new();
    for (key, name) in sleepers.chain(tines) {
        let key = format!("{key}.name");
        usable(&key, name, report);
        // Topics have `_` for `-`.
        if !taken.insert(name.replace('-', "_")) {
            let finding = Finding {
                problem: "this name is taken".into(),
                found: format!("`{name}`"),
                expected: "a name that no other sleeper, tine or part of the box has, also with `_` for `-`"
                    .into(),
                hint: None,
            };
            report.error(&key, finding);
        } else if shares_columns(name, &earlier) {
            let finding = Finding {
                problem: "columns of this name are taken in tables".into(),
                found: format!("`{name}`"),
                expected: format!(
                    "a name that differs from that of each other sleeper and tine by more than `{FORCE}` at the end"
                ),
                hint: None,
            };
            report.error(&key, finding);
        }
        earlier.insert(name);
    }
}

/// Whether tables would have two columns of one name.
fn shares_columns(name: &str, earlier: &BTreeSet<&str>) -> bool {
    earlier.contains(&format!("{name}{FORCE}")[..])
        || name.strip_suffix(FORCE).is_some_and(|stem| earlier.contains(stem))
}

fn usable(key: &str, name: &str, report: &mut Report) {
    let fits = (1..=64).contains(&name.len())
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_' || c == '-');
    if !fits {
        let finding = Finding {
            problem: "this name cannot be used in files and messages".into(),
            found: crate::diagnostic::quoted(name),
            expected: "1 to 64 letters (a-z, A-Z), digits, `_` and `-`".into(),
            hint: None,
        };
        report.error(key, finding);
    }
}
