//! Choice of few corners whose hull fills most of a convex body.

use ballast::geometry::{Polyhedron, convex_hull, stone_with_corners};
use ballast::math::{Pose, Vec3};
use std::f64::consts::PI;
use std::fmt::Write;

/// Largest number of points of which all are candidates.
pub const MAX_CANDIDATES: usize = 4000;
/// Largest number of points that are tried as the next corner.
const MAX_ATTEMPTS: usize = 200;
/// Height of a point above the chosen hull, over the half size of the points, below which it adds nothing.
const MIN_CORNER_HEIGHT: f64 = 1e-3;

/// Corners of a stone and their hull, in the unit of the points.
pub struct ChosenCorners {
    pub corners: Vec<Vec3>,
    /// Stone, around its centre of mass.
    pub stone: Polyhedron,
    /// Pose of the stone in the frame of the corners.
    pub pose: Pose,
}

/// Returns at most `most` corners of a stone inside the hull of `points`; `None` if there is no such stone.
///
/// The farthest points are chosen first, so that the hull grows as fast as it can. Points that would make edges too short or faces
/// too narrow for contact detection are passed over.
pub fn choose_corners(points: &[Vec3], most: usize) -> Option<ChosenCorners> {
    let first = tetrahedron(points)?;
    let half_size = 0.5 * (first[1] - first[0]).norm();
    let mut chosen = with_hull(&first)?;
    while chosen.corners.len() < most {
        let planes = || chosen.stone.face_normals.iter().zip(&chosen.stone.face_offsets);
        let height = |p: &Vec3| {
            let local = chosen.pose.inverse_point(p);
            planes().map(|(n, offset)| n.dot(&local) - offset).fold(f64::NEG_INFINITY, f64::max)
        };
        let mut above: Vec<(f64, &Vec3)> = points.iter().map(|p| (height(p), p)).collect();
        above.retain(|(height, _)| *height > MIN_CORNER_HEIGHT * half_size);
        above.sort_by(|a, b| b.0.total_cmp(&a.0));
        let more = |p: &Vec3| with_hull(&[&chosen.corners[..], &[*p]].concat());
        match above.iter().take(MAX_ATTEMPTS).find_map(|(_, p)| more(p)) {
            Some(more) => chosen = more,
            None => break,
        }
    }
    Some(chosen)
}

/// Returns all corners of the hull of `points`; `None` if they are more than `most`, or if contact detection cannot use them.
pub fn whole_corners(points: &[Vec3], most: usize) -> Option<ChosenCorners> {
    let (hull, pose) = convex_hull(points).ok()?;
    let corners: Vec<Vec3> = hull.vertices.iter().map(|v| pose.point(v)).collect();
    if corners.len() <= most { with_hull(&corners) } else { None }
}

/// Returns the corners as a key of a TOML table.
pub fn corners_text(corners: &[Vec3]) -> String {
    let mut text = "corners = [\n".to_string();
    for corner in corners {
        // Writing to a text cannot fail.
        let _ = writeln!(text, "    [{:?}, {:?}, {:?}],", corner.x, corner.y, corner.z);
    }
    text + "]\n"
}

/// Returns the corners with their hull; `None` if contact detection cannot use it, or if some of them are inside.
fn with_hull(corners: &[Vec3]) -> Option<ChosenCorners> {
    let corners: Vec<Vec3> = corners.iter().map(|c| c.map(rounded)).collect();
    stone_with_corners(&corners).ok()?;
    let (stone, pose) = convex_hull(&corners).ok()?;
    Some(ChosenCorners { corners, stone, pose })
}

/// Rounds to the digits of a single-precision number, which few decimals write.
fn rounded(x: f64) -> f64 {
    // A printed number can be read.
    (x as f32).to_string().parse().unwrap_or(x)
}

/// Returns the points that lie farthest in one of `most` directions, or all if they are no more.
pub fn extreme_points(points: &[Vec3], most: usize) -> Vec<Vec3> {
    if points.len() <= most {
        return points.to_vec();
    }
    let golden_angle = PI * (3.0 - 5f64.sqrt());
    let mut found: Vec<usize> = (0..most)
        .filter_map(|k| {
            let z = 1.0 - (2 * k + 1) as f64 / most as f64;
            let (radius, angle) = ((1.0 - z * z).sqrt(), k as f64 * golden_angle);
            let direction = Vec3::new(radius * angle.cos(), radius * angle.sin(), z);
            let height = |i: &usize| direction.dot(&points[*i]);
            (0..points.len()).max_by(|a, b| height(a).total_cmp(&height(b)))
        })
        .collect();
    found.sort_unstable();
    found.dedup();
    found.iter().map(|k| points[*k]).collect()
}

/// Returns four points that are far from each other.
fn tetrahedron(points: &[Vec3]) -> Option<[Vec3; 4]> {
    let farthest = |distance: &dyn Fn(&Vec3) -> f64| {
        points.iter().copied().max_by(|a, b| distance(a).total_cmp(&distance(b)))
    };
    let middle = points.iter().sum::<Vec3>() / points.len().max(1) as f64;
    let a = farthest(&|p| (p - middle).norm())?;
    let b = farthest(&|p| (p - a).norm())?;
    let c = farthest(&|p| (p - a).cross(&(b - a)).norm())?;
    let normal = (b - a).cross(&(c - a));
    let d = farthest(&|p| (p - a).dot(&normal).abs())?;
    Some([a, b, c, d])
}
