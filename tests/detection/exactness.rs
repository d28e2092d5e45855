//! Gap, normal and position of contacts of pairs, against the oracle.

use crate::oracle::{self, Body};
use crate::scene;
use ballast::geometry::{Polyhedron, convex_hull, cuboid};
use ballast::math::{Pose, Quat, Vec3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Detects one pair and compares it with the oracle; returns the gap.
pub fn check(a: &Polyhedron, b: &Polyhedron, poses: [Pose; 2], alert: f64, what: &str) -> f64 {
    let size = a.radius + b.radius;
    let tolerance = 1e-9 * size;
    let (wa, wb) = (Body::new(a, &poses[0]), Body::new(b, &poses[1]));
    let (separation, _) = oracle::separation(&wa, &wb);
    let expected = if separation > 0.0 { oracle::distance(&wa, &wb) } else { separation };
    let model = scene::model(vec![a.clone(), b.clone()], vec![], alert);
    let contacts = scene::fresh(&model, &scene::at_rest(&poses));
    let gap = contacts.gap.iter().copied().fold(f64::INFINITY, f64::min);
    let told = || {
        format!(
            "{what}: gap {gap:e}, expected {expected:e} (axis {separation:e}), size {size}, alert {alert:e}: {contacts:?}"
        )
    };
    if expected > alert + tolerance {
        assert!(contacts.is_empty(), "{}", told());
        return expected;
    }
    if expected <= alert - tolerance || !contacts.is_empty() {
        assert!((gap - expected).abs() <= tolerance, "{}", told());
    }
    assert!(contacts.len() <= 4, "{}", told());
    for k in 0..contacts.len() {
        let (g, n, x) = (contacts.gap[k], contacts.normal[k], contacts.point[k]);
        assert!(g <= alert && (n.norm() - 1.0).abs() < 1e-12, "{}", told());
        // The point's feet are on the surfaces that face each other.
        for (body, towards) in [(&wa, -n), (&wb, n)] {
            let foot = x - towards * (0.5 * g);
            let facing = body.faces_at(&foot, 1e-7 * size, &towards);
            assert!(facing, "point {k}: foot {} off; {}", body.outside(&foot), told());
        }
    }
    if let Some(n) = contacts.normal.first() {
        check_support(&wa, &wb, n, &contacts, alert, &told);
    }
    expected
}

/// The points kept are a good support: no corner that nearly touches is far beside them.
///
/// The largest of four corners' hulls, one of them given, covers at least 3√3/4π of the hull of all
/// (Sas 1939, for the other three). Weights shrink corners up to a quarter of the alert distance by
/// at most a quarter, so at least 0.41 · 0.75² of their hull is supported.
fn check_support(
    a: &Body,
    b: &Body,
    n: &Vec3,
    contacts: &ballast::detection::Contacts,
    alert: f64,
    told: &dyn Fn() -> String,
) {
    let corners = oracle::corners(a, b, &-n, 0.25 * alert);
    let whole = oracle::hull_area(&corners, n);
    let kept = oracle::hull_area(&contacts.point, n);
    let size = (a.vertices[0] - a.vertices[1]).norm();
    assert!(
        kept >= 0.23 * whole - 1e-6 * size * size,
        "{kept:e} of {whole:e} supported, corners {corners:?}; {}",
        told()
    );
}

/// Moves B along the axis of least depth until the separation is about `target`.
fn set_gap(a: &Polyhedron, b: &Polyhedron, poses: [Pose; 2], target: f64) -> [Pose; 2] {
    let mut poses = poses;
    for _ in 0..2 {
        let (wa, wb) = (Body::new(a, &poses[0]), Body::new(b, &poses[1]));
        let (separation, n) = oracle::separation(&wa, &wb);
        poses[1].position += n * (target - separation);
    }
    poses
}

fn random_pose(rng: &mut Pcg64, size: f64) -> Pose {
    let position = scene::random_unit(rng) * (10.0 * size);
    Pose { position, orientation: scene::random_turn(rng) }
}

/// A gap to aim at: both signs, from deep to grazing.
fn random_target(rng: &mut Pcg64, size: f64) -> f64 {
    let exponent = rng.random_range(-13.0..-0.6);
    let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    sign * size * 10f64.powf(exponent)
}

fn random_pairs(seed: u64, count: usize) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut signs = [0; 2];
    let hulls: Vec<_> = (0..200).map(|_| scene::random_hull(&mut rng, 0.025)).collect();
    for k in 0..count {
        let (a, b) = (&hulls[rng.random_range(0..200)], &hulls[rng.random_range(0..200)]);
        let pa = random_pose(&mut rng, 0.025);
        let apart =
            scene::random_unit(&mut rng) * (a.radius + b.radius) * rng.random_range(0.3..1.0);
        let pb = Pose { position: pa.position + apart, orientation: scene::random_turn(&mut rng) };
        let mut poses = [pa, pb];
        if k % 4 != 0 {
            poses = set_gap(a, b, poses, random_target(&mut rng, 0.02));
        }
        let gap = check(a, b, poses, 1e-3, &format!("seed {seed}, pair {k}"));
        signs[usize::from(gap > 0.0)] += 1;
    }
    assert!(signs.iter().all(|s| *s > count / 5), "{signs:?}");
}

