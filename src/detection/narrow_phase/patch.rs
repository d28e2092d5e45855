//! Contact patch: all corners of the gap between two bodies along an axis.
//!
//! Seen along the axis, the gap between the facing surfaces of two convex bodies is a convex function, linear over
//! pieces whose corners are vertices of A, vertices of B, and crossings of an edge of A with an edge of B. Corners
//! with a gap up to the alert distance are all that can touch next. A body that rolls over a vertex or rocks over an
//! edge is held by the neighbouring corner before it gets there; the closest features alone would let it penetrate.
//!
//! A corner with gap g <= alert has its feet on A and B at most `alert - s` off the support planes, s being the
//! separation along the axis. So the edges with an end in that slab decide, and of them the parts in the slab
//! ([`facing`](super::facing)).
//!
//! Vertices and pairs of edges that may make corners change little from step to step. They are listed with a margin,
//! and the list is used while the bodies and the axis have moved by less. Superfluous entries make no corner, so
//! results do not depend on the list.
//!
//! Only features near the contact must be bounded. The feet of a corner are at most r = max(alert, -s) apart,
//! whatever the axis. When the list was made they were less than r + Δ + φ l apart, Δ and φ being the bodies' motion
//! since ([`ReferencePose`]) and l a foot's distance from the reference point. So they were in a slab of r + Δ + φ l
//! - s0, s0 being the separation then, and l is no more than the lever of the facing features in the list's slab.

use super::cache::{CacheBackoff, IndexList, ReferencePose};
use super::edge_cache::{EdgeCache, MAX_EDGES};
use super::facing::FacingFeatures;
use super::feature;
use super::frame::{AxisFrame, ContactAxis, DecidingFaces, MotionBound, ProjectedEdge};
use super::manifold::ManifoldPoint;
use super::pair::{BodyPair, SLAB};
use crate::geometry::Polyhedron;
use crate::math::{Vec3, round, widen};

/// Maximum relative displacement of the bodies while a list is valid, over the radii.
const MAX_DISPLACEMENT: f64 = 3e-3;
/// Maximum rotation of the axis in the frame of A while a list is valid, rad.
const MAX_ROTATION: f64 = 8e-3;
/// Additional thickness of the slab of a list, over the radii.
const EXTRA_SLAB: f64 = 6e-3;
/// Features of both bodies that may make corners of the gap, and the configuration for which they were listed.
#[derive(Debug, Clone, Copy, Default)]
pub struct PatchCache {
    reference: ReferencePose,
    axis: [f32; 3],
    /// Alert distance for which it was made, m.
    alert: f64,
    /// Maximum distance of feet including their motion, m.
    max_foot_distance: f32,
    /// Maximum distance of a foot from the reference point, m.
    lever: f32,
    /// True if some of the edges may turn away from the other body.
    may_turn_away: bool,
    /// Vertices of A and of B that may lie over the other body.
    vertices: [IndexList<8>; 2],
    /// Faces of the other body that decide about each vertex.
    below: [[DecidingFaces; 8]; 2],
    /// Edges of A and of B that may cross.
    edge_caches: [EdgeCache; 2],
    /// Pairs of edges by their positions in the edge caches: that of A times [`MAX_EDGES`] plus that of B.
    pairs: IndexList<32>,
}

impl PatchCache {
    /// True if the list contains all features that `axis` can find.
    fn holds(&self, pair: &BodyPair, axis: &ContactAxis) -> bool {
        let Some(moved) = self.reference.moved(pair) else { return false };
        let turn = (widen(&self.axis) - axis.normal).norm() + 1e-6;
        let max_foot_distance =
            axis.max_foot_distance() + moved.at_point + f64::from(self.lever) * moved.rotation;
        moved.at_point <= MAX_DISPLACEMENT * pair.size
            && turn <= MAX_ROTATION
            && moved.rotation <= MAX_ROTATION
            && max_foot_distance <= self.max_foot_distance.into()
            && axis.alert <= self.alert
    }

