//! Identical bytes for any number of threads, schedule by schedule.

use crate::common::heap;
use crate::{bits, on_threads};
use ballast::model::{PenetrationCorrection, Schedule};

/// A heap that falls, collides and comes to lie, with the interface in three directions.
fn fallen(
    schedule: Schedule,
    recovery: Option<PenetrationCorrection>,
    threads: usize,
) -> (Vec<u64>, usize) {
    on_threads(threads, || {
        let mut scene = heap::falling(4, 1_000_000).scheduled(schedule, [2, 2, 2]);
        scene.model.solver.max_iterations = 50;
        scene.model.solver.penetration_correction = recovery;
        let mut interface = 0;
        for _ in 0..250 {
            interface += scene.step().interface_contacts;
        }
        (bits(&scene.state), interface)
    })
}

#[test]
fn sequential_runs_do_not_depend_on_the_threads() {
    let (one, _) = fallen(Schedule::Sequential, None, 1);
    for threads in [2, 4] {
        assert!(one == fallen(Schedule::Sequential, None, threads).0, "{threads} threads differ");
    }
}

#[test]
fn synchronous_runs_do_not_depend_on_the_threads() {
    for recovery in [None, Some(PenetrationCorrection::default())] {
        let (one, interface) = fallen(Schedule::Synchronous, recovery, 1);
        assert!(interface > 1000, "the interface is hardly used: {interface}");
        for threads in [2, 4] {
            let other = fallen(Schedule::Synchronous, recovery, threads).0;
            assert!(one == other, "{threads} threads differ, {recovery:?}");
        }
    }
}

#[test]
fn the_comparison_sees_a_last_bit() {
    let mut scene = heap::falling(1, 1_000_000);
    let before = bits(&scene.state);
    scene.state.angular_velocity[3].y = f64::from_bits(1);
    assert!(before != bits(&scene.state));
}
