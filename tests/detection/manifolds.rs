//! Number and positions of contact points: stacks, large faces, half-spaces.

use crate::scene;
use ballast::detection::Contacts;
use ballast::geometry::{Polyhedron, convex_hull, cuboid};
use ballast::math::{Pose, Quat, Vec3};
use ballast::model::{ContactStiffness, DrivenBody, Part, Role};
use std::f64::consts::PI;

fn two(a: &Polyhedron, b: &Polyhedron, pose: Pose, alert: f64) -> Contacts {
    let model = scene::model(vec![a.clone(), b.clone()], vec![], alert);
    scene::fresh(&model, &scene::at_rest(&[Pose::identity(), pose]))
}

/// Area of the points' hull seen from above.
fn area(points: &[Vec3]) -> f64 {
    let centre = points.iter().sum::<Vec3>() / points.len() as f64;
    let mut around: Vec<Vec3> = points.iter().map(|p| p - centre).collect();
    around.sort_by(|p, q| p.y.atan2(p.x).total_cmp(&q.y.atan2(q.x)));
    let next = |k: usize| &around[(k + 1) % around.len()];
    0.5 * (0..around.len()).map(|k| around[k].x * next(k).y - around[k].y * next(k).x).sum::<f64>()
}

#[test]
fn stacked_cuboids_touch_in_four_points_whatever_rounding_does() {
    let shape = cuboid(Vec3::new(0.02, 0.03, 0.01));
    for gap in [-1e-4, -1e-9, -1e-15, 0.0, 1e-15, 1e-9, 5e-4] {
        for angle in [0.0, 1e-15, 1e-12, 0.3, 0.5 * PI] {
            for tilt in [0.0, 1e-14] {
                let turn = Quat::from_euler_angles(tilt, tilt, angle);
                let pose = Pose { position: Vec3::new(1e-3, 0.0, 0.02 + gap), orientation: turn };
                let c = two(&shape, &shape, pose, 1e-3);
                assert_eq!(c.len(), 4, "gap {gap:e}, angle {angle:e}, tilt {tilt:e}: {c:?}");
                for k in 0..4 {
                    // From the antagonist above to the candidate below.
                    assert!((c.normal[k] + Vec3::z()).norm() < 1e-9);
                    assert!((c.gap[k] - gap).abs() < 1e-12);
                    assert!((c.point[k].z - 0.01 - 0.5 * gap).abs() < 1e-12);
                }
                assert!(area(&c.point) > 0.5 * 0.04 * 0.04, "{}", area(&c.point));
            }
        }
    }
}

/// A box that leans on a box, less than the alert distance along its length, is held all around.
#[test]
fn leaning_cuboids_touch_in_four_points() {
    let shape = cuboid(Vec3::new(0.02, 0.03, 0.01));
    for lean in [1e-6, 1e-4, 1e-3, 1e-2] {
        for about in [Vec3::x(), Vec3::y(), Vec3::new(0.6, 0.8, 0.0), Vec3::new(-0.8, 0.6, 0.0)] {
            for angle in [0.0, 0.3] {
                let turn =
                    Quat::from_scaled_axis(about * lean) * Quat::from_euler_angles(0.0, 0.0, angle);
                let pose = Pose { position: Vec3::new(1e-3, 0.0, 0.02), orientation: turn };
                let c = two(&shape, &shape, pose, 1e-3);
                let told = || format!("lean {lean:e} about {about:?}, angle {angle}: {c:?}");
                assert_eq!(c.len(), 4, "{}", told());
                assert!(area(&c.point) > 0.5 * 0.04 * 0.04, "{}", told());
                let depth = c.gap.iter().fold(0.0, |d: f64, g| d.max(-g));
                assert!(depth > 0.0 && c.gap.iter().all(|g| *g < 1e-3), "{}", told());
            }
        }
    }
}

/// Identities stay while the same features touch, and one of them stays the deepest.
#[test]
fn features_survive_a_small_motion() {
    let shape = cuboid(Vec3::new(0.02, 0.03, 0.01));
    let at = |k: f64| {
        let turn = Quat::from_euler_angles(1e-5 + 1e-7 * k, -2e-5 - 2e-7 * k, 0.3 + 1e-6 * k);
        let position = Vec3::new(1e-3 + 1e-6 * k, 0.0, 0.02 - 1e-7 * k);
        two(&shape, &shape, Pose { position, orientation: turn }, 1e-3).feature
    };
    let first = at(0.0);
    assert_eq!(first.len(), 4);
    (1..5).for_each(|k| assert_eq!(at(f64::from(k)), first));
}