    /// Builds the list for `axis` and its neighbours. Returns false if it does not fit.
    fn rebuild(
        &mut self,
        pair: &BodyPair,
        axis: &ContactAxis,
        facing: &mut FacingFeatures,
    ) -> bool {
        let slab = axis.slab + EXTRA_SLAB * pair.size;
        let motion_bound = MotionBound {
            displacement: (MAX_DISPLACEMENT + SLAB) * pair.size,
            rotation: MAX_ROTATION,
        };
        facing.list(pair, axis, slab, motion_bound);
        self.reference = ReferencePose::default();
        for (side, over) in facing.vertices.iter().enumerate() {
            fill(&mut self.vertices[side], over.iter().map(|o| o.vertex));
            self.below[side].iter_mut().zip(over).for_each(|(below, o)| *below = o.below);
        }
        self.pairs.clear();
        self.edge_caches.iter_mut().for_each(EdgeCache::clear);
        for [a, b] in &facing.pairs {
            let [on_a, on_b] = &mut self.edge_caches;
            self.pairs.push(on_a.add(pair.a, *a) * MAX_EDGES + on_b.add(pair.b, *b));
        }
        let whole = self.vertices.iter().all(IndexList::is_complete)
            && self.edge_caches.iter().all(EdgeCache::is_complete)
            && self.pairs.is_complete();
        if whole {
            self.reference = ReferencePose::new(pair, &facing.middle);
            self.axis = round(&axis.normal);
            self.alert = axis.alert;
            self.max_foot_distance = ((slab - (axis.slab - axis.alert)) * 0.999_999) as f32;
            self.may_turn_away = facing.may_turn_away;
            self.lever = (facing.lever * 1.000_001) as f32;
        }
        whole
    }
}

fn fill<const N: usize>(list: &mut IndexList<N>, items: impl Iterator<Item = usize>) {
    list.clear();
    items.for_each(|i| list.push(i));
}

impl ContactAxis {
    /// Fills `out` with the corners of gaps up to the alert distance, in the frame of A.
    pub fn corners(
        &self,
        pair: &BodyPair,
        list: &mut PatchCache,
        backoff: &mut CacheBackoff,
        facing: &mut FacingFeatures,
        out: &mut Vec<ManifoldPoint>,
    ) {
        out.clear();
        let frames = self.frames(pair);
        let holds = list.holds(pair, self);
        if holds {
            backoff.record_hit();
        }
        if holds || (backoff.should_rebuild() && list.rebuild(pair, self, facing)) {
            let [of_a, of_b] = &frames;
            let sure = !list.may_turn_away;
            let [on_a, on_b] = &list.edge_caches;
            let FacingFeatures { edge_caches: [placed_a, placed_b], .. } = facing;
            on_a.place(pair.a, of_a, placed_a);
            on_b.place(pair.b, of_b, placed_b);
            for both in list.pairs.iter() {
                let (a, b) = (both / MAX_EDGES, both % MAX_EDGES);
                let edges = [on_a.edges.item(a), on_b.edges.item(b)];
                if sure || (of_a.is_facing(pair.a, edges[0]) && of_b.is_facing(pair.b, edges[1])) {
                    let segments = [on_a.segment(a, placed_a), on_b.segment(b, placed_b)];
                    self.crossing(pair, of_a, edges, &segments, out);
                }
            }
            let over = |side: usize| list.vertices[side].iter().zip(&list.below[side]);
            let a = over(0).filter(|(v, _)| sure || of_a.has_facing_edge(pair.a, *v));
            let b = over(1).filter(|(v, _)| sure || of_b.has_facing_edge(pair.b, *v));
            self.vertices_of_a(pair, of_b, a, out);
            self.vertices_of_b(pair, of_a, b, out);
        } else {
            let motion_bound = MotionBound { displacement: SLAB * pair.size, rotation: 0.0 };
            facing.list(pair, self, self.slab, motion_bound);
            let FacingFeatures { pairs, vertices: [a, b], .. } = facing;
            for edges in pairs {
                let segments =
                    [(pair.a, 0), (pair.b, 1)].map(|(s, k)| frames[k].segment(s, edges[k]));
                self.crossing(pair, &frames[0], *edges, &segments, out);
            }
            self.vertices_of_a(pair, &frames[1], a.iter().map(|o| (o.vertex, &o.below)), out);
            self.vertices_of_b(pair, &frames[0], b.iter().map(|o| (o.vertex, &o.below)), out);
        }
    }

