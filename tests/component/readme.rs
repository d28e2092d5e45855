//! Rust code of README, compiled and run.

use crate::{MS, floor, heap, shaken};
use ballast::drive::StepInputs;
use ballast::workspace::Workspace;

#[test]
fn a_step_and_windows_as_shown() -> Result<(), Box<dyn std::error::Error>> {
    use ballast::component::{Component, Limits, MotionInput, WindowStatus};
    use ballast::step::step;

    let given = heap(Limits::default());
    let (model, mut state) = (given.model().clone(), given.state().clone());
    let targets: Vec<_> = (0..model.driven.len()).map(|d| state.imposed(&model, d)).collect();
    let mut workspace = Workspace::default();
    let inputs = StepInputs { targets: &targets, loads: &[], speed_limit: None, zero_start: false };
    let report = step(&model, &mut state, &inputs, &mut workspace, &mut ())?;
    assert!(report.contacts > 0 && state.step == 1);

    let state = given.state().clone();
    let tine: MotionInput = shaken(floor(&given), 0, 5 * MS);
    let better_guess = tine.clone();
    let mut ballast = Component::new(model.into(), state, Limits::default())?;
    let result = ballast.advance_to(4_000_000, &[tine])?;
    assert_eq!(result.status, WindowStatus::Ok);
    if result.status == WindowStatus::Ok {
        let force = result.bodies[0].mean_force;
        assert!(force.z < 0.0, "{force}");
    }
    let repeated = ballast.redo(&[better_guess])?;
    assert_eq!(repeated.bodies, result.bodies);
    Ok(())
}

/// Every line of code that README shows is one of this file.
#[test]
fn what_is_shown_is_what_is_tested() {
    let code = |line: &str| line.split("//").next().unwrap_or_default().trim().to_string();
    let tested: Vec<_> = include_str!("readme.rs").lines().map(code).collect();
    let mut shown = 0;
    for block in include_str!("../../README.md").split("```rust").skip(1) {
        for line in block.split("```").next().unwrap_or_default().lines().map(code) {
            assert!(line.is_empty() || tested.contains(&line), "README shows {line:?}");
            shown += usize::from(!line.is_empty());
        }
    }
    assert!(shown > 5, "{shown}");
}
