//! Reduction of a contact manifold to four points of largest area, always including the deepest.

use super::pair::smaller;
use crate::geometry::plane::{self, cross};
use crate::math::Vec3;

/// Contact point in world coordinates; the normal points from B to A.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactPoint {
    pub feature: u64,
    pub point: Vec3,
    pub normal: Vec3,
    pub gap: f64,
}

/// Maximum number of points per pair of convex parts.
pub const MAX_POINTS: usize = 4;

/// Candidate point of a manifold.
#[derive(Debug, Clone, Copy)]
pub struct ManifoldPoint {
    pub point: Vec3,
    pub gap: f64,
    pub feature: u64,
}

/// Maximum distance of points that count as one, over the bodies' size.
const MERGE_DISTANCE: f64 = 1e-7;
/// Relative tolerance of gaps (over the bodies' size) and of areas.
///
/// Rounding then does not change the selection from step to step.
const TIE: f64 = 2.5e-10;

/// Weight of open points beside overlapping ones where these carry forces of springs.
const OPEN_POINT_WEIGHT: f64 = 1e-3;

/// Keeps at most [`MAX_POINTS`] of `points`, including the deepest, and leaves them sorted by feature.
///
/// `n` is the contact normal, `alert` the largest gap and `size` the length that tolerances refer to.
///
/// Selects the four whose hull is largest, where a point has less weight the wider its gap is: seen from the deepest
/// point, a point at the alert distance moves all the way to it. Points that touch now take precedence; a point that
/// may touch soon is kept if no nearer one lies on its side.
pub fn keep_four(
    points: &mut Vec<ManifoldPoint>,
    n: &Vec3,
    alert: f64,
    size: f64,
    hull: &mut HullBuffers,
) {
    // As the patch lists them, but for a closest point at the end.
    if !points.is_sorted_by_key(|c| c.feature) {
        points.sort_unstable_by_key(|c| c.feature);
    }
    if has_repeated(points, MERGE_DISTANCE * size) {
        merge_repeated(points, MERGE_DISTANCE * size);
    }
    if points.len() <= MAX_POINTS {
        return;
    }
    let lowest = points.iter().fold(f64::INFINITY, |g, c| smaller(c.gap, g));
    let Some(place) = points.iter().position(|c| c.gap <= lowest + TIE * size) else { return };
    let deepest = points[place];
    let range = alert - deepest.gap.max(0.0);
    let (t, s) = crate::math::frame::tangents(n);
    let open_weight = if hull.prefers_overlaps { OPEN_POINT_WEIGHT } else { 1.0 };
    let flat = |c: &ManifoldPoint| {
        let near = if range > 0.0 { ((alert - c.gap) / range).clamp(0.0, 1.0) } else { 1.0 };
        let weight = if c.gap < 0.0 { near } else { open_weight * near };
        let p = (c.point - deepest.point) * weight;
        [t.dot(&p), s.dot(&p)]
    };
    hull.points.clear();
    hull.points.extend(points.iter().enumerate().map(|(k, c)| (flat(c), k)));
    let HullBuffers { points: all, chain: corners, .. } = hull;
    plane::hull(all, corners);
    let first = corners.iter().position(|(_, k)| *k == place);
    if let Some(first) = first {
        corners.rotate_left(first);
    }
    // Places of those that are kept.
    let mut kept = [usize::MAX; MAX_POINTS];
    let mut keep = |from: usize, numbers: &[usize]| {
        let numbers = numbers.iter().take(corners.len());
        kept[from..].iter_mut().zip(numbers).for_each(|(k, n)| *k = corners[*n].1);
    };
    if first.is_some() {
        keep(0, &widest_with_first(corners));
    } else {
        keep(1, &widest_around(corners));
        kept[0] = place;
    }
    kept.sort_unstable();
    let mut count = 0;
    for from in kept.into_iter().take_while(|k| *k != usize::MAX) {
        points[count] = points[from];
        count += 1;
    }
    points.truncate(count);
}

/// True if some points have the same position.
fn has_repeated(points: &[ManifoldPoint], apart: f64) -> bool {
    let mut least = f64::INFINITY;
    for (k, p) in points.iter().enumerate() {
        for q in &points[..k] {
            least = smaller((q.point - p.point).norm_squared(), least);
        }
    }
    least <= apart * apart
}

/// Merges points of the same position: the lowest feature, for a lasting identity, with the deepest gap.
fn merge_repeated(points: &mut Vec<ManifoldPoint>, apart: f64) {
    let mut kept = 0;
    for k in 0..points.len() {
        let p = points[k];
        let near = |c: &&mut ManifoldPoint| (c.point - p.point).norm_squared() <= apart * apart;
        if let Some(c) = points[..kept].iter_mut().find(near) {
            if p.gap < c.gap {
                *c = ManifoldPoint { feature: c.feature, ..p };
            }
        } else {
            points[kept] = p;
            kept += 1;
        }
    }
    points.truncate(kept);
}

/// Point of the plane, and the candidate's position in the list.
type HullPoint = plane::PlanePoint<usize>;

/// Points of the plane, and buffers for their convex hull.
#[derive(Debug, Default)]
pub struct HullBuffers {
    /// True if overlapping points take precedence, as springs would lose their forces from step to step (T-42).
    pub prefers_overlaps: bool,
    points: Vec<HullPoint>,
    chain: Vec<HullPoint>,
}

/// Returns the numbers of the first hull vertex and the three that span the largest area with it.
///
/// With at most four vertices it returns the first four numbers. With D first in the order, the area of D b c e is
/// that of D b c plus that of D c e. For each c the best b before it and the best e after it are independent, so
/// O(p²) finds the largest area.
fn widest_with_first(corners: &[HullPoint]) -> [usize; 4] {
    let count = corners.len();
    let area = |i: usize, j: usize| cross(corners[0].0, corners[i].0, corners[j].0).abs();
    let widest = |range: std::ops::Range<usize>, c: usize| {
        range.fold((-1.0, 0), |best, i| if area(i, c) > best.0 { (area(i, c), i) } else { best })
    };
    let mut best = (f64::NEG_INFINITY, [0, 1, 2, 3]);
    if count <= MAX_POINTS {
        return best.1;
    }
    for c in 2..count - 1 {
        let (before, b) = widest(1..c, c);
        let (after, e) = widest(c + 1..count, c);
        if before + after > best.0 * (1.0 + TIE) {
            best = (before + after, [0, b, c, e]);
        }
    }
    best.1
}

/// Returns the numbers of the three hull vertices whose hull with the origin is largest.
///
/// The origin is inside the hull. With at most three vertices it returns the first three numbers.
fn widest_around(corners: &[HullPoint]) -> [usize; 3] {
    let count = corners.len();
    // Turning left around the origin; a triangle that turns right is no part of the hull.
    let area = |i: usize, j: usize| cross([0.0; 2], corners[i].0, corners[j].0).max(0.0);
    let mut best = (f64::NEG_INFINITY, [0, 1, 2]);
    for b in 0..count {
        for c in b + 1..count {
            let first = area(b, c);
            for e in c + 1..count {
                let whole = first + area(c, e) + area(e, b);
                if whole > best.0 * (1.0 + TIE) {
                    best = (whole, [b, c, e]);
                }
            }
        }
    }
    best.1
}
