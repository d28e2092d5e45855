//! Contacts over a whole tamping cycle: caches of the detection do not change them.

use ballast::detection::Contacts;
use ballast::drive::StepInputs;
use ballast::step::step;
use ballast::track::{TampingCycle, TampingState, deposit::deposit, scene::scene};
use ballast::workspace::Workspace;
use ballast_scenario::read_case;
use std::collections::BTreeSet;
use std::ops::ControlFlow;

/// Returns the first difference between two sets of contacts.
fn difference(a: &Contacts, b: &Contacts) -> Option<String> {
    let row = |c: &Contacts, k: usize| {
        (k < c.len()).then(|| (c.bodies[k], c.feature[k], c.point[k], c.normal[k], c.gap[k]))
    };
    let k = (0..a.len().max(b.len())).find(|&k| row(a, k) != row(b, k))?;
    Some(format!("contact {k}: {:?} and from scratch {:?}", row(a, k), row(b, k)))
}

#[test]
fn a_whole_cycle_has_the_contacts_of_a_detection_without_caches() {
    let text = include_str!("../../../../examples/first.toml");
    let mut plan = read_case(text, "first").unwrap_or_else(|e| panic!("{e}")).plan;
    // What is found does not depend on how well it is solved.
    plan.run.solver.max_iterations = 40;
    let watch = &mut |_: &_| ControlFlow::Continue(());
    let bed = deposit(&plan, watch).expect("a bed").expect("not stopped");
    let (model, mut state) = scene(&plan, bed).expect("a track");
    let cycle = TampingCycle::new(&plan, &model).expect("a cycle");
    let (mut workspace, mut targets) = (Workspace::default(), Vec::new());
    let mut tamping = TampingState::default();
    let (mut phases, mut repeated) = (BTreeSet::new(), 0);
    while state.time_ns < plan.run.duration_ns {
        phases.insert(cycle.phase(state.time()).name());
        cycle.targets(&model, &state, &tamping, &mut targets);
        let inputs = StepInputs::from_targets(&targets);
        let (mut scratch, mut fresh) = (state.clone(), Workspace::default());
        step(&model, &mut scratch, &inputs, &mut fresh, &mut ()).expect("a good step");
        let report =
            step(&model, &mut state, &inputs, &mut workspace, &mut ()).expect("a good step");
        assert_eq!(difference(&workspace.contacts, &fresh.contacts), None, "step {}", state.step);
        assert!(state == scratch, "step {}: other states", state.step);
        repeated += report.solve_passes - 1;
        cycle.observe(&model, &report, &state, &mut tamping);
    }
    assert_eq!(phases.len(), 5, "{phases:?}");
    assert!(repeated > 20, "hardly a step looked twice: {repeated}");
}
