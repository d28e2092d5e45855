//! The same bytes on every kind of processor: what `scripts/aarch64.sh` compares.

use crate::bits;
use crate::common::heap;
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{Recovery, Schedule};

#[test]
#[ignore = "it prints what two machines have to agree on"]
fn a_shaken_heap() {
    for (schedule, boxes) in [(Schedule::Sequential, [1, 1, 1]), (Schedule::Synchronous, [2, 2, 1])]
    {
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
            let report = scene.step();
            if step % 100 == 0 {
                let mix = |sum: u64, x: u64| (sum ^ x).wrapping_mul(0x0000_0100_0000_01b3);
                let sum = bits(&scene.state).into_iter().fold(0xcbf2_9ce4_8422_2325, mix);
                let contacts = report.contacts;
                println!("shaken heap: {schedule:?}, step {step}, {contacts} contacts, {sum:016x}");
            }
        }
    }
}
