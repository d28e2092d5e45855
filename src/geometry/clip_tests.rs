//! Closed forms, Monte Carlo, additivity and differences.

use super::*;
use crate::geometry::{convex_hull, cuboid};
use crate::math::{Quat, rotation};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn axis_box(low: [f64; 3], high: [f64; 3]) -> AxisBox {
    AxisBox { low: low.into(), high: high.into() }
}

fn random_vector(rng: &mut Pcg64, size: f64) -> Vec3 {
    Vec3::from_fn(|_, _| rng.random_range(-size..size))
}

fn random_body(rng: &mut Pcg64) -> (Polyhedron, Pose) {
    let points: Vec<Vec3> = (0..24).map(|_| random_vector(rng, 0.03)).collect();
    let orientation = rotation::exp(&random_vector(rng, 2.0));
    (convex_hull(&points).unwrap().0, Pose { position: random_vector(rng, 1.0), orientation })
}

#[test]
fn cuts_of_a_cube_have_their_closed_forms() {
    let cube = cuboid(Vec3::repeat(0.5));
    let pose = Pose::at(Vec3::new(10.0, -3.0, 2.0));
    let mut clipper = Clipper::default();
    // A corner cut off at equal distances d from the corner.
    let n = Vec3::repeat(1.0).normalize();
    for d in [1e-3, 0.3, 1.0] {
        let corner = pose.position - Vec3::repeat(0.5);
        let offset = n.dot(&(corner + Vec3::x() * d));
        let volume = clipper.volume_inside(&cube, &pose, &[HalfSpace { normal: n, offset }]);
        assert!((volume - d * d * d / 6.0).abs() < 1e-14, "{volume}");
    }
    let half_box = axis_box([10.0, -9.0, 1.75], [11.0, 9.0, 2.0]);
    let volume = clipper.volume_inside(&cube, &pose, &half_box.half_spaces());
    assert!((volume - 0.125).abs() < 1e-15);
}

#[test]
fn wholly_inside_outside_and_touching_are_exact() {
    let cube = cuboid(Vec3::repeat(0.5));
    let mut clipper = Clipper::default();
    let pose = Pose::identity();
    let mut volume =
        |low, high| clipper.volume_inside(&cube, &pose, &axis_box(low, high).half_spaces());
    assert_eq!(volume([-0.5; 3], [0.5; 3]), 1.0);
    assert_eq!(volume([0.5, -1.0, -1.0], [2.0, 1.0, 1.0]), 0.0);
    assert_eq!(volume([0.6; 3], [0.7; 3]), 0.0);
    assert_eq!(volume([-9.0; 3], [9.0; 3]), 1.0);
    // A box beside a tilted body: its bounding sphere is cut, the body is not.
    let tilted = Pose { orientation: rotation::exp(&(Vec3::z() * 0.785)), ..pose };
    let beside = axis_box([0.6, 0.6, -1.0], [1.0, 1.0, 1.0]);
    assert_eq!(clipper.volume_inside(&cube, &tilted, &beside.half_spaces()), 0.0);
}

#[test]
fn boxes_of_a_grid_add_up_to_the_whole() {
    let mut rng = Pcg64::seed_from_u64(1);
    let mut clipper = Clipper::default();
    for case in 0..50 {
        let (body, pose) = random_body(&mut rng);
        // Every fifth body has corners and faces exactly on planes of the grid.
        let (body, pose) = if case % 5 == 0 {
            (cuboid(Vec3::new(0.02, 0.03, 0.04)), Pose::at(Vec3::repeat(0.5)))
        } else {
            (body, pose)
        };
        let (mut volume, n) = (0.0, 8);
        let at = |k: usize, axis: usize| pose.position[axis] + (k as f64 - 4.0) * 0.02;
        for i in 0..n * n * n {
            let (x, y, z) = (i % n, i / n % n, i / n / n);
            let low = Vec3::new(at(x, 0), at(y, 1), at(z, 2));
            let high = Vec3::new(at(x + 1, 0), at(y + 1, 1), at(z + 1, 2));
            let region = AxisBox { low, high };
            volume += clipper.volume_inside(&body, &pose, &region.half_spaces());
        }
        assert!((volume / body.volume - 1.0).abs() < 1e-12, "{case}: {}", volume / body.volume);
    }
}

