//! Decomposition of closed surfaces into nearly convex pieces by plane cuts.
//!
//! Candidates are the planes of the faces at concave edges, so that a body of flat faces is cut exactly where its convex pieces meet,
//! and planes across the axes for rounded bodies. The best of them leaves the least volume between the pieces and their hulls. V-HACD
//! (parry3d) cuts between voxels: it misses concave edges by up to a voxel, cuts flat bodies more often than needed, and its limit
//! of the number of parts is none.

use crate::TriangleMesh;
use crate::corners::extreme_points;
use crate::triangle_mesh::signed_volume;
use ballast::geometry::{AxisBox, convex_hull};
use ballast::math::Vec3;
use std::collections::{BTreeMap, HashMap};

/// Maximum number of planes at concave edges that are tried.
const MAX_EDGE_PLANES: usize = 32;
/// Number of planes across each axis that are tried.
const AXIS_PLANES: usize = 7;
/// Sine of the angle above which an edge is concave.
const MIN_CONCAVE_SINE: f64 = 0.02;
/// Distance from a plane within which points count as on it, over the size of the body.
const PLANE_TOLERANCE: f64 = 1e-6;
/// Minimum volume of a piece, and minimum gain of a cut, over the volume of the body.
const MIN_VOLUME_SHARE: f64 = 1e-4;
/// Maximum number of points for the hull of a piece while cuts are compared.
const MAX_HULL_POINTS: usize = 300;

/// Plane `normal · x = offset`.
#[derive(Clone, Copy)]
struct CutPlane {
    normal: Vec3,
    offset: f64,
}

impl CutPlane {
    fn flipped(&self) -> Self {
        Self { normal: -self.normal, offset: -self.offset }
    }
}

/// Closed surface, in which the triangles of a cut may overlap with opposite signs.
struct Piece {
    triangles: Vec<[Vec3; 3]>,
    volume: f64,
    hull_volume: f64,
    is_final: bool,
}

impl Piece {
    fn new(triangles: Vec<[Vec3; 3]>) -> Self {
        let volume = signed_volume(triangles.iter().copied());
        let points = extreme_points(&distinct_points(&triangles), MAX_HULL_POINTS);
        let hull_volume = convex_hull(&points).map_or(0.0, |(hull, _)| hull.volume);
        Self { triangles, volume, hull_volume, is_final: false }
    }

    fn excess(&self) -> f64 {
        (self.hull_volume - self.volume).max(0.0)
    }
}

/// Returns the points of at most `max_parts` pieces of the bodies inside `shells`, which are closed and face outwards.
///
/// Cutting ends when the hulls of the pieces have no more than `tolerance` of the volume in excess.
pub fn decompose(shells: &[TriangleMesh], max_parts: usize, tolerance: f64) -> Vec<Vec<Vec3>> {
    let points = shells.iter().flat_map(|shell| shell.points.iter().copied());
    let bounds = AxisBox::around(points);
    let planes = cut_planes(shells, &bounds);
    let mut pieces: Vec<Piece> =
        shells.iter().map(|shell| Piece::new(shell.corners().collect())).collect();
    let volume: f64 = pieces.iter().map(|piece| piece.volume).sum();
    let cutter = Cutter {
        planes: &planes,
        tolerance: PLANE_TOLERANCE * (bounds.high - bounds.low).norm(),
        min_volume: MIN_VOLUME_SHARE * volume,
    };
    while pieces.len() < max_parts
        && pieces.iter().map(Piece::excess).sum::<f64>() > tolerance * volume
    {
        let open = (0..pieces.len()).filter(|k| !pieces[*k].is_final);
        let Some(worst) = open.max_by(|a, b| pieces[*a].excess().total_cmp(&pieces[*b].excess()))
        else {
            break;
        };
        match cutter.best_cut(&pieces[worst]) {
            Some([lower, upper]) => {
                pieces[worst] = lower;
                pieces.push(upper);
            }
            None => pieces[worst].is_final = true,
        }
    }
    pieces.iter().map(|piece| distinct_points(&piece.triangles)).collect()
}

struct Cutter<'p> {
    planes: &'p [CutPlane],
    /// Distance from a plane within which points count as on it.
    tolerance: f64,
    min_volume: f64,
}

