//! Restored = never interrupted.

use crate::common::heap;
use crate::common::scene::{SCHEDULES, Scene};
use crate::{bits, on_threads};

fn heap_of(schedule: ballast::model::Schedule) -> Scene {
    let mut scene = heap::falling(3, 1_000_000).scheduled(schedule, [2, 2, 1]);
    scene.model.solver.max_iterations = 30;
    scene
}

#[test]
fn a_clone_with_a_fresh_workspace_continues_with_the_same_bytes() {
    for schedule in SCHEDULES {
        // One thread: there even the asynchronous order is fixed.
        on_threads(1, || {
            let mut scene = heap_of(schedule);
            scene.run(0.12);
            let checkpoint = scene.state.clone();
            scene.run(0.12);
            let uninterrupted = bits(&scene.state);

            let mut resumed = heap_of(schedule);
            resumed.state = checkpoint;
            resumed.run(0.12);
            assert!(uninterrupted == bits(&resumed.state), "{schedule:?}");
        });
    }
}

#[test]
fn a_workspace_used_on_another_state_leaves_no_trace() {
    let mut scene = heap_of(SCHEDULES[1]);
    scene.run(0.15);
    let checkpoint = scene.state.clone();
    scene.run(0.01);
    let first = bits(&scene.state);
    // Redo with the workspace as it is, then with one that has seen a heap of another size.
    scene.state = checkpoint.clone();
    scene.run(0.01);
    assert!(first == bits(&scene.state), "redone with the same workspace");
    let mut other = heap::falling(1, 500_000);
    other.run(0.1);
    scene.workspace = std::mem::take(&mut other.workspace);
    scene.state = checkpoint;
    scene.run(0.01);
    assert!(first == bits(&scene.state), "with a workspace from elsewhere");
}

#[test]
fn warm_start_is_part_of_the_state() {
    // Otherwise the restart checks above would not notice its loss.
    let mut scene = heap_of(SCHEDULES[0]);
    scene.run(0.2);
    assert!(scene.state.contacts.impulse.iter().any(|f| f.norm() > 0.0));
    let mut forgetful = scene.state.clone();
    forgetful.contacts = Default::default();
    scene.step();
    let remembered = bits(&scene.state);
    scene.state = forgetful;
    scene.state.contacts = Default::default();
    scene.step();
    assert!(remembered != bits(&scene.state));
}
