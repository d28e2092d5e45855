//! Reports the contact points along the selected axis, and those with half-spaces.

use super::edges::{ClosestPoints, EdgeAxis};
use super::feature;
use super::frame::ContactAxis;
use super::manifold::{self, ContactPoint, ManifoldPoint};
use super::memory::{ContactCache, Scratch};
use super::pair::{self, BodyPair, ConvexBody, SLAB, TIE};
use crate::math::Vec3;

/// Tolerance of a patch's lowest gap, over the radii.
const GAP_TOLERANCE: f64 = 1e-7;

/// Best face of either body.
#[derive(Debug, Clone, Copy)]
pub struct BestFace {
    pub of_b: bool,
    /// Unit vector from A to B, in the frame of A.
    pub normal: Vec3,
    pub separation: f64,
}

impl BestFace {
    /// Returns the face normal as the selected axis.
    pub fn chosen(&self) -> BestAxis {
        BestAxis { normal: self.normal, separation: self.separation, edges: None }
    }
}

/// Axis selected by a search, input of the candidate axes of the next steps.
#[derive(Debug, Clone, Copy)]
pub struct BestAxis {
    pub normal: Vec3,
    pub separation: f64,
    pub edges: Option<[usize; 2]>,
}

impl BodyPair<'_> {
    /// Reports the contact of two edges with closest points `c`, and caches them.
    pub fn report_edges(
        &self,
        e: &EdgeAxis,
        c: &ClosestPoints,
        cache: &mut ContactCache,
        scratch: &mut Scratch,
    ) -> BestAxis {
        cache.edges = e.edges.map(|e| e as u32 + 1);
        self.report_closest(c, &e.normal, e.separation, cache, scratch);
        BestAxis { normal: e.normal, separation: e.separation, edges: Some(e.edges) }
    }

    /// Reports the contact of bodies with closest points `c`.
    pub fn report_closest(
        &self,
        c: &ClosestPoints,
        normal: &Vec3,
        gap: f64,
        cache: &mut ContactCache,
        scratch: &mut Scratch,
    ) {
        let closest = || {
            let feature = feature::edges([self.a, self.b], c.edges, c.parameter);
            ManifoldPoint { point: (c.on_a + c.on_b) * 0.5, gap, feature }
        };
        self.find_patch(normal, gap, cache, scratch);
        self.report_patch(normal, gap, closest, scratch);
    }

    /// Reports the contact along a face normal, whose patch is in `scratch.candidates`.
    pub fn report_face(&self, face: &BestFace, scratch: &mut Scratch) -> BestAxis {
        let BestFace { of_b, normal, separation: gap } = face;
        let closest = || {
            let (vertex, feature, side) = if *of_b {
                let v = pair::first_lowest(&self.a.vertices, &-normal);
                (self.a.vertices[v], feature::vertex(v), 1.0)
            } else {
                let v = pair::first_lowest(&self.b.vertices, &self.in_b(normal));
                (self.corner_of_b(v), feature::vertex_of_b(v), -1.0)
            };
            let point = vertex + normal * (0.5 * side * gap);
            ManifoldPoint { point, gap: *gap, feature }
        };
        self.report_patch(normal, *gap, closest, scratch);
        face.chosen()
    }

    /// Reports the contact along a normal (A to B, frame of A) that separates the bodies by `gap`.
    pub fn report_along(&self, normal: &Vec3, gap: f64, scratch: &mut Scratch) {
        let closest = || {
            let v = pair::first_lowest(&self.a.vertices, &-normal);
            let point = self.a.vertices[v] + normal * (0.5 * gap);
            ManifoldPoint { point, gap, feature: feature::vertex(v) }
        };
        self.find_patch(normal, gap, &mut ContactCache::default(), scratch);
        self.report_patch(normal, gap, closest, scratch);
    }

    /// Reports the four points of `scratch.candidates`, the patch along `normal`, that represent it best.
    ///
    /// `closest` returns the point at which the gap equals the axis's separation; no corner's gap is below that
    /// except for rounding. It is reported if rounding hides it from the patch.
    fn report_patch(
        &self,
        normal: &Vec3,
        separation: f64,
        closest: impl Fn() -> ManifoldPoint,
        scratch: &mut Scratch,
    ) {
        let Scratch { candidates, hull, .. } = scratch;
        if lowest_gap(candidates) > separation + GAP_TOLERANCE * self.size {
            let closest = closest();
            candidates.retain(|c| c.feature != closest.feature);
            candidates.push(closest);
        }
        manifold::keep_four(candidates, normal, self.alert, self.size, hull);
        if let Some(d) = candidates.iter_mut().min_by(|c, d| c.gap.total_cmp(&d.gap)) {
            d.gap = separation;
        }
        candidates.iter_mut().for_each(|c| c.gap = c.gap.max(separation));
        self.append_points(normal, scratch);
    }

    /// Fills `scratch.candidates` with the corners of the gap along `n`, in the frame of A.
    pub fn find_patch(
        &self,
        n: &Vec3,
        separation: f64,
        cache: &mut ContactCache,
        scratch: &mut Scratch,
    ) {
        let axis = ContactAxis {
            normal: *n,
            alert: self.alert,
            lowest: separation - GAP_TOLERANCE * self.size,
            slab: (self.alert - separation).max(0.0) + SLAB * self.size,
            tolerance: TIE * self.size,
        };
        let ContactCache { patch, patch_backoff, .. } = cache;
        axis.corners(self, patch, patch_backoff, &mut scratch.facing, &mut scratch.candidates);
    }

    /// Appends the candidates, at most four and in the frame of A, as contact points of the world.
    fn append_points(&self, normal: &Vec3, scratch: &mut Scratch) {
        let pose = &self.pose;
        let normal = -(pose.orientation * normal);
        scratch.points.extend(scratch.candidates.iter().map(|c| ContactPoint {
            feature: c.feature,
            point: pose.point(&c.point),
            normal,
            gap: c.gap,
        }));
    }
}

