//! Tools from surface meshes: exact parts of flat bodies, close ones of rounded bodies, errors of unusable meshes.

use ballast::geometry::{AxisBox, stone_with_corners};
use ballast::math::Vec3;
use ballast_meshes::{MeshTool, PartLimits, ToolPlacement};
use std::path::PathBuf;
use tempfile::TempDir;

const LIMITS: PartLimits = PartLimits { parts: 8, corners: 30, excess_volume: 0.01 };

/// Millimetres, y forward, z up, with the reference point at the corner of blade and shaft.
fn placement() -> ToolPlacement {
    let [y, z] = [Vec3::y(), Vec3::z()];
    ToolPlacement { unit: 1e-3, origin: Vec3::new(0.0, 0.0, 70.0), forward: y, up: z }
}

/// Profile in x and z, mm, of a blade with a shaft over its one end; between them a fillet of `radius`.
///
/// All of it is seen from its first corner.
fn profile(radius: f64) -> Vec<[f64; 2]> {
    let mut corners = vec![[0.0, 0.0], [120.0, 0.0], [120.0, 70.0]];
    let steps = if radius > 0.0 { 8 } else { 0 };
    for k in 0..=steps {
        let angle = std::f64::consts::FRAC_PI_2 * f64::from(k) / f64::from(steps.max(1));
        let [x, z] = [radius * (1.0 - angle.sin()), radius * (1.0 - angle.cos())];
        corners.push([60.0 + x, 70.0 + z]);
    }
    corners.extend([[60.0, 400.0], [0.0, 400.0]]);
    corners
}

fn area(profile: &[[f64; 2]]) -> f64 {
    let next = profile.iter().cycle().skip(1);
    profile.iter().zip(next).map(|(a, b)| 0.5 * (a[0] * b[1] - a[1] * b[0])).sum()
}

/// OBJ of a profile that spans `y`, with its first point as number `first`.
fn extruded(profile: &[[f64; 2]], y: [f64; 2], first: usize) -> String {
    let n = profile.len();
    let points =
        y.map(|y| profile.iter().map(|[x, z]| format!("v {x} {y} {z}\n")).collect::<String>());
    let face = |corners: [usize; 3]| {
        let [a, b, c] = corners.map(|k| first + k);
        format!("f {a} {b} {c}\n")
    };
    let caps = (2..n).map(|k| face([0, k - 1, k]) + &face([n, n + k, n + k - 1]));
    let sides = (0..n).map(|k| {
        let next = (k + 1) % n;
        face([k, n + k, n + next]) + &face([k, n + next, next])
    });
    points.concat() + &caps.collect::<String>() + &sides.collect::<String>()
}

fn write(content: &str) -> (TempDir, PathBuf) {
    let place = TempDir::new().unwrap();
    let path = place.path().join("tine.obj");
    std::fs::write(&path, content).unwrap();
    (place, path)
}

fn read(content: &str, limits: &PartLimits) -> Result<MeshTool, String> {
    let (_place, path) = write(content);
    MeshTool::read(&path, &placement(), limits).map_err(|e| e.to_string())
}

#[test]
fn a_blade_below_a_shaft_becomes_two_boxes() {
    let content = extruded(&profile(0.0), [-11.0, 11.0], 1);
    let tool = read(&content, &LIMITS).unwrap();
    assert_eq!(tool.parts.len(), 2);
    let expected = 1e-9 * 22.0 * (120.0 * 70.0 + 60.0 * 330.0);
    assert!((tool.mesh_volume / expected - 1.0).abs() < 1e-6, "{}", tool.mesh_volume);
    assert!((tool.volume / expected - 1.0).abs() < 1e-6, "{}", tool.volume);
    assert!(tool.added_distance < 1e-7 && tool.lost_distance < 1e-7, "{tool:?}");
    let AxisBox { low, high } = tool.bounds;
    // y of the mesh is x of the tool, and its x is -y.
    assert!((low - Vec3::new(-0.011, -0.12, -0.07)).norm() < 1e-7, "{low}");
    assert!((high - Vec3::new(0.011, 0.0, 0.33)).norm() < 1e-7, "{high}");
    let mut tops: Vec<f64> = tool
        .parts
        .iter()
        .map(|corners| {
            assert_eq!(corners.len(), 8);
            corners.iter().map(|c| c.z).fold(f64::MIN, f64::max)
        })
        .collect();
    tops.sort_by(f64::total_cmp);
    assert!(tops[0].abs() < 1e-7 && (tops[1] - 0.33).abs() < 1e-7, "{tops:?}");
    assert_eq!(read(&content, &LIMITS).unwrap(), tool, "the same parts each time");
}

#[test]
fn more_parts_follow_a_fillet_closer() {
    let rounded = profile(40.0);
    let content = extruded(&rounded, [-11.0, 11.0], 1);
    let expected = 1e-9 * 22.0 * area(&rounded);
    let mut last = f64::INFINITY;
    for parts in [2, 4, 8] {
        let limits = PartLimits { parts, excess_volume: 1e-4, ..LIMITS };
        let tool = read(&content, &limits).unwrap();
        assert!(tool.parts.len() <= parts);
        assert!((tool.mesh_volume / expected - 1.0).abs() < 1e-6);
        assert!(tool.added_distance < last, "{parts} parts: {} m", tool.added_distance);
        last = tool.added_distance;
        for corners in &tool.parts {
            stone_with_corners(corners).unwrap();
        }
    }
    let tool = read(&content, &LIMITS).unwrap();
    assert!((tool.volume / expected - 1.0).abs() < 0.02, "{}", tool.volume / expected);
}

#[test]
fn closed_surfaces_that_overlap_stay_parts() {
    let square =
        |x: [f64; 2], z: [f64; 2]| vec![[x[0], z[0]], [x[1], z[0]], [x[1], z[1]], [x[0], z[1]]];
    let blade = extruded(&square([0.0, 120.0], [0.0, 70.0]), [-11.0, 11.0], 1);
    let shaft = extruded(&square([30.0, 90.0], [60.0, 400.0]), [-20.0, 20.0], 9);
    let tool = read(&(blade + &shaft), &LIMITS).unwrap();
    assert_eq!(tool.parts.len(), 2);
    assert!(tool.added_distance < 1e-7 && tool.lost_distance < 1e-7, "{tool:?}");
}

#[test]
fn unusable_meshes_are_refused() {
    let content = extruded(&profile(0.0), [-11.0, 11.0], 1);
    let open = content.trim_end().rsplit_once('\n').unwrap().0;
    let message = read(open, &LIMITS).unwrap_err();
    assert!(message.contains("expected a closed surface, found a surface with holes"), "{message}");
    let one = PartLimits { parts: 1, ..LIMITS };
    let message = read(&content, &one).unwrap_err();
    assert!(message.contains("within 10 %") && message.contains("more parts"), "{message}");
    let two = content.clone() + &extruded(&profile(0.0), [20.0, 40.0], 13);
    let message = read(&two, &one).unwrap_err();
    assert!(message.contains("at most 1 closed surfaces, found 2"), "{message}");
}
