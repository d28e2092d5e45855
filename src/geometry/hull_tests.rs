//! Closed forms, coplanar points and random hulls.

use super::*;
use crate::geometry::faces::directed;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Every promise that [`Polyhedron`]'s documentation makes.
fn assert_sound(p: &Polyhedron) {
    let tolerance = 1e-6 * p.radius;
    assert_eq!(p.vertices.len() + p.face_count(), p.edges.len() + 2);
    assert_eq!(p.face_starts.len(), p.face_count() + 1);
    for f in 0..p.face_count() {
        assert!((p.face_normals[f].norm() - 1.0).abs() < 1e-14 && p.face_offsets[f] > 0.0);
        let height = |v: &Vec3| p.face_normals[f].dot(v) - p.face_offsets[f];
        assert!(p.vertices.iter().all(|v| height(v) < tolerance));
        assert!(p.face(f).iter().all(|&v| height(&p.vertices[v as usize]).abs() < tolerance));
        assert!(polygon_normal(&p.vertices, p.face(f)).unwrap().dot(&p.face_normals[f]) > 0.999999);
    }
    assert!(p.edges.is_sorted_by_key(|e| e.vertices));
    for e in &p.edges {
        let [a, b] = e.vertices;
        assert!(a < b);
        assert!(directed(p.face(e.faces[0] as usize)).any(|d| d == [a, b]));
        assert!(directed(p.face(e.faces[1] as usize)).any(|d| d == [b, a]));
    }
    let faces = (0..p.face_count()).map(|f| p.face(f));
    let mass = mass_properties(&p.vertices, faces).unwrap();
    assert!((mass.volume / p.volume - 1.0).abs() < 1e-13);
    assert!(mass.centre.norm() < 5e-14 * p.radius, "{:?}", mass.centre);
    let error =
        (mass.inertia - Mat3::from_diagonal(&p.unit_inertia)).amax() / p.unit_inertia.amax();
    assert!(error < 1e-11, "{error:e}");
}

fn random_points(rng: &mut Pcg64, n: usize) -> Vec<Vec3> {
    (0..n).map(|_| Vec3::from_fn(|_, _| rng.random_range(-1.0..1.0))).collect()
}

fn random_pose(rng: &mut Pcg64, size: f64) -> Pose {
    let angle = Vec3::from_fn(|_, _| rng.random_range(-2.0..2.0));
    let position = Vec3::from_fn(|_, _| rng.random_range(-size..size));
    Pose { position, orientation: crate::math::rotation::exp(&angle) }
}

#[test]
fn a_direct_cuboid_and_its_hull_are_the_same_body() {
    let half = Vec3::new(0.3, 0.1, 0.2);
    let direct = cuboid(half);
    assert_sound(&direct);
    let (hull, pose) = convex_hull(&direct.vertices).unwrap();
    assert_sound(&hull);
    assert_eq!(pose, Pose::identity());
    assert_eq!((hull.face_count(), hull.edges.len(), hull.vertices.len()), (6, 12, 8));
    for v in &hull.vertices {
        assert!(direct.vertices.contains(v));
    }
    assert!((hull.volume / direct.volume - 1.0).abs() < 1e-14);
    assert!((hull.unit_inertia - direct.unit_inertia).amax() < 1e-16);
}

#[test]
fn a_tetrahedron_has_its_closed_form() {
    // Corners of a cube of side 2a: edge sqrt(8) a, volume 8/3 a³, moment M (edge²)/20.
    let a = 0.01;
    let points = [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]
        .map(|p| Vec3::from(p) * a);
    let (p, _) = convex_hull(&points).unwrap();
    assert_sound(&p);
    let volume = 8.0 / 3.0 * a * a * a;
    assert!((p.volume / volume - 1.0).abs() < 1e-14);
    let moment = volume * 8.0 * a * a / 20.0;
    assert!((p.unit_inertia / moment - Vec3::repeat(1.0)).amax() < 1e-13);
}

#[test]
fn the_pose_leads_from_the_principal_frame_to_the_points() {
    let mut rng = Pcg64::seed_from_u64(3);
    let points: Vec<Vec3> = random_points(&mut rng, 12).iter().map(|p| p * 0.02).collect();
    let pose = random_pose(&mut rng, 0.5);
    let moved: Vec<Vec3> = points.iter().map(|p| pose.point(p)).collect();
    let (p, frame) = convex_hull(&moved).unwrap();
    assert_sound(&p);
    for v in &p.vertices {
        let world = frame.point(v);
        assert!(moved.iter().any(|m| (m - world).norm() < 1e-15), "{world:?}");
    }
    let m = p.unit_inertia;
    assert!(m.x < m.y && m.y < m.z);
}

#[test]
fn coplanar_collinear_and_inner_points_disappear() {
    let mut rng = Pcg64::seed_from_u64(4);
    for size in [1e-3, 0.04, 30.0] {
        let pose = random_pose(&mut rng, size);
        let grid = |k: usize| (k as f64 - 2.0) * size / 2.0;
        let points: Vec<Vec3> = (0..125)
            .map(|i| pose.point(&Vec3::new(grid(i % 5), grid(i / 5 % 5), grid(i / 25))))
            .collect();
        let (p, _) = convex_hull(&points).unwrap();
        assert_sound(&p);
        assert_eq!((p.face_count(), p.edges.len(), p.vertices.len()), (6, 12, 8));
        assert!((p.volume / (2.0 * size).powi(3) - 1.0).abs() < 1e-13);
    }
}

