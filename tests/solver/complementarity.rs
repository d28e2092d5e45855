//! Complementarity gap of solved and of unsolved steps (T-44).

use crate::common::heap;
use crate::common::scene::tight;
use crate::on_threads;
use ballast::math::Vec3;
use ballast::model::{ContactStiffness, PartitionRule, Schedule, Solver};

/// Gap and infeasible part of a step after a given number of iterations, J: a heap at rest whose floor jumps.
fn after(iterations: u32, schedule: Schedule, stiffness: ContactStiffness) -> [f64; 2] {
    let mut scene = heap::falling(3, 1_000_000).scheduled(schedule, [2, 1, 2]);
    scene.model.grain_stiffness = stiffness;
    scene.model.driven.iter_mut().for_each(|body| body.stiffness = stiffness);
    scene.model.solver.max_iterations = 100;
    scene.run(0.3);
    scene.model.solver = Solver {
        tolerance: None,
        max_iterations: iterations,
        ..tight(schedule, PartitionRule::Boxes([2, 1, 2]))
    };
    scene.targets[0].position += Vec3::new(5e-4, 0.0, 1e-3);
    let report = scene.step();
    assert!(report.active_contacts > 50, "{report:?}");
    [report.complementarity.gap, report.complementarity.infeasible]
}

#[test]
fn the_gap_falls_with_the_iterations_and_is_zero_at_a_solution() {
    let springs = ContactStiffness { normal: 1e6, tangential_ratio: 0.5, damping_time: 1e-3 };
    for (stiffness, solved) in [(ContactStiffness::RIGID, 1e-4), (springs, 1e-9)] {
        for schedule in [Schedule::Sequential, Schedule::Synchronous] {
            let sums = [2, 50, 5000].map(|iterations| {
                let parts = after(iterations, schedule, stiffness);
                assert!(parts.iter().all(|&part| part >= 0.0), "{parts:?}");
                parts.iter().sum::<f64>()
            });
            let [cut, more, most] = sums;
            assert!(more < 0.2 * cut, "{schedule:?}, {stiffness:?}: {sums:?}");
            assert!(most < solved * cut, "{schedule:?}, {stiffness:?}: {sums:?}");
        }
    }
}

#[test]
fn the_gap_does_not_depend_on_the_threads() {
    for schedule in [Schedule::Sequential, Schedule::Synchronous] {
        let on = |threads| on_threads(threads, || after(10, schedule, ContactStiffness::RIGID));
        let one = on(1).map(f64::to_bits);
        for threads in [2, 4] {
            assert_eq!(one, on(threads).map(f64::to_bits), "{schedule:?}, {threads} threads");
        }
    }
}