/// Nor does rounding change them where all points are equally deep.
#[test]
fn features_survive_rounding() {
    let shape = cuboid(Vec3::new(0.02, 0.03, 0.01));
    let at = |k: f64| {
        let turn = Quat::from_euler_angles(1e-14 * k, -2e-14 * k, 0.3);
        let position = Vec3::new(1e-15 * k, 0.0, 0.02);
        two(&shape, &shape, Pose { position, orientation: turn }, 1e-3).feature
    };
    let first = at(0.0);
    assert_eq!(first.len(), 4);
    (-5..5).for_each(|k| assert_eq!(at(f64::from(k)), first, "{k}"));
}

/// The tip of a cone is deepest, in the middle of a ring that is about to touch: the four kept
/// points hold it from all sides.
#[test]
fn a_tip_is_held_from_all_sides() {
    let ring = |k: usize| {
        let angle = 0.25 * PI * k as f64;
        Vec3::new(0.02 * angle.cos(), 0.02 * angle.sin(), 1e-4)
    };
    let mut points: Vec<Vec3> = (0..8).map(ring).collect();
    points.extend([Vec3::zeros(), Vec3::new(0.0, 0.0, 0.03)]);
    let (cone, frame) = convex_hull(&points).expect("a cone");
    let base = cuboid(Vec3::new(0.05, 0.05, 0.01));
    let c = two(&base, &cone, Pose::at(Vec3::new(2e-3, 1e-3, 0.01)).then(&frame), 1e-3);
    assert_eq!(c.len(), 4, "{c:?}");
    let tip = (0..4).min_by(|i, j| c.gap[*i].total_cmp(&c.gap[*j])).expect("four");
    let outward: Vec<Vec3> =
        (0..4).filter(|k| *k != tip).map(|k| c.point[k] - c.point[tip]).collect();
    for k in 0..16 {
        let angle = PI / 8.0 * f64::from(k);
        let way = Vec3::new(angle.cos(), angle.sin(), 0.0);
        assert!(outward.iter().any(|p| p.dot(&way) > 0.005), "nothing at {angle}: {c:?}");
    }
}

#[test]
fn hexagonal_faces_keep_the_widest_four_with_the_deepest() {
    let corners = |k: usize| {
        let angle = PI / 3.0 * k as f64;
        [-0.01, 0.01].map(|z| Vec3::new(0.03 * angle.cos(), 0.03 * angle.sin(), z))
    };
    let points: Vec<Vec3> = (0..6).flat_map(corners).collect();
    let (prism, frame) = convex_hull(&points).expect("a prism");
    let base = cuboid(Vec3::new(0.05, 0.05, 0.01));
    for k in 0..6 {
        // Tilted a little so that corner k is deepest.
        let angle = PI / 3.0 * f64::from(k);
        let axis = Vec3::new(-angle.sin(), angle.cos(), 0.0);
        let tilt = Quat::from_scaled_axis(axis * 1e-4);
        let pose = Pose { position: Vec3::new(0.0, 0.0, 0.02), orientation: tilt }.then(&frame);
        let c = two(&base, &prism, pose, 1e-3);
        assert_eq!(c.len(), 4);
        let deepest = (0..4).min_by(|i, j| c.gap[*i].total_cmp(&c.gap[*j])).expect("four");
        let corner = Vec3::new(0.03 * angle.cos(), 0.03 * angle.sin(), 0.01);
        assert!((c.point[deepest] - corner).norm() < 1e-5, "{k}: {c:?}");
        // Two thirds of the hexagon is the most that four corners can span.
        let whole = 1.5 * 3f64.sqrt() * 0.03 * 0.03;
        assert!(area(&c.point) > 0.666 * whole, "{k}: {}", area(&c.point) / whole);
    }
}

