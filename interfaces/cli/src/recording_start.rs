//! Initial state of a recording: the start of the case, or the checkpoint that the recording holds.

use crate::case::{Case, CaseOverrides};
use ballast::component::Parameters;
use ballast::model::Model;
use ballast::state::State;
use ballast_hdf5::checkpoint::{self, Checkpoint};
use ballast_mcap::recording::WindowReader;
use ballast_session::{Failure, Result};

/// Model and state at the beginning of `windows`; `model` and `state` are those of the case.
pub fn initial_scene(
    windows: &WindowReader,
    case: &Case,
    model: Model,
    state: State,
) -> Result<(Model, State)> {
    let Some(bytes) = windows.start() else {
        // What is damaged may have been the start.
        let begins_here =
            || windows.meta().initial_hash == ballast_hdf5::state_hash(&model, &state).into();
        return match windows.truncation() {
            Some(lost) if !begins_here() => {
                let what = format!("it is damaged before its first window: {lost}");
                Err(Failure::at(windows.path(), what))
            }
            _ => Ok((model, state)),
        };
    };
    let saved = saved(windows, bytes)?;
    if Parameters::are_only_difference(&model, &saved.model) {
        return Ok((saved.model, saved.state));
    }
    Err(other_case(windows, case))
}

/// Checks that a recording that holds its start belongs to `case`, before the bed is prepared; `model` is that of the case
/// without grains.
pub fn check_case(windows: &WindowReader, case: &Case, model: &Model) -> Result {
    let Some(bytes) = windows.start() else { return Ok(()) };
    let saved = saved(windows, bytes)?;
    let name = format!("{}, its case", windows.path().display());
    let recorded = Case::parse(saved.case_text, &name)?;
    let plan = recorded.with_overrides(CaseOverrides::from_notes(&saved.extra)?).plan;
    let (recorded, _) = ballast_beds::empty_scene(&plan)?;
    // Grains are compared by what makes them.
    let (here, there) = (&case.plan.bed, &plan.bed);
    let has_same_grains =
        (&here.grains, here.seed, here.density) == (&there.grains, there.seed, there.density);
    if has_same_grains && Parameters::are_only_difference(model, &recorded) {
        return Ok(());
    }
    Err(other_case(windows, case))
}

fn saved(windows: &WindowReader, bytes: &[u8]) -> Result<Checkpoint> {
    let saved = checkpoint::from_bytes(bytes);
    saved.map_err(|e| Failure::at(windows.path(), format!("its start: {e}")))
}

fn other_case(windows: &WindowReader, case: &Case) -> Failure {
    let name = &case.plan.name;
    let what = format!("it continues in another case or bed, or with another solver, than {name}");
    Failure::Mismatch(format!("{}: {what}", windows.path().display()))
}
