//! The same bytes on every kind of processor.

use crate::bits;
use crate::common::heap;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{Recovery, Schedule};

/// What every machine makes of the heap, after each 100 steps. A change of results changes them.
const SUMS: [[u64; 6]; 2] = [
    [
        0xb2bb_17da_98fe_644a,
        0xffbd_12e7_617c_40ae,
        0xb411_6226_eab5_ed65,
        0x7c7d_e22f_7dd4_aaa3,
        0x3480_831d_601b_be0b,
        0x6a87_f675_f633_2471,
    ],
    [
        0xbc3f_bc44_5823_0f9f,
        0x794f_075c_0683_4aa6,
        0x3aa2_79b8_7865_1eb1,
        0xe825_3296_67d9_f500,
        0x2575_7146_8d85_35f4,
        0x62e9_8c82_6ef4_437a,
    ],
];

#[test]
fn a_shaken_heap_moves_to_the_same_bytes_on_every_machine() {
    let ways = [(Schedule::Sequential, [1, 1, 1]), (Schedule::Synchronous, [2, 2, 1])];
    let found = ways.map(|(schedule, boxes)| {
        let mut sums = Vec::new();
        let mut scene = heap::falling(6, 1_000_000).scheduled(schedule, boxes);
        scene.model.solver.iterations = 200;
        scene.model.solver.tolerance = Some(1e-5);
        scene.model.solver.recovery = Some(Recovery { share: 0.1, allowed: 1e-5, iterations: 20 });
        let rest = scene.targets[0];
        for step in 1..=600 {
            let t = 1e-3 * f64::from(step);
            let turn = Quat::from_scaled_axis(Vec3::x() * (0.01 * (20.0 * t).sin()));
            scene.targets[0] = Pose {
                position: rest.position + Vec3::z() * (2e-3 * (1.0 - (60.0 * t).cos())),
                orientation: turn * rest.orientation,
            };
            scene.step();
            if step % 100 == 0 {
                let mix = |sum: u64, x: u64| (sum ^ x).wrapping_mul(0x0000_0100_0000_01b3);
                sums.push(bits(&scene.state).into_iter().fold(0xcbf2_9ce4_8422_2325, mix));
            }
        }
        sums
    });
    assert_eq!(found, SUMS, "{found:#018x?}");
}
