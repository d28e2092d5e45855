//! Parameters that change between windows.

use crate::{MS, floor, heap, shaken};
use ballast::component::{Limits, Parameters, WindowStatus};

#[test]
fn parameters_hold_from_the_next_window_on_and_for_a_redo() {
    let mut component = heap(Limits::default());
    let usual = component.parameters();
    assert_eq!((usual.iterations, usual.tolerance), (200, Some(1e-5)));
    let input = |t0, t1| [shaken(floor(&heap(Limits::default())), t0, t1)];
    let first = component.advance_to(20 * MS, &input(0, 20 * MS)).expect("a window");
    let hasty = Parameters { iterations: 3, tolerance: None, ..usual };
    component.set_parameters(&hasty).expect("sound ones");
    assert_eq!((component.parameters(), component.model().solver.max_iterations), (hasty, 3));
    let redone = component.redo(&input(0, 20 * MS)).expect("a redo");
    assert!(redone.solver.iterations == 60 && redone != first, "{:?}", redone.solver);
    // As if they had been so from the beginning.
    let mut other = heap(Limits::default());
    other.set_parameters(&hasty).expect("sound ones");
    assert_eq!(other.advance_to(20 * MS, &input(0, 20 * MS)).expect("a window"), redone);
    component.set_parameters(&usual).expect("sound ones");
    assert_eq!(component.redo(&input(0, 20 * MS)).expect("a redo"), first);
}

#[test]
fn parameters_that_cannot_be_used_change_nothing() {
    let mut component = heap(Limits::default());
    let usual = component.parameters();
    for (bad, place) in [
        (Parameters { iterations: 0, ..usual }, "solver.max_iterations"),
        (Parameters { tolerance: Some(-1.0), ..usual }, "solver.tolerance"),
        (Parameters { tolerance: Some(f64::NAN), ..usual }, "solver.tolerance"),
        (Parameters { penetration: 0.0, ..usual }, "penetration"),
        (Parameters { penetration: f64::NAN, ..usual }, "penetration"),
    ] {
        let refused = component.set_parameters(&bad).expect_err("no parameters").to_string();
        assert!(refused.contains(place), "{refused}");
        assert_eq!(component.parameters(), usual);
    }
    component.set_parameters(&Parameters { penetration: 1e-12, ..usual }).expect("a narrow limit");
    let outcome = component.advance_to(50 * MS, &[]).expect("a request in good form");
    assert_eq!(outcome.status, WindowStatus::Discard);
}