#[test]
fn volumes_agree_with_monte_carlo() {
    let mut rng = Pcg64::seed_from_u64(2);
    let mut clipper = Clipper::default();
    for _ in 0..10 {
        let (body, pose) = random_body(&mut rng);
        let low = pose.position + random_vector(&mut rng, 0.02) - Vec3::repeat(0.015);
        let region = AxisBox { low, high: low + Vec3::new(0.03, 0.035, 0.04) };
        let faces = half_spaces_of(&body, &pose);
        let samples = 40_000;
        let hits = (0..samples)
            .filter(|_| {
                let x = Vec3::from_fn(|k, _| rng.random_range(region.low[k]..region.high[k]));
                faces.iter().all(|f| f.normal.dot(&x) <= f.offset)
            })
            .count();
        let share = clipper.volume_inside(&body, &pose, &region.half_spaces()) / region.volume();
        let sampled = hits as f64 / samples as f64;
        assert!(
            (share - sampled).abs() < 4.0 * (0.25 / samples as f64).sqrt(),
            "{share} {sampled}"
        );
    }
}

#[test]
fn volume_outside_overlapping_obstacles_is_counted_once() {
    let cube = cuboid(Vec3::repeat(0.5));
    let mut clipper = Clipper::default();
    let brick = |low, high| axis_box(low, high).half_spaces().to_vec();
    // Two bricks that overlap, one that touches, one far away.
    let obstacles = [
        brick([-0.4, -0.4, -0.4], [0.2, 0.2, 0.2]),
        brick([0.0, 0.0, 0.0], [0.4, 0.4, 0.4]),
        brick([-0.5, 0.2, -0.5], [-0.4, 0.5, 0.5]),
        brick([3.0, 3.0, 3.0], [4.0, 4.0, 4.0]),
    ];
    let turn = Quat::from_axis_angle(&nalgebra::Unit::new_normalize(Vec3::new(1.0, 2.0, 3.0)), 1.0);
    let pose = Pose { position: Vec3::new(0.3, 0.1, 0.7), orientation: turn };
    let turned: Vec<Vec<HalfSpace>> = obstacles
        .iter()
        .map(|o| {
            let place = |h: &HalfSpace| {
                let normal = pose.orientation * h.normal;
                HalfSpace { normal, offset: h.offset + normal.dot(&pose.position) }
            };
            o.iter().map(place).collect()
        })
        .collect();
    let expected = 1.0 - 0.216 - 0.064 + 0.008 - 0.03;
    let mut none = Vec::new();
    let plain = clipper.volume_outside(&cube, &Pose::identity(), &mut none, &obstacles);
    assert!((plain - expected).abs() < 1e-14, "{plain}");
    let moved = clipper.volume_outside(&cube, &pose, &mut none, &turned);
    assert!((moved - expected).abs() < 1e-14, "{moved}");
    assert!(none.is_empty());
}

#[test]
fn faces_of_obstacles_in_one_plane_do_not_depend_on_rounding() {
    // Bodies of boxes that touch or stand in a row: planes of one are planes of another, but for rounding once they are
    // turned.
    let bodies = [
        [([0.2, 0.05, 0.05], [0.2, 0.0, 0.05]), ([0.05, 0.05, 0.2], [0.05, 0.0, 0.3])],
        [([0.15, 0.2, 0.08], [0.0, -0.5, 0.08]), ([0.15, 0.2, 0.08], [0.0, 0.5, 0.08])],
    ];
    let whole = cuboid(Vec3::repeat(1.2));
    let mut rng = Pcg64::seed_from_u64(5);
    for body in bodies {
        let solid: f64 = body.iter().map(|(half, _)| 8.0 * half.iter().product::<f64>()).sum();
        for k in 0..400 {
            // Tilted a little, or turned anyhow.
            let angle = random_vector(&mut rng, if k % 2 == 0 { 0.05 } else { 2.0 });
            let pose =
                Pose { position: random_vector(&mut rng, 0.2), orientation: rotation::exp(&angle) };
            let obstacle = |(half, middle): ([f64; 3], [f64; 3])| {
                half_spaces_of(&cuboid(half.into()), &pose.then(&Pose::at(middle.into())))
            };
            let obstacles = body.map(obstacle);
            let outside = Clipper::default().volume_outside(
                &whole,
                &Pose::identity(),
                &mut Vec::new(),
                &obstacles,
            );
            let error = (outside - (13.824 - solid)).abs();
            assert!(error < 1e-12, "{angle:?}: {error} m³");
        }
    }
}

#[test]
fn reused_buffers_do_not_change_volumes() {
    let mut rng = Pcg64::seed_from_u64(9);
    let mut used = Clipper::default();
    for _ in 0..100 {
        let (body, pose) = random_body(&mut rng);
        let low = pose.position + random_vector(&mut rng, 0.03);
        let faces = AxisBox { low, high: low + Vec3::repeat(0.03) }.half_spaces();
        let fresh = Clipper::default().volume_inside(&body, &pose, &faces);
        assert_eq!(used.volume_inside(&body, &pose, &faces), fresh);
    }
}