impl Cutter<'_> {
    /// Returns the pieces on both sides of the best plane; `None` if no cut brings the hulls closer to the piece.
    ///
    /// Of equally good planes that with the smallest cut is the best.
    fn best_cut(&self, piece: &Piece) -> Option<[Piece; 2]> {
        let mut best: Option<(f64, f64, [Piece; 2])> = None;
        let mut limit = piece.excess() - self.min_volume;
        for plane in self.planes {
            let (lower, lower_area) = self.clip(&piece.triangles, plane);
            let (upper, upper_area) = self.clip(&piece.triangles, &plane.flipped());
            if lower.is_empty() || upper.is_empty() {
                continue;
            }
            let halves = [lower, upper].map(Piece::new);
            // The larger one contains faces in the plane.
            let area = lower_area.min(upper_area);
            let excess = halves[0].excess() + halves[1].excess();
            let is_better = excess < limit
                || best.as_ref().is_some_and(|(least, smallest, _)| {
                    excess < least + self.min_volume && area < *smallest
                });
            if is_better && halves.iter().all(|half| half.volume > self.min_volume) {
                limit = excess - self.min_volume;
                best = Some((excess, area, halves));
            }
        }
        best.map(|(_, _, halves)| halves)
    }

    /// Returns the closed surface of the piece below a plane, and its area in the plane.
    ///
    /// The cut is closed with triangles from one of its corners to all its edges. Where these overlap, their signs make them cancel.
    fn clip(&self, triangles: &[[Vec3; 3]], plane: &CutPlane) -> (Vec<[Vec3; 3]>, f64) {
        let height = |p: &Vec3| {
            let height = plane.normal.dot(p) - plane.offset;
            if height.abs() <= self.tolerance { 0.0 } else { height }
        };
        let (mut below, mut rim) = (Vec::new(), Vec::new());
        for triangle in triangles {
            let heights = triangle.map(|p| height(&p));
            // Those in the plane are replaced by the cut.
            if heights.iter().all(|h| *h >= 0.0) {
                continue;
            }
            let mut polygon: Vec<(Vec3, bool)> = Vec::with_capacity(4);
            for k in 0..3 {
                let next = (k + 1) % 3;
                let (a, b, h, h_next) = (triangle[k], triangle[next], heights[k], heights[next]);
                if h <= 0.0 {
                    polygon.push((a, h == 0.0));
                }
                if h * h_next < 0.0 {
                    polygon.push((a + (b - a) * (h / (h - h_next)), true));
                }
            }
            let after = polygon.iter().cycle().skip(1);
            rim.extend(
                polygon.iter().zip(after).filter(|(a, b)| a.1 && b.1).map(|(a, b)| [a.0, b.0]),
            );
            below
                .extend((2..polygon.len()).map(|k| [polygon[0].0, polygon[k - 1].0, polygon[k].0]));
        }
        let Some(&[apex, _]) = rim.first() else { return (below, 0.0) };
        let closing = rim.into_iter().map(|[a, b]| [b, a, apex]);
        let closing: Vec<_> = closing.filter(|[a, b, _]| *a != apex && *b != apex).collect();
        let area: Vec3 = closing.iter().map(|[a, b, c]| (b - a).cross(&(c - a)) * 0.5).sum();
        below.extend(closing);
        (below, area.norm())
    }
}

/// Returns the planes of faces at concave edges, those with the longest and deepest edges first, and planes across the axes.
fn cut_planes(shells: &[TriangleMesh], bounds: &AxisBox) -> Vec<CutPlane> {
    let size = (bounds.high - bounds.low).norm();
    // Equal planes up to rounding have one key.
    let mut weights: BTreeMap<[i64; 4], (f64, CutPlane)> = BTreeMap::new();
    for shell in shells {
        let normals: Vec<Option<Vec3>> = shell
            .corners()
            .map(|[a, b, c]| (b - a).cross(&(c - a)).try_normalize(f64::MIN_POSITIVE))
            .collect();
        let edges = |[a, b, c]: [usize; 3]| [[a, b], [b, c], [c, a]];
        let of_edge: HashMap<[usize; 2], usize> = (shell.triangles.iter().enumerate())
            .flat_map(|(k, t)| edges(*t).map(|edge| (edge, k)))
            .collect();
        for (k, triangle) in shell.triangles.iter().enumerate() {
            for [a, b] in edges(*triangle) {
                let other = of_edge.get(&[b, a]).and_then(|other| normals[*other]);
                let (Some(normal), Some(other)) = (normals[k], other) else { continue };
                let along = shell.points[b] - shell.points[a];
                // The product of length and sine; negative at a convex edge.
                let weight = other.cross(&normal).dot(&along);
                if weight <= MIN_CONCAVE_SINE * along.norm() {
                    continue;
                }
                let up = normal[normal.iamax()].signum() * normal;
                let plane = CutPlane { normal: up, offset: up.dot(&shell.points[a]) };
                let [x, y, z] = [up.x, up.y, up.z].map(|n| (n * 500.0).round() as i64);
                let key = [x, y, z, (plane.offset / (1e-4 * size)).round() as i64];
                weights.entry(key).or_insert((0.0, plane)).0 += weight;
            }
        }
    }
    let mut planes: Vec<(f64, CutPlane)> = weights.into_values().collect();
    planes.sort_by(|a, b| b.0.total_cmp(&a.0));
    let at_edges = planes.into_iter().take(MAX_EDGE_PLANES).map(|(_, plane)| plane);
    let across = (0..3).flat_map(|axis| {
        (1..=AXIS_PLANES).map(move |k| {
            let share = k as f64 / (AXIS_PLANES + 1) as f64;
            let offset = bounds.low[axis] + share * (bounds.high[axis] - bounds.low[axis]);
            CutPlane { normal: Vec3::ith(axis, 1.0), offset }
        })
    });
    at_edges.chain(across).collect()
}

fn distinct_points(triangles: &[[Vec3; 3]]) -> Vec<Vec3> {
    let mut points: Vec<Vec3> = triangles.iter().flatten().copied().collect();
    let order = |a: &Vec3, b: &Vec3| {
        a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)).then(a.z.total_cmp(&b.z))
    };
    points.sort_unstable_by(order);
    points.dedup();
    points
}
