//! Identical bytes on every kind of processor and system; the scene's motion uses no system sine either.

use crate::bits;
use crate::common::heap;
use crate::common::scene::Random;
use ballast::math::{Pose, Vec3, rotation};
use ballast::model::{PenetrationCorrection, Schedule};

/// Hashes of the heap after each 100 steps, equal on every machine. A change of results changes them.
const SUMS: [[u64; 6]; 2] = [
    [
        0xa562_a1f2_a3c7_9c88,
        0x44b6_ea83_3bb1_03f4,
        0xd69f_a085_e69f_25e1,
        0xee87_1c34_8072_4295,
        0xe6e4_9ee1_9af9_b729,
        0xf2a5_443b_3c17_c85a,
    ],
    [
        0x4f07_fcd9_e9fd_cfbf,
        0x289d_6540_b0a5_a8c9,
        0xbe63_a7eb_54a1_7896,
        0xcc85_2b8d_d855_13c0,
        0x802a_4111_4a84_69c5,
        0x1ef2_9e05_3eb0_07f3,
    ],
];

/// Hash of the bits of rotations up to half a turn and back.
const ROTATIONS: u64 = 0x8b55_dcae_f775_afb6;

fn mix(sum: u64, x: u64) -> u64 {
    (sum ^ x).wrapping_mul(0x0000_0100_0000_01b3)
}

#[test]
fn rotations_are_the_same_bytes_on_every_machine() {
    let mut random = Random(11);
    let mut sum = 0xcbf2_9ce4_8422_2325;
    for _ in 0..100_000 {
        let turn = rotation::exp(&(random.direction() * (3.0 * random.next())));
        let back = rotation::log(&turn);
        let angular_velocity = rotation::angular_velocity_from_rate(
            &back,
            &rotation::rotation_vector_rate(&back, &Vec3::x()),
        );
        sum = turn
            .coords
            .iter()
            .chain(&back)
            .chain(&angular_velocity)
            .map(|x| x.to_bits())
            .fold(sum, mix);
    }
    assert_eq!(sum, ROTATIONS, "{sum:#018x}");
}

#[test]
fn a_shaken_heap_moves_to_the_same_bytes_on_every_machine() {
    let ways = [(Schedule::Sequential, [1, 1, 1]), (Schedule::Synchronous, [2, 2, 1])];
    let found = ways.map(|(schedule, boxes)| {
        let mut sums = Vec::new();
        let mut scene = heap::falling(6, 1_000_000).scheduled(schedule, boxes);
        scene.model.solver.max_iterations = 200;
        scene.model.solver.tolerance = Some(1e-5);
        scene.model.solver.penetration_correction =
            Some(PenetrationCorrection { factor: 0.1, slop: 1e-5, iterations: 20 });
        let rest = scene.targets[0];
        for step in 1..=600 {
            let t = 1e-3 * f64::from(step);
            let turn = rotation::exp(&(Vec3::x() * (0.01 * libm::sin(20.0 * t))));
            scene.targets[0] = Pose {
                position: rest.position + Vec3::z() * (2e-3 * (1.0 - libm::cos(60.0 * t))),
                orientation: turn * rest.orientation,
            };
            scene.step();
            if step % 100 == 0 {
                sums.push(bits(&scene.state).into_iter().fold(0xcbf2_9ce4_8422_2325, mix));
            }
        }
        sums
    });
    assert_eq!(found, SUMS, "{found:#018x?}");
}
