//! A window is ended within a step, however long that takes.

use crate::{MS, heap, heap_scheduled, same};
use ballast::component::{
    Component, Limits, Parameters, Refusal, StopReason, WindowResult, WindowStatus,
};
use ballast::model::Schedule;
use ballast::step::{Phase, StepObserver};
use std::thread::{self, ThreadId};

/// Observer that ends a window during the step after `steps` complete ones.
struct After {
    steps: u64,
    stop: StopReason,
}

impl StepObserver for After {
    fn phase_finished(&mut self, phase: Phase) {
        self.steps = self.steps.saturating_sub(u64::from(phase == Phase::Store));
    }
    fn cancelled(&mut self) -> Option<StopReason> {
        (self.steps == 0).then_some(self.stop)
    }
}

fn advance(
    component: &mut Component,
    watch: &mut impl StepObserver,
) -> Result<WindowResult, Refusal> {
    let t1 = component.now_ns() + 10 * MS;
    component.advance_observed(t1, &[], watch)
}

/// Lets no step end any more.
fn never_solve(component: &mut Component) {
    let endless =
        Parameters { iterations: u32::MAX, tolerance: Some(1e-300), ..component.parameters() };
    component.set_parameters(&endless).expect("parameters");
}

/// Stops when it is asked by the thread that has asked for the step.
struct ByCaller(ThreadId);

impl StepObserver for ByCaller {
    fn cancelled(&mut self) -> Option<StopReason> {
        (thread::current().id() == self.0).then_some(StopReason::Discard)
    }
}

#[test]
fn the_thread_that_asks_for_a_step_is_asked_itself_however_many_work() {
    for schedule in Schedule::ALL {
        for threads in [1, 2, 4] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let outcome = pool.install(|| {
                let mut component = heap_scheduled(Limits::default(), schedule);
                never_solve(&mut component);
                let mut caller = ByCaller(thread::current().id());
                advance(&mut component, &mut caller).expect("a window")
            });
            assert_eq!(outcome.status, WindowStatus::Discard, "{schedule:?}, {threads}");
        }
    }
}

#[test]
fn a_step_that_would_never_end_is_broken_off_by_any_schedule() {
    for schedule in Schedule::ALL {
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let begun = || heap_scheduled(Limits::default(), schedule);
            let mut component = pool.install(begun);
            let settled = component.parameters();
            never_solve(&mut component);
            let before = component.save();
            for stop in [StopReason::Discard, StopReason::Early] {
                let mut at_once = After { steps: 0, stop };
                let outcome =
                    pool.install(|| advance(&mut component, &mut at_once)).expect("a window");
                // No step was done that could be kept.
                assert_eq!((outcome.status, outcome.steps), (WindowStatus::Discard, 0));
                assert!(outcome.error.is_none() && component.save() == before);
            }
            let mut at_once = After { steps: 0, stop: StopReason::Cancel };
            let refusal = pool.install(|| advance(&mut component, &mut at_once)).unwrap_err();
            assert_eq!((refusal.code(), component.save()), ("cancelled", before));
            // Nothing of it is left behind.
            component.set_parameters(&settled).expect("parameters");
            let mut fresh = pool.install(begun);
            let now = component.now_ns();
            for component in [&mut component, &mut fresh] {
                pool.install(|| component.advance_to(now + MS, &[])).expect("a window");
            }
            let is_ordered = schedule != Schedule::Asynchronous || threads == 1;
            assert!(!is_ordered || same(component.state(), fresh.state()), "{schedule:?}");
        }
    }
}

#[test]
fn steps_before_the_one_that_is_broken_off_are_kept() {
    let mut component = heap(Limits::default());
    let outcome = advance(&mut component, &mut After { steps: 3, stop: StopReason::Early })
        .expect("a window");
    assert_eq!((outcome.status, outcome.steps), (WindowStatus::Early, 3));
    let mut other = heap(Limits::default());
    other.advance_to(3 * MS, &[]).expect("a window");
    assert!(same(component.state(), other.state()));
}
