//! Cases from files and recordings, with the choices of the command line.

use crate::Reporter;
use crate::files::{FileKind, file_kind, read_case, start_of};
pub use crate::run_files::{RUN_ID, is_served};
use crate::{Failure, Result};
use ballast::component::{Component, Limits};
use ballast::model::Model;
use ballast::state::State;
pub use ballast_beds::Case;
use ballast_mcap::recording::WindowReader;
pub use ballast_scenario::CaseOverrides;
use ballast_scenario::MAX_CASE_BYTES;
use std::path::Path;
use std::sync::Arc;

/// Maximum number of characters of a line in messages.
const MAX_SHOWN_CHARACTERS: usize = 100;

/// Reads a case file and reports its warnings.
///
/// # Errors
/// A file that cannot be read or is no valid case.
pub fn load(path: &Path, choices: &CaseOverrides, console: &dyn Reporter) -> Result<Case> {
    let found = file_kind(&start_of(path, 64)).map(|kind| match kind {
        FileKind::Sealed => {
            "a checkpoint or a bed; continue from a checkpoint with `ballast resume`"
        }
        FileKind::Hdf5 => {
            "an HDF5 file, such as results; read it with `ballast export` or `ballast inspect`"
        }
        FileKind::Recording => "a recording; read it with `ballast replay` or `ballast verify`",
    });
    if let Some(found) = found {
        let text = format!("{}: expected a case (TOML), found {found}", path.display());
        return Err(Failure::InvalidCase(text));
    }
    let text = read_case(path, MAX_CASE_BYTES)?;
    parse(text, &path.display().to_string(), choices, console)
}

/// Returns the case of a recording made by Ballast: the stored one or the file `given`, with the choices of the recorded run
/// where `choices` has none.
///
/// # Errors
/// A case that cannot be read or is invalid.
pub fn recorded(
    windows: &WindowReader,
    given: Option<&Path>,
    choices: CaseOverrides,
    console: &dyn Reporter,
) -> Result<Case> {
    let meta = windows.meta();
    let choices = choices.or(CaseOverrides::from_notes(&meta.overrides)?);
    match given {
        Some(path) => load(path, &choices, console),
        None => {
            // The recorded run has reported the warnings.
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

/// Reads a case from its text and reports its warnings; `name` is the name of the file in messages.
///
/// # Errors
/// A text that is no valid case.
pub fn parse(
    text: String,
    name: &str,
    choices: &CaseOverrides,
    console: &dyn Reporter,
) -> Result<Case> {
    let case = Case::parse(text, name)?.with_overrides(*choices);
    case.warnings.iter().for_each(|warning| console.warning(&warning.to_string()));
    Ok(case)
}

/// Creates the component of a case at `state`.
///
/// # Errors
/// A state that does not fit the case.
pub fn component(case: &Case, model: Arc<Model>, state: State) -> Result<Component> {
    case.component(model, state, Limits::default()).map_err(|e| invalid(case, e))
}

/// Returns a description of the first line in which two texts of a case differ.
pub fn first_other_line(recorded: &str, here: &str) -> Option<String> {
    // `lines` would hide differences in line ends.
    let (mut a, mut b) = (recorded.split('\n'), here.split('\n'));
    let shown = |line: Option<&str>| match line {
        Some(line) => format!("{:?}", line.chars().take(MAX_SHOWN_CHARACTERS).collect::<String>()),
        None => "none".into(),
    };
    (1..).find_map(|number| match (a.next(), b.next()) {
        (None, None) => Some(None),
        (x, y) if x == y => None,
        (x, y) => Some(Some(format!(
            "line {number} of the case: recorded {}, here {}",
            shown(x),
            shown(y)
        ))),
    })?
}

/// Creates the failure of a case that cannot be run.
pub fn invalid(case: &Case, what: impl std::fmt::Display) -> Failure {
    Failure::InvalidCase(format!("{}: {what}", case.plan.name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_different_line_is_described() {
        let difference = |a, b| first_other_line(a, b);
        assert_eq!(difference("a\nb\n", "a\nb\n"), None);
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
            assert_eq!(difference(a, b).unwrap(), says);
        }
        assert!(difference(&"a".repeat(1 << 20), "").unwrap().len() < 200);
    }

    #[test]
    fn unknown_choice_belongs_to_another_version() {
        let notes = [("schedule".to_string(), "random".to_string())].into();
        assert_eq!(Failure::from(CaseOverrides::from_notes(&notes).unwrap_err()).code(), 6);
    }
}