#[test]
fn random_pairs_1() {
    random_pairs(1, 3000);
}

#[test]
fn random_pairs_2() {
    random_pairs(2, 3000);
}

#[test]
fn random_pairs_3() {
    random_pairs(3, 4000);
}

/// Slivers, and sizes from sand to rock.
#[test]
fn slivers_and_scales() {
    let mut rng = Pcg64::seed_from_u64(4);
    for k in 0..600 {
        let scale = 10f64.powf(rng.random_range(-3.0..3.0));
        let mut shape = |thin: f64| loop {
            let squash = Vec3::new(1.0, rng.random_range(0.3..1.0), thin);
            let points: Vec<Vec3> = (0..12)
                .map(|_| scene::random_unit(&mut rng).component_mul(&squash) * scale)
                .collect();
            if let Ok((s, _)) = convex_hull(&points) {
                return s;
            }
        };
        let (a, b) = (shape(0.03), shape(0.3));
        let pa = random_pose(&mut rng, 0.1 * scale);
        let apart = scene::random_unit(&mut rng) * (0.5 * scale);
        let pb = Pose { position: pa.position + apart, orientation: scene::random_turn(&mut rng) };
        let target = random_target(&mut rng, 0.1 * scale);
        let poses = set_gap(&a, &b, [pa, pb], target);
        check(&a, &b, poses, 0.01 * scale, &format!("sliver {k}, scale {scale}"));
    }
}

/// Equal shapes, turned by nothing or nearly nothing, about nothing or an edge: parallel edges,
/// coplanar faces, shared vertices.
#[test]
fn aligned_copies() {
    let mut rng = Pcg64::seed_from_u64(5);
    for k in 0..600 {
        let a = if k % 3 == 0 {
            cuboid(Vec3::new(0.02, 0.03, 0.01))
        } else {
            scene::random_hull(&mut rng, 0.02)
        };
        let b = a.clone();
        let pa = random_pose(&mut rng, 0.02);
        let edge = a.edges[rng.random_range(0..a.edges.len())];
        let [v0, v1] = edge.vertices.map(|v| a.vertices[v as usize]);
        let axis = nalgebra::Unit::new_normalize(v1 - v0);
        let angle = match k % 4 {
            0 => 0.0,
            1 => 10f64.powf(rng.random_range(-13.0..-1.0)),
            2 => std::f64::consts::PI,
            _ => std::f64::consts::PI + 10f64.powf(rng.random_range(-13.0..-1.0)),
        };
        let mut turn = Quat::from_axis_angle(&axis, angle);
        if k % 5 == 0 {
            let wobble = nalgebra::Unit::new_normalize(scene::random_unit(&mut rng));
            turn *= Quat::from_axis_angle(&wobble, 10f64.powf(rng.random_range(-13.0..-2.0)));
        }
        let local = match k % 7 {
            // A vertex of B on a vertex of A.
            0 => {
                let w = a.vertices[rng.random_range(0..a.vertices.len())];
                v0 - turn * w
            }
            // The shared edge stays where it is.
            1 => v0 - turn * v0,
            _ => {
                (a.face_normals[edge.faces[0] as usize] * 2.0)
                    * a.radius
                    * rng.random_range(0.2..1.1)
            }
        };
        let pb = pa.then(&Pose { position: local, orientation: turn });
        let mut poses = [pa, pb];
        if k % 2 == 0 {
            poses = set_gap(&a, &b, poses, random_target(&mut rng, 0.02));
        }
        check(&a, &b, poses, 1e-3, &format!("copy {k}, angle {angle:e}"));
    }
}

/// Cubes in exact alignment, shifted along axes by all fractions.
#[test]
fn symmetric_cubes() {
    let a = cuboid(Vec3::repeat(1.0));
    for (i, shift) in [0.0, 0.5, 1.0, 2.0, 1.999_999_999, 2.000_000_001].into_iter().enumerate() {
        for (j, gap) in [-0.5, -1e-3, -1e-12, 0.0, 1e-12, 1e-3].into_iter().enumerate() {
            for turn in
                [Quat::identity(), Quat::from_euler_angles(0.0, 0.0, 0.25 * std::f64::consts::PI)]
            {
                let b =
                    Pose { position: Vec3::new(shift, 0.3 * shift, 2.0 + gap), orientation: turn };
                check(&a, &a, [Pose::identity(), b], 0.01, &format!("cubes {i} {j}"));
            }
        }
    }
}
