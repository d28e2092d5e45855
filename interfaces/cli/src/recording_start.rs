//! Where a recording begins: where the case does, or at the checkpoint that it holds.

use crate::case::Case;
use crate::exit::{Failure, Outcome};
use ballast::component::Parameters;
use ballast::model::Model;
use ballast::state::State;
use ballast_hdf5::checkpoint;
use ballast_mcap::recording::Windows;

/// Model and state at the beginning of `windows`; `model` and `state` are those of the case.
pub fn initial_scene(
    windows: &Windows,
    case: &Case,
    model: Model,
    state: State,
) -> Outcome<(Model, State)> {
    let Some(bytes) = windows.start() else {
        // What is damaged may have been the start.
        let begins_here =
            || windows.meta().initial_hash == ballast_hdf5::state_hash(&model, &state).into();
        return match windows.lost() {
            Some(lost) if !begins_here() => {
                let what = format!("it is damaged before its first window: {lost}");
                Err(Failure::at(windows.path(), what))
            }
            _ => Ok((model, state)),
        };
    };
    let saved = checkpoint::from_bytes(bytes);
    let saved = saved.map_err(|e| Failure::at(windows.path(), format!("its start: {e}")))?;
    if Parameters::are_only_difference(&model, &saved.model) {
        return Ok((saved.model, saved.state));
    }
    let name = &case.plan.name;
    let what = format!("it goes on in another case, bed or with another solver than {name}");
    Err(Failure::Mismatch(format!("{}: {what}", windows.path().display())))
}