/// Returns the first of the candidates of lowest gap.
pub fn deepest(candidates: &[ManifoldPoint]) -> Option<&ManifoldPoint> {
    candidates.iter().reduce(|d, c| if c.gap < d.gap { c } else { d })
}

/// Returns the lowest gap, infinite without candidates.
pub fn lowest_gap(candidates: &[ManifoldPoint]) -> f64 {
    deepest(candidates).map_or(f64::INFINITY, |c| c.gap)
}

/// Appends the vertices of `a` at most `alert` (m) above the plane `normal · x = offset` of the world to
/// `scratch.points`.
///
/// At most four points, of largest area, including the deepest, sorted by feature.
pub fn generate_half_space_contacts(
    a: ConvexBody,
    normal: &Vec3,
    offset: f64,
    alert: f64,
    scratch: &mut Scratch,
) {
    let centre = normal.dot(&a.pose.position) - offset;
    if centre > a.shape.radius * (1.0 + 1e-9) + alert {
        return;
    }
    let n = a.pose.orientation.inverse() * normal;
    let Scratch { candidates, hull, .. } = scratch;
    candidates.clear();
    for (v, vertex) in a.shape.vertices.iter().enumerate() {
        let gap = n.dot(vertex) + centre;
        if gap <= alert {
            candidates.push(ManifoldPoint { point: *vertex, gap, feature: feature::vertex(v) });
        }
    }
    manifold::keep_four(candidates, &n, alert, a.shape.radius, hull);
    scratch.points.extend(scratch.candidates.iter().map(|c| ContactPoint {
        feature: c.feature,
        point: a.pose.point(&c.point) - normal * (0.5 * c.gap),
        normal: *normal,
        gap: c.gap,
    }));
}