#[test]
fn edges_that_cross_touch_in_one_point_between_them() {
    let shape = cuboid(Vec3::new(0.02, 0.02, 0.02));
    let edge = 0.02 * 2f64.sqrt();
    for gap in [-1e-3, -1e-6, 1e-6, 1e-4] {
        let below = Pose {
            position: Vec3::zeros(),
            orientation: Quat::from_euler_angles(0.25 * PI, 0.0, 0.0),
        };
        let above = Pose {
            position: Vec3::new(2e-3, -1e-3, 2.0 * edge + gap),
            orientation: Quat::from_euler_angles(0.0, 0.25 * PI, 0.0),
        };
        let model = scene::model(vec![shape.clone(), shape.clone()], vec![], 1e-3);
        let c = scene::fresh(&model, &scene::at_rest(&[below, above]));
        assert_eq!(c.len(), 1, "{gap}: {c:?}");
        assert!((c.gap[0] - gap).abs() < 1e-15 && (c.normal[0] + Vec3::z()).norm() < 1e-12);
        let crossing = Vec3::new(2e-3, 0.0, edge + 0.5 * gap);
        assert!((c.point[0] - Vec3::new(2e-3, 0.0, crossing.z)).norm() < 1e-12, "{c:?}");
    }
}

/// Two vertices that face each other: no face and no pair of edges gives their distance.
#[test]
fn corners_apart_touch_along_the_line_between_them() {
    let shape = cuboid(Vec3::repeat(0.02));
    for gap in [1e-8, 1e-5, 5e-4] {
        let n = Vec3::new(1.0, 2.0, 2.0) / 3.0;
        let c = two(&shape, &shape, Pose::at(Vec3::repeat(0.04) + n * gap), 1e-3);
        assert_eq!(c.len(), 1);
        assert!((c.gap[0] - gap).abs() < 1e-12 && (c.normal[0] + n).norm() < 1e-6, "{c:?}");
    }
    assert!(two(&shape, &shape, Pose::at(Vec3::repeat(0.0406)), 1e-3).is_empty());
}

fn on_plane(shape: &Polyhedron, pose: Pose, driven: Pose, alert: f64) -> Contacts {
    let floor = DrivenBody {
        name: "floor".into(),
        role: Role::Boundary,
        friction: 0.5,
        stiffness: ContactStiffness::RIGID,
        parts: vec![Part::HalfSpace { normal: Vec3::z(), offset: 0.5 }],
        mount: None,
    };
    let model = scene::model(vec![shape.clone()], vec![floor], alert);
    scene::fresh(&model, &scene::at_rest(&[pose, driven]))
}

#[test]
fn half_spaces_touch_vertices() {
    let shape = cuboid(Vec3::new(0.02, 0.03, 0.01));
    for gap in [-5e-3, 0.0, 9e-4] {
        let c = on_plane(&shape, Pose::at(Vec3::new(0.1, 0.2, 0.51 + gap)), Pose::identity(), 1e-3);
        assert_eq!(c.len(), 4, "{c:?}");
        for k in 0..4 {
            assert_eq!(c.bodies[k], [0, 1]);
            assert!((c.gap[k] - gap).abs() < 1e-15 && c.normal[k] == Vec3::z());
            assert!((c.point[k].z - 0.5 - 0.5 * gap).abs() < 1e-15);
        }
        assert!((area(&c.point) - 0.04 * 0.06).abs() < 1e-12);
    }
    assert!(
        on_plane(&shape, Pose::at(Vec3::new(0.0, 0.0, 0.5111)), Pose::identity(), 1e-3).is_empty()
    );
}

/// The plane follows its body, and a face of many corners keeps the widest four.
#[test]
fn half_spaces_move_with_their_body() {
    let corners = |k: usize| {
        let angle = PI / 6.0 * k as f64;
        [-0.01, 0.01].map(|z| Vec3::new(0.03 * angle.cos(), 0.03 * angle.sin(), z))
    };
    let points: Vec<Vec3> = (0..12).flat_map(corners).collect();
    let (prism, frame) = convex_hull(&points).expect("a prism");
    let body = Pose {
        position: Vec3::new(0.3, -0.2, 0.1),
        orientation: Quat::from_euler_angles(0.4, -0.8, 1.1),
    };
    let local = Pose::at(Vec3::new(0.05, 0.07, 0.51 - 1e-4)).then(&frame);
    let c = on_plane(&prism, body.then(&local), body, 1e-3);
    assert_eq!(c.len(), 4);
    let local: Vec<Vec3> = c.point.iter().map(|p| body.inverse_point(p)).collect();
    // A square is the widest of four corners of a regular dodecagon.
    assert!((area(&local) - 2.0 * 0.03 * 0.03).abs() < 1e-9, "{}", area(&local));
    assert!(c.gap.iter().all(|g| (g + 1e-4).abs() < 1e-12));
}
