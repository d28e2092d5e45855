//! Values of waveforms between their knots.

use crate::MS;
use ballast::component::{Interpolation, Knot, MotionInput, Waveform};
use ballast::math::{Pose, Quat, Vec3, rotation};
use std::f64::consts::TAU;

/// 35 Hz and 5 mm, a knot every millisecond: what a machine's controller sends.
fn vibration(interpolation: Interpolation) -> (Waveform, impl Fn(f64) -> f64) {
    let w = TAU * 35.0;
    let place = move |t: f64| 5e-3 * (w * t).sin();
    let knots = (0..=60).map(|k| {
        let t = 1e-3 * f64::from(k);
        Knot {
            time_ns: u64::from(k as u32) * MS,
            pose: Pose::at(Vec3::x() * place(t)),
            velocity: Vec3::x() * (5e-3 * w * (w * t).cos()),
            angular_velocity: Vec3::zeros(),
        }
    });
    (Waveform { interpolation, knots: knots.collect() }, place)
}

fn largest_error(interpolation: Interpolation) -> f64 {
    let (waveform, place) = vibration(interpolation);
    (0..60_000)
        .map(|us: u64| (waveform.pose(us * 1000).position.x - place(1e-6 * us as f64)).abs())
        .fold(0.0, f64::max)
}

#[test]
fn errors_of_a_vibration_are_those_of_the_theory() {
    // a ω⁴ Δ⁴ / 384, a ω² Δ² / 8, a ω Δ.
    let w = TAU * 35.0 * 1e-3;
    let expected = [5e-3 * w.powi(4) / 384.0, 5e-3 * w.powi(2) / 8.0, 5e-3 * w];
    for (interpolation, expected) in
        [Interpolation::Hermite, Interpolation::Linear, Interpolation::Hold]
            .into_iter()
            .zip(expected)
    {
        let found = largest_error(interpolation);
        assert!((0.9..1.01).contains(&(found / expected)), "{interpolation:?}: {found:e}");
    }
}

#[test]
fn a_held_vibration_jumps_and_a_cubic_one_does_not() {
    let steepest = |interpolation| {
        let (waveform, _) = vibration(interpolation);
        // The velocity that steps of 0.1 ms see, and its largest change.
        let speed = |k: u64| {
            let [a, b] = [k, k + 1].map(|k| waveform.pose(k * MS / 10).position.x);
            (b - a) / 1e-4
        };
        (0..598).map(|k| (speed(k + 1) - speed(k)).abs()).fold(0.0, f64::max)
    };
    assert!(steepest(Interpolation::Hold) > 10.0);
    // a ω² of a step of 0.1 ms.
    assert!(steepest(Interpolation::Hermite) < 1.01 * 5e-3 * (TAU * 35.0).powi(2) * 1e-4);
}

#[test]
fn a_steady_turn_stays_one() {
    let angular_velocity = Vec3::new(3.0, -2.0, 1.0);
    let start = Quat::from_scaled_axis(Vec3::new(0.3, 0.1, -0.4));
    let at = |t: f64| rotation::advance(&start, &(angular_velocity * t));
    let knot = |ms: u64| Knot {
        time_ns: ms * MS,
        pose: Pose { position: Vec3::zeros(), orientation: at(1e-3 * ms as f64) },
        velocity: Vec3::zeros(),
        angular_velocity,
    };
    for interpolation in [Interpolation::Linear, Interpolation::Hermite] {
        let waveform = Waveform { interpolation, knots: vec![knot(0), knot(200), knot(500)] };
        for ms in 0..=500 {
            let found = waveform.pose(ms * MS).orientation;
            assert!(found.angle_to(&at(1e-3 * ms as f64)) < 1e-14, "{interpolation:?} {ms}");
        }
    }
}

#[test]
fn a_turn_ends_with_the_spins_it_was_given() {
    let knot = |time_ns, angle: Vec3, angular_velocity| Knot {
        time_ns,
        pose: Pose { position: Vec3::zeros(), orientation: Quat::from_scaled_axis(angle) },
        velocity: Vec3::zeros(),
        angular_velocity,
    };
    for turn in [1e-5, 0.3, 1.9] {
        let (w0, w1) = (Vec3::new(1.0, 5.0, -2.0), Vec3::new(-4.0, 0.5, 3.0));
        let knots = vec![
            knot(0, Vec3::zeros(), w0),
            knot(100 * MS, Vec3::new(0.48, -0.6, 0.64) * turn, w1),
        ];
        let waveform = Waveform { interpolation: Interpolation::Hermite, knots };
        let angular_velocity = |from: u64, to: u64| {
            let turn = waveform.pose(to).orientation * waveform.pose(from).orientation.inverse();
            rotation::log(&turn) / (1e-9 * (to - from) as f64)
        };
        assert!((angular_velocity(0, 1000) - w0).norm() < 1e-2, "{turn}");
        assert!((angular_velocity(100 * MS - 1000, 100 * MS) - w1).norm() < 1e-2, "{turn}");
    }
}

#[test]
fn at_a_knot_the_pose_is_the_knot() {
    let (waveform, _) = vibration(Interpolation::Hermite);
    for knot in &waveform.knots {
        assert_eq!(waveform.pose(knot.time_ns), knot.pose);
    }
}

/// From knot to knot, across knots, between two of them, and beyond the last one.
#[test]
fn a_motion_that_is_cut_is_the_same_and_no_longer_than_it_must_be() {
    for interpolation in [Interpolation::Hermite, Interpolation::Linear, Interpolation::Hold] {
        let (waveform, _) = vibration(interpolation);
        let input = MotionInput { body: "tine".into(), waveform, allow_jump: true };
        for (from, to, knots) in
            [(20, 30, 2), (15, 30, 3), (21, 24, 2), (5, 595, 61), (598, 700, 2)]
        {
            let [from, to] = [from, to].map(|k: u64| k * MS / 10);
            let cut = input.cut(from, to);
            assert_eq!((&cut.body, cut.allow_jump), (&input.body, input.allow_jump));
            assert_eq!(cut.waveform.knots.len(), knots, "{interpolation:?} from {from} to {to} ns");
            for time in (from..=to).step_by(10_007) {
                assert_eq!(cut.waveform.pose(time), input.waveform.pose(time));
            }
        }
        assert!(input.cut(30 * MS, 20 * MS).waveform.knots.len() <= 2, "of no time at all");
    }
}
