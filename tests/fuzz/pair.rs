//! Pairs of polyhedra at any pose, against the oracle of the tests: separation, points, support.
#![no_main]
#![allow(
    dead_code,
    unused_imports,
    reason = "what the tests of detection share is more than is used here"
)]

#[path = "../detection/exactness.rs"]
mod exactness;
#[path = "../detection/oracle.rs"]
mod oracle;
#[path = "../detection/scene.rs"]
mod scene;

use ballast::geometry::{Polyhedron, convex_hull};
use ballast::math::{Pose, Quat, Vec3};
use libfuzzer_sys::fuzz_target;

/// Grid spacing of vertices, m: shapes of some centimetres with coplanar faces and parallel edges.
const STEP: f64 = 1e-3;
/// Maximum number of points of a shape; the oracle's work grows with their fourth power.
const MAX_POINTS: usize = 12;

fn vector(c: &[u8]) -> Vec3 {
    Vec3::new(c[0] as i8 as f64, c[1] as i8 as f64, c[2] as i8 as f64)
}

fn shape(bytes: &[u8]) -> Option<Polyhedron> {
    // Multiples of 4 mm: a hull without slivers, whose faces the oracle distinguishes.
    let points: Vec<Vec3> = bytes
        .chunks_exact(3)
        .map(|c| vector(c).map(|x| (x / 16.0).round()) * (4.0 * STEP))
        .collect();
    convex_hull(&points).ok().map(|(shape, _)| shape)
}

fn turn(c: &[u8]) -> Quat {
    // Half of them by nothing or by quarters: parallel axes.
    let axis = vector(c);
    match (c[3] % 4, axis.norm() > 0.0) {
        (2, true) => Quat::from_scaled_axis(axis.normalize() * (f64::from(c[3]) * 0.0245)),
        (1, _) => Quat::from_euler_angles(std::f64::consts::FRAC_PI_2, 0.0, 0.0),
        (3, _) => Quat::from_euler_angles(0.0, f64::from(c[0]) * 1e-9, f64::from(c[1]) * 1e-7),
        _ => Quat::identity(),
    }
}

fuzz_target!(|data: &[u8]| {
    let Some((head, rest)) = data.split_first_chunk::<12>() else { return };
    let (first, second) = rest.split_at(rest.len() / 2);
    let corners = |bytes: &[u8]| shape(&bytes[..bytes.len().min(3 * MAX_POINTS)]);
    let (Some(a), Some(b)) = (corners(first), corners(second)) else { return };
    let poses = [
        Pose { position: Vec3::zeros(), orientation: turn(&head[..4]) },
        Pose { position: vector(&head[8..11]) * (0.25 * STEP), orientation: turn(&head[4..8]) },
    ];
    exactness::check(&a, &b, poses, STEP, "fuzz");
});