    /// Returns the gap at the vertex at `x`, in the other body's coordinates.
    ///
    /// The faces `below` it decide, except far behind them: once one of them has turned steep, the line may seem to
    /// enter the body where an unlisted face excludes it, below all corners of the gap.
    #[inline]
    fn gap_at(
        &self,
        into: &AxisFrame,
        other: &Polyhedron,
        below: &DecidingFaces,
        x: &Vec3,
    ) -> Option<f64> {
        let gap = into.distance(other, below, x, self.tolerance)?;
        if gap >= self.lowest {
            return Some(gap);
        }
        into.distance(other, &DecidingFaces::overflowed(), x, self.tolerance)
    }

    /// Appends vertices of A over B, with the faces that decide; `into` is the frame of B.
    fn vertices_of_a<'a>(
        &self,
        pair: &BodyPair,
        into: &AxisFrame,
        vertices: impl Iterator<Item = (usize, &'a DecidingFaces)>,
        out: &mut Vec<ManifoldPoint>,
    ) {
        for (v, below) in vertices {
            let point = &pair.a.vertices[v];
            let gap = self.gap_at(into, pair.b, below, &pair.point_in_b(point));
            self.vertex(feature::vertex(v), point, gap, 1.0, out);
        }
    }

    /// Appends vertices of B over A, with the faces that decide; `into` is the frame of A.
    fn vertices_of_b<'a>(
        &self,
        pair: &BodyPair,
        into: &AxisFrame,
        vertices: impl Iterator<Item = (usize, &'a DecidingFaces)>,
        out: &mut Vec<ManifoldPoint>,
    ) {
        for (v, below) in vertices {
            let point = pair.corner_of_b(v);
            let gap = self.gap_at(into, pair.a, below, &point);
            self.vertex(feature::vertex_of_b(v), &point, gap, -1.0, out);
        }
    }

    /// Appends the vertex at `point` if the other body is near; `side` is the axis's sign towards it.
    fn vertex(
        &self,
        feature: u64,
        point: &Vec3,
        gap: Option<f64>,
        side: f64,
        out: &mut Vec<ManifoldPoint>,
    ) {
        if let Some(gap) = gap.filter(|g| *g <= self.alert) {
            out.push(ManifoldPoint {
                point: point + self.normal * (0.5 * side * gap),
                gap,
                feature,
            });
        }
    }

    /// Appends the crossing of an edge of A with one of B; `of_a` is the frame of A.
    // Inlined, because a call would pass its arguments through memory.
    #[inline(always)]
    fn crossing(
        &self,
        pair: &BodyPair,
        of_a: &AxisFrame,
        edges: [usize; 2],
        [on_a, on_b]: &[ProjectedEdge; 2],
        out: &mut Vec<ManifoldPoint>,
    ) {
        let Some([s, t]) = crossing(on_a, on_b) else { return };
        let (x, y) = (on_a.at(s), on_b.at(t));
        let gap = y[2] - x[2];
        if gap <= self.alert {
            let [e0, e1, e2] = &of_a.axes;
            let point = e0 * x[0] + e1 * x[1] + e2 * (x[2] + 0.5 * gap);
            out.push(ManifoldPoint {
                point,
                gap,
                feature: feature::edges([pair.a, pair.b], edges, [s, t]),
            });
        }
    }
}

/// Returns the parameters at which two edges cross, seen along the axis, strictly between their ends.
fn crossing(a: &ProjectedEdge, b: &ProjectedEdge) -> Option<[f64; 2]> {
    let beside = |d: &[f64; 3], x: [f64; 2]| d[0] * x[1] - d[1] * x[0];
    let between = [b.start[0] - a.start[0], b.start[1] - a.start[1]];
    let far = [between[0] + b.along[0], between[1] + b.along[1]];
    let (p, q) = (beside(&a.along, between), beside(&a.along, far));
    if p * q >= 0.0 {
        return None;
    }
    let t = p / (p - q);
    let over = [between[0] + b.along[0] * t, between[1] + b.along[1] * t];
    let length_squared = a.along[0] * a.along[0] + a.along[1] * a.along[1];
    let s = (a.along[0] * over[0] + a.along[1] * over[1]) / length_squared;
    (s > 0.0 && s < 1.0).then_some([s, t])
}