#[test]
fn random_hulls_with_forced_coplanar_points_are_sound() {
    let mut rng = Pcg64::seed_from_u64(5);
    for case in 0..3000 {
        let n = 4 + case % 40;
        let mut points = random_points(&mut rng, n);
        // A cut plane, and points that lie on a common plane up to noise of every magnitude.
        let noise = 10f64.powf(rng.random_range(-17.0..-4.0));
        if n > 8 {
            for p in &mut points[..6] {
                p.z = 0.999 + noise * rng.random_range(-1.0..1.0);
            }
        }
        let pose = random_pose(&mut rng, 1.0);
        let points: Vec<Vec3> = points.iter().map(|p| pose.point(p) * 0.03).collect();
        let (p, frame) = convex_hull(&points).unwrap_or_else(|e| panic!("case {case}: {e}"));
        assert_sound(&p);
        for point in &points {
            let local = frame.inverse_point(point);
            let out = (0..p.face_count())
                .map(|f| p.face_normals[f].dot(&local) - p.face_offsets[f])
                .fold(f64::MIN, f64::max);
            assert!(out < 3e-6 * p.radius, "case {case}: {out:e}");
        }
    }
}

#[test]
fn gift_wrapping_finds_the_same_hull_as_the_library() {
    let mut rng = Pcg64::seed_from_u64(6);
    for case in 0..200 {
        let points = random_points(&mut rng, 5 + case % 30);
        let (corners, triangles) = triangulate(&points).unwrap().unwrap();
        let merged = faces::merge(&corners, &triangles, 1e-9).unwrap();
        let wrapped = faces::wrap(&points, 1e-9).unwrap();
        let volume = |points: &[Vec3], s: &Surface| {
            mass_properties(points, s.faces.iter().map(Vec::as_slice)).unwrap().volume
        };
        assert_eq!(merged.faces.len(), wrapped.faces.len());
        assert!((volume(&corners, &merged) - volume(&points, &wrapped)).abs() < 1e-13);
    }
    let cube = cuboid(Vec3::new(0.5, 0.5, 0.5));
    assert_eq!(faces::wrap(&cube.vertices, 1e-9).unwrap().faces.len(), 6);
}

#[test]
fn unusable_points_are_refused_with_what_was_found() {
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.5, 0.4]];
    let flat: Vec<Vec3> = square.iter().map(|p| Vec3::new(p[0], p[1], 0.3 * p[0])).collect();
    let line: Vec<Vec3> = (0..9).map(|k| Vec3::new(1.0, 2.0, 3.0) * k as f64).collect();
    let mut hole = cuboid(Vec3::repeat(1.0)).vertices;
    hole[3].y = f64::NAN;
    let huge: Vec<Vec3> = cuboid(Vec3::repeat(1e30)).vertices;
    let cases: [(&[Vec3], &str); 7] = [
        (&[], "found 0"),
        (&flat[..3], "found 3"),
        (&flat, "5 points that are flat"),
        (&line, "9 points that are flat"),
        (&hole, "at point 3"),
        (&huge, "e30 m"),
        (&[Vec3::zeros(); 20], "found 0e0 m"),
    ];
    for (points, words) in cases {
        let error = convex_hull(points).unwrap_err().to_string();
        assert!(error.contains(words), "{error}");
    }
}

/// Faces that are planes up to noise around the tolerances, points given twice, f32 coordinates.
#[test]
fn nearly_coplanar_points_of_any_noise_give_sound_hulls() {
    let mut rng = Pcg64::seed_from_u64(8);
    for case in 0..6000 {
        let noise = 10f64.powf(rng.random_range(-12.0..-4.0));
        let mut near = |p: &Vec3| p + Vec3::from_fn(|_, _| noise * rng.random_range(-1.0..1.0));
        let points: Vec<Vec3> = match case % 3 {
            0 => cuboid(Vec3::new(0.5, 0.3, 0.7)).vertices.iter().map(&mut near).collect(),
            1 => (0..64)
                .map(|i| near(&Vec3::new((i % 4) as f64, (i / 4 % 4) as f64, (i / 16) as f64)))
                .collect(),
            _ => {
                let seeds = random_points(&mut Pcg64::seed_from_u64(case), 20);
                seeds.iter().flat_map(|p| [*p, near(p)]).collect()
            }
        };
        let pose = random_pose(&mut rng, 1.0);
        let stored = |x: f64| if case % 2 == 0 { x as f32 as f64 } else { x };
        let points: Vec<Vec3> = points.iter().map(|p| (pose.point(p) * 0.03).map(stored)).collect();
        let (p, _) = convex_hull(&points).unwrap_or_else(|e| panic!("case {case}: {e}"));
        assert_sound(&p);
    }
}
