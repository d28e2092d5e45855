//! Cases at the command line: from files and recordings, with what it chooses.

use crate::Reporter;
use crate::files::{Ours, ours, read_case, start_of};
use crate::{Failure, Result};
use ballast::component::{Component, Limits};
use ballast::model::Model;
use ballast::state::State;
pub use ballast_beds::Case;
use ballast_hdf5::checkpoint::Checkpoint;
use ballast_mcap::recording::Windows;
pub use ballast_scenario::CaseOverrides;
use ballast_scenario::MAX_CASE_BYTES;
use std::path::Path;
use std::sync::Arc;

/// Characters of a line that are told.
const LONGEST_LINE: usize = 100;

/// The note in a checkpoint that says which run of a served component it is of.
pub const RUN_ID: &str = "run_id";

/// Whether others drive the run that a checkpoint is of.
pub fn is_served(kept: &Checkpoint) -> bool {
    kept.extra.contains_key(RUN_ID)
}

/// Reads a case file; warnings go to the console.
pub fn load(path: &Path, choices: &CaseOverrides, console: &dyn Reporter) -> Result<Case> {
    let found = ours(&start_of(path, 64)).map(|ours| match ours {
        Ours::Sealed => "a checkpoint or a bed; `ballast resume` goes on from a checkpoint",
        Ours::Hdf5 => {
            "an HDF5 file, such as results; `ballast export` and `ballast inspect` read these"
        }
        Ours::Recording => "a recording; `ballast replay` and `ballast verify` read it",
    });
    if let Some(found) = found {
        let text = format!("{}: expected a case (TOML), found {found}", path.display());
        return Err(Failure::InvalidCase(text));
    }
    let text = read_case(path, MAX_CASE_BYTES)?;
    parse(text, &path.display().to_string(), choices, console)
}

/// The case of a recording of ours: that in the file, or the one that is given, with what the recorded run chose
/// where `choices` say nothing else.
pub fn recorded(
    windows: &Windows,
    given: Option<&Path>,
    choices: CaseOverrides,
    console: &dyn Reporter,
) -> Result<Case> {
    let meta = windows.meta();
    let choices = choices.or(CaseOverrides::from_notes(&meta.choices)?);
    match given {
        Some(path) => load(path, &choices, console),
        None => {
            // Whoever ran it was warned.
            let name = format!("{}, its case", windows.path().display());
            if meta.case_text.len() as u64 > MAX_CASE_BYTES {
                let size = meta.case_text.len();
                let text = format!("{name}: expected at most {MAX_CASE_BYTES} bytes, found {size}");
                return Err(Failure::InvalidCase(text));
            }
            Ok(Case::parse(meta.case_text.clone(), &name)?.with_overrides(choices))
        }
    }
}

/// Reads a case from its text; `name` is what messages call the file.
pub fn parse(text: String, name: &str, choices: &CaseOverrides, console: &dyn Reporter) -> Result<Case> {
    let case = Case::parse(text, name)?.with_overrides(*choices);
    case.warnings.iter().for_each(|warning| console.warning(&warning.to_string()));
    Ok(case)
}

/// The case as a component at `state`.
pub fn component(case: &Case, model: Arc<Model>, state: State) -> Result<Component> {
    case.component(model, state, Limits::default()).map_err(|e| invalid(case, e))
}

/// The first line in which two texts of a case differ.
pub fn first_other_line(recorded: &str, here: &str) -> Option<String> {
    // Not `lines`: ends of lines may be all that differs.
    let (mut a, mut b) = (recorded.split('\n'), here.split('\n'));
    let told = |line: Option<&str>| match line {
        Some(line) => format!("{:?}", line.chars().take(LONGEST_LINE).collect::<String>()),
        None => "none".into(),
    };
    (1..).find_map(|number| match (a.next(), b.next()) {
        (None, None) => Some(None),
        (x, y) if x == y => None,
        (x, y) => {
            Some(Some(format!("line {number} of the case: recorded {}, here {}", told(x), told(y))))
        }
    })?
}

/// A case that cannot be run.
pub fn invalid(case: &Case, what: impl std::fmt::Display) -> Failure {
    Failure::InvalidCase(format!("{}: {what}", case.plan.name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_line_that_differs_is_told() {
        let told = |a, b| first_other_line(a, b);
        assert_eq!(told("a\nb\n", "a\nb\n"), None);
        for (a, b, says) in [
            (
                "a\nb = 1\nc",
                "a\nb = 2\nd",
                "line 2 of the case: recorded \"b = 1\", here \"b = 2\"",
            ),
            ("a\n", "a\r\n", "line 1 of the case: recorded \"a\", here \"a\\r\""),
            ("a", "a\nb", "line 2 of the case: recorded none, here \"b\""),
            ("a\n", "a", "line 2 of the case: recorded \"\", here none"),
        ] {
            assert_eq!(told(a, b).unwrap(), says);
        }
        assert!(told(&"a".repeat(1 << 20), "").unwrap().len() < 200);
    }

    #[test]
    fn a_choice_that_is_not_known_is_of_another_version() {
        let notes = [("schedule".to_string(), "random".to_string())].into();
        assert_eq!(Failure::from(CaseOverrides::from_notes(&notes).unwrap_err()).code(), 6);
    }
}
