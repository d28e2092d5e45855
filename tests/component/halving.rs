//! Resolution that the motion of a vibration needs: impulses on a tine against confined cubes, for windows of several
//! lengths and each interpolation. `cargo test --release --test component halving -- --nocapture` prints
//! the table of docs/src/coupling/windows.md.

use crate::MS;
use crate::modes::press;
use ballast::component::{Component, Interpolation, Knot, Limits, MotionInput, Waveform};
use ballast::math::{Pose, Vec3};
use ballast::model::Mount;
use std::f64::consts::TAU;
use std::slice::from_ref;

const US: u64 = 1000;
/// Impulses are compared over stretches of this length, a multiple of every window.
const STRETCH: u64 = 4 * MS;
/// Five periods.
const END: u64 = 144 * MS;
const AMPLITUDE: f64 = 5e-3;
const FREQUENCY: f64 = 35.0;

/// The mount of a tine of steel (0.75 MN/m, 2.9 kg) vibrates about 4 mm below where the tine touches; the
/// vibration grows within the first 20 ms.
fn knot(time_ns: u64) -> Knot {
    let (t, w) = (1e-9 * time_ns as f64, TAU * FREQUENCY);
    let s = (t / 0.02).min(1.0);
    let (grown, growth) = (s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s) / 0.02);
    let swing = -0.004 - AMPLITUDE * (w * t).sin();
    let z = grown * swing;
    let v = growth * swing - grown * AMPLITUDE * w * (w * t).cos();
    Knot {
        time_ns,
        pose: Pose::at(Vec3::z() * (crate::modes::TOP + z)),
        velocity: Vec3::z() * v,
        angular_velocity: Vec3::zeros(),
    }
}

/// Impulse on the tine in each stretch, N s.
fn impulses(interpolation: Interpolation, window_ns: u64) -> Vec<f64> {
    let mut scene = press(Mount::spring(2.9, 7.5e5, 600.0), 100 * US);
    scene.model.solver.tolerance = Some(1e-7);
    scene.model.solver.max_iterations = 500;
    let mut component =
        Component::new(scene.model.into(), scene.state, Limits::default()).expect("a press");
    let (mut all, mut sum) = (vec![], 0.0);
    while component.now_ns() < END {
        let t0 = component.now_ns();
        let t1 = t0 + window_ns;
        let knots = match interpolation {
            // What was last measured stands until the next measurement.
            Interpolation::Hold => vec![knot(t0)],
            _ => vec![knot(t0), knot(t1)],
        };
        let waveform = Waveform { interpolation, knots };
        let allow_jump = interpolation == Interpolation::Hold;
        let input = MotionInput { body: "tool".into(), waveform, allow_jump };
        sum += component.advance_to(t1, from_ref(&input)).expect("a window").bodies[0].impulse.z;
        if t1.is_multiple_of(STRETCH) {
            all.push(std::mem::take(&mut sum));
        }
    }
    all
}

/// Largest difference of a stretch over the largest impulse of one.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let largest = a.iter().fold(0.0, |l: f64, x| l.max(x.abs()));
    a.iter().zip(b).fold(0.0, |d: f64, (x, y)| d.max((x - y).abs())) / largest
}

#[test]
fn halving_the_window_changes_little_where_motions_are_cubic() {
    let windows = [4000, 2000, 1000, 500].map(|us| us * US);
    println!("window_us interpolation change_when_halved total_impulse_N_s");
    for interpolation in [Interpolation::Hermite, Interpolation::Linear, Interpolation::Hold] {
        let all = windows.map(|window| impulses(interpolation, window));
        for (pair, window) in all.windows(2).zip(windows) {
            let change = difference(&pair[0], &pair[1]);
            let total: f64 = pair[0].iter().sum();
            println!("{} {interpolation:?} {change:.3e} {total:.4}", window / US);
            match interpolation {
                Interpolation::Hermite => assert!(change < 0.01, "{window} ns: {change}"),
                Interpolation::Linear => {}
                Interpolation::Hold => assert!(change > 0.01, "{window} ns: {change}"),
            }
        }
        let largest = all[3].iter().fold(0.0, |l: f64, x| l.max(x.abs()));
        assert!(largest > 0.5 * 4e-3 * 7.5e5 * 4e-3, "the tine presses: {largest} N s");
    }
}
