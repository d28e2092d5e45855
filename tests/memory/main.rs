//! No memory is asked for by a step's detection and solve, once they have been done before.
//!
//! One test only: whatever else ran in the process would be counted with it.

#[path = "../common/mod.rs"]
mod common;

use ballast::drive::StepInputs;
use ballast::model::Schedule;
use ballast::state::State;
use ballast::step::{Phase, StepObserver, step};
use common::heap;
use common::scene::{SCHEDULES, Scene};
use stats_alloc::{INSTRUMENTED_SYSTEM, StatsAlloc};
use std::alloc::System;

#[global_allocator]
static MEMORY: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Returns the number of allocations of all threads so far.
fn requests() -> usize {
    let stats = MEMORY.stats();
    stats.allocations + stats.reallocations
}

/// Requests of each phase of a step.
struct Count {
    before: usize,
    of: [usize; Phase::ALL.len()],
}

impl Count {
    fn of(&self, phases: [Phase; 2]) -> usize {
        phases.map(|phase| self.of[phase as usize]).iter().sum()
    }
}

impl StepObserver for Count {
    fn phase_finished(&mut self, phase: Phase) {
        let now = requests();
        self.of[phase as usize] += now - self.before;
        self.before = now;
    }
}

const DETECTION: [Phase; 2] = [Phase::BroadPhase, Phase::NarrowPhase];
/// The second one is a solve, too, and does not take place where a model has no recovery.
const SOLVE: [Phase; 2] = [Phase::Solve, Phase::PenetrationCorrection];

/// A step from `state` in the scene, counted.
fn count(scene: &mut Scene, state: &State) -> Count {
    scene.state.clone_from(state);
    let inputs = StepInputs { loads: &scene.loads, ..StepInputs::from_targets(&scene.targets) };
    let mut count = Count { before: requests(), of: Default::default() };
    step(&scene.model, &mut scene.state, &inputs, &mut scene.workspace, &mut count)
        .expect("a good step");
    count
}

/// A heap that collides, one that lies, and what is asked for in steps from both, first and later.
fn check(schedule: Schedule, threads: usize, iterations: u32, tolerance: Option<f64>) {
    let mut scene = heap::falling(6, 1_000_000).scheduled(schedule, [2, 2, 1]);
    scene.model.solver.max_iterations = 50;
    scene.model.solver.tolerance = None;
    let states = [250, 350].map(|steps| {
        (0..steps).for_each(|_| drop(scene.step()));
        scene.state.clone()
    });
    scene.model.solver.max_iterations = iterations;
    scene.model.solver.tolerance = tolerance;
    scene.workspace = Default::default();
    let what = format!("{schedule:?}, {threads} threads, {iterations} iterations, {tolerance:?}");

    let first = count(&mut scene, &states[0]);
    assert!(first.of(DETECTION) > 0 && first.of(SOLVE) > 0, "{what}: nothing is counted");
    // Far apart: the pair list is rebuilt in each step.
    for state in [1, 0, 1] {
        count(&mut scene, &states[state]);
    }
    for state in &states {
        let moved = count(&mut scene, state);
        assert_eq!(moved.of[Phase::BroadPhase as usize], 0, "{what}: pair list rebuilt");
        // Asynchronous sweeps end otherwise each time, and what they leave to be looked for again may be more than ever.
        let often = if schedule == Schedule::Asynchronous && threads > 1 { 5 } else { 1 };
        let again: Vec<Count> = (0..often).map(|_| count(&mut scene, state)).collect();
        let least = |phases| again.iter().map(|count| count.of(phases)).min();
        assert_eq!(least(DETECTION), Some(0), "{what}: detection");
        assert_eq!(least(SOLVE), Some(0), "{what}: solve");
    }
}

#[test]
fn a_step_done_before_asks_for_no_memory_in_detection_and_solve() {
    for threads in [1, 2, 4] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| {
            for schedule in SCHEDULES {
                check(schedule, threads, 50, None);
                // Out of reach: momentum, smaller visits and acceleration have their turn.
                check(schedule, threads, 1500, Some(1e-300));
            }
        });
    }
}
