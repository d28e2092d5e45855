//! Search for the axis of largest separation.

use super::candidate_axes::CandidateAxes;
use super::edges::{self, ClosestPoints, EdgeAxis, NearEdge};
use super::frame::MotionBound;
use super::memory::{ContactCache, Scratch};
use super::pair::{self, BodyPair, FaceAxes, FaceAxis, SLAB, TIE};
use super::report::{BestAxis, BestFace, deepest, lowest_gap};
use super::separation;
use crate::geometry::Polyhedron;
use crate::math::Vec3;

/// Minimum distance of a unique closest point from both ends of its edge, over the edge's length.
const MIN_END_DISTANCE: f64 = 1e-6;

/// Result of a search. `Err` is a direction (A to B, frame of A) along which the bodies are more than `alert` apart.
type SearchResult<T> = Result<T, Vec3>;

impl BodyPair<'_> {
    /// Finds the best axis and reports the contact points along it.
    pub fn search(&self, cache: &mut ContactCache, scratch: &mut Scratch) -> SearchResult<()> {
        if let Some(found) = self.search_candidates(cache, scratch) {
            cache.axes_backoff.record_hit();
            return found;
        }
        cache.candidate_axes.clear();
        let rebuilds = cache.axes_backoff.should_rebuild();
        scratch.edge_pairs.list.clear();
        scratch.edge_pairs.max_distance = None;
        let motion_bound =
            if rebuilds { CandidateAxes::motion_bound(self) } else { MotionBound::none(self) };
        let chosen = self.search_all(motion_bound, cache, scratch)?;
        if let (true, Some(BestAxis { normal, separation, edges })) = (rebuilds, chosen) {
            let points = &scratch.candidates;
            let sum = points.iter().fold(Vec3::zeros(), |sum, c| sum + c.point);
            let middle = sum / points.len() as f64;
            let pairs = &scratch.edge_pairs;
            cache.candidate_axes.rebuild(self, &normal, separation, &middle, edges, pairs);
        }
        Ok(())
    }

    /// Searches the cached candidate axes. Returns `None` if none of them is certainly the best.
    fn search_candidates(
        &self,
        cache: &mut ContactCache,
        scratch: &mut Scratch,
    ) -> Option<SearchResult<()>> {
        let others = cache.candidate_axes.bounds(self)?;
        let face = match self.best_listed_face(&cache.candidate_axes, others.more) {
            Ok(face) => face,
            Err(apart) => return Some(Err(apart)),
        };
        let floor = face.map_or(f64::NEG_INFINITY, |f| f.separation + TIE * self.size);
        let pairs =
            cache.candidate_axes.edges.iter().map(|(edges, most)| (edges, most + others.more));
        let crossing = cache.candidate_axes.crossing;
        let supports = &cache.candidate_axes.supports;
        let separation = |n: &Vec3| supports.separation(self, n);
        if let Some(e) = edges::best_edge_axis(self, pairs, None, floor, crossing, separation) {
            if e.separation > self.alert {
                return Some(Err(e.normal));
            }
            let above =
                if e.separation > 0.0 { others.faces } else { others.faces.max(others.edges) };
            let closest = e.closest();
            let sure = if e.separation > 0.0 {
                self.are_closest(&e, &closest)
            } else {
                closest.distance_squared
                    <= cache.candidate_axes.max_distance * cache.candidate_axes.max_distance
            };
            if sure && e.separation > above {
                self.report_edges(&e, &closest, cache, scratch);
                return Some(Ok(()));
            }
            if e.separation <= 0.0 || face.is_none_or(|f| f.separation <= 0.0) {
                return None;
            }
        }
        let face = face.filter(|f| f.separation > others.faces)?;
        if face.separation > 0.0 {
            let chosen = self.report_separated_face(&face, cache, scratch);
            if matches!(chosen, Ok(BestAxis { edges: Some(_), .. })) {
                // Not on the list, and the best now.
                cache.candidate_axes.clear();
            }
            return Some(chosen.map(|_| ()));
        }
        if face.separation <= others.edges {
            return None;
        }
        self.find_patch(&face.normal, face.separation, cache, scratch);
        let max_distance = cache.candidate_axes.max_distance;
        if deepest(&scratch.candidates).is_none_or(|c| c.gap.abs() > max_distance) {
            return None;
        }
        self.report_face(&face, scratch);
        Some(Ok(()))
    }

    /// Searches all axes; `motion_bound` bounds the motion for which pairs of edges are listed.
    fn search_all(
        &self,
        motion_bound: MotionBound,
        cache: &mut ContactCache,
        scratch: &mut Scratch,
    ) -> SearchResult<Option<BestAxis>> {
        let face = self.best_face(&mut cache.faces)?;
        let floor = face.separation + TIE * self.size;
        let known = self.known_edges(&cache.edges);
        cache.edges = [0; 2];
        if let Some(e) = &known {
            if e.separation > self.alert {
                return Err(e.normal);
            }
            if e.separation > floor.max(0.0) {
                let closest = e.closest();
                if self.are_closest(e, &closest) {
                    return Ok(Some(self.report_edges(e, &closest, cache, scratch)));
                }
            }
        }
        if face.separation > 0.0 {
            return self.report_separated_face(&face, cache, scratch).map(Some);
        }
        let known = known.filter(|e| e.separation > floor && e.separation <= 0.0);
        match self.best_edges(&face, known, motion_bound, cache, scratch)? {
            Some(e) if e.separation > self.alert => Err(e.normal),
            Some(e) => {
                let closest = e.closest();
                if e.separation <= 0.0 || self.are_closest(&e, &closest) {
                    Ok(Some(self.report_edges(&e, &closest, cache, scratch)))
                } else {
                    self.report_closest_features(&e.normal, e.separation, cache, scratch)?;
                    Ok(None)
                }
            }
            None => {
                // The patch along the face's axis has been found already.
                Ok(Some(self.report_face(&face, scratch)))
            }
        }
    }

    /// Reports the contact of bodies that a face separates by no more than the alert distance.
    fn report_separated_face(
        &self,
        face: &BestFace,
        cache: &mut ContactCache,
        scratch: &mut Scratch,
    ) -> SearchResult<BestAxis> {
        self.find_patch(&face.normal, face.separation, cache, scratch);
        // Points of both surfaces that are as close as the axis says: nothing is closer.
        if lowest_gap(&scratch.candidates) <= face.separation + TIE * self.size {
            return Ok(self.report_face(face, scratch));
        }
        let chosen = self.report_closest_features(&face.normal, face.separation, cache, scratch)?;
        Ok(chosen.unwrap_or(face.chosen()))
    }

    /// Reports the contact of bodies that are further apart than the best axis shows: edges or vertices are closest.
    ///
    /// `normal` and `separation` are those of the best axis. Returns the axis of two edges if it is better.
    fn report_closest_features(
        &self,
        normal: &Vec3,
        separation: f64,
        cache: &mut ContactCache,
        scratch: &mut Scratch,
    ) -> SearchResult<Option<BestAxis>> {
        self.gather_near_edges(normal, [self.alert - separation; 2], scratch);
        let (near_a, near_b) = (&scratch.near_a, &scratch.near_b);
        let Some(c) = edges::closest_points(near_a, near_b, self.alert + SLAB * self.size) else {
            // Separated. The next step searches again unless this direction happens to separate.
            let any = edges::closest_points(near_a, near_b, f64::INFINITY);
            return Err(any.map_or(*normal, |c| (c.on_b - c.on_a).normalize()));
        };
        let distance = c.distance_squared.sqrt();
        if distance > self.alert {
            return Err((c.on_b - c.on_a) / distance);
        }
        match edges::axis_of(self, c.edges, f64::NEG_INFINITY, false, |n| self.separation(n)) {
            Some(e) if e.separation > separation && self.are_closest(&e, &c) => {
                return Ok(Some(self.report_edges(&e, &c, cache, scratch)));
            }
            _ if distance > separation + TIE * self.size => {
                let normal = (c.on_b - c.on_a) / distance;
                self.report_closest(&c, &normal, distance, cache, scratch);
            }
            // Rounding alone leads here.
            _ => self.report_closest(&c, normal, separation, cache, scratch),
        }
        Ok(None)
    }

    /// Returns the best of all faces; `hint` holds the numbers plus one of the last best faces of A and of B, or
    /// zero.
    fn best_face(&self, hint: &mut [u32; 2]) -> SearchResult<BestFace> {
        let (of_a, of_b) = (self.faces_of_a(), self.faces_of_b());
        let (alert, none) = (self.alert, f64::NEG_INFINITY);
        let start = |faces: &FaceAxes, hint: u32| {
            let known = (hint as usize).checked_sub(1).filter(|f| *f < faces.own.face_count());
            known.unwrap_or_else(|| faces.most_aligned())
        };
        let on_a = pair::best_face_axis(&of_a, start(&of_a, hint[0]), none, alert, self.size)
            .map_err(|f| self.face_of_a(f))?;
        let floor = on_a.separation;
        let on_b = pair::best_face_axis(&of_b, start(&of_b, hint[1]), floor, alert, self.size)
            .map_err(|f| self.face_of_b(f))?;
        *hint = [on_a.face, on_b.face].map(|f| f as u32 + 1);
        Ok(if on_b.separation > floor + TIE * self.size {
            BestFace { of_b: true, normal: self.face_of_b(on_b.face), separation: on_b.separation }
        } else {
            BestFace { of_b: false, normal: self.face_of_a(on_a.face), separation: floor }
        })
    }

    /// Returns the best of the listed faces, if any; no separation exceeds its bound by `more`.
    fn best_listed_face(&self, lists: &CandidateAxes, more: f64) -> SearchResult<Option<BestFace>> {
        let (of_a, of_b) = (self.faces_of_a(), self.faces_of_b());
        let mut best: [Option<FaceAxis>; 2] = [None; 2];
        let mut most = f64::NEG_INFINITY;
        for ([side, face], bound) in lists.faces.iter() {
            if bound + more < most {
                break;
            }
            let supports = &lists.supports;
            let (axis, separation) = if side == 0 {
                let axis = self.face_of_a(face);
                (axis, of_a.separation_by(face, |p, n| supports.lowest_of_b(&axis, p, n)))
            } else {
                let axis = self.face_of_b(face);
                (axis, of_b.separation_by(face, |p, n| supports.lowest_of_a(&axis, p, n)))
            };
            if separation > self.alert {
                return Err(axis);
            }
            let found = FaceAxis { face, separation };
            if best[side].is_none_or(|b| found.beats(&b)) {
                best[side] = Some(found);
            }
            most = pair::larger(separation, most);
        }
        let [on_a, on_b] = best;
        let floor = on_a.map_or(f64::NEG_INFINITY, |a| a.separation + TIE * self.size);
        let best = match on_b.filter(|b| b.separation > floor) {
            Some(b) => Some((true, self.face_of_b(b.face), b.separation)),
            None => on_a.map(|a| (false, self.face_of_a(a.face), a.separation)),
        };
        Ok(best.map(|(of_b, normal, separation)| BestFace { of_b, normal, separation }))
    }

    /// Returns the normal of face `f` of A.
    fn face_of_a(&self, f: usize) -> Vec3 {
        self.a.face_normals[f]
    }

    /// Returns the normal of face `f` of B, into B.
    fn face_of_b(&self, f: usize) -> Vec3 {
        -(self.rotation * self.b.face_normals[f])
    }

    /// Lists the edges with an end at most `slabs` (m) off the support planes along `n`.
    fn gather_near_edges(&self, n: &Vec3, slabs: [f64; 2], scratch: &mut Scratch) {
        // Finite, so that heights are numbers when all edges are wanted.
        let [slab_a, slab_b] = slabs.map(|s| (s + SLAB * self.size).min(10.0 * self.size));
        let Scratch { heights, near_a, near_b, .. } = scratch;
        heights_over(self.a, &-n, slab_a, heights);
        near_edges(self.a, heights, near_a, |e, h| {
            let [left, right] = self.a.edges[e].faces;
            let normal = |f| self.a.face_normals[usize::from(f)];
            NearEdge::below(edges::edge_of_a(self, e), [normal(left), normal(right)], h)
        });
        heights_over(self.b, &self.in_b(n), slab_b, heights);
        near_edges(self.b, heights, near_b, |e, h| {
            let [left, right] = self.b.edges[e].faces;
            let normal = |f| self.rotation * self.b.face_normals[usize::from(f)];
            NearEdge::below(edges::edge_of_b(self, e), [normal(left), normal(right)], h)
        });
    }

    /// Returns the axis of the edges that were closest in an earlier step, if they still make one.
    fn known_edges(&self, edges: &[u32; 2]) -> Option<EdgeAxis> {
        let [ea, eb] = edges.map(|e| e as usize);
        if ea == 0 || eb == 0 || ea > self.a.edges.len() || eb > self.b.edges.len() {
            return None;
        }
        edges::axis_of(self, [ea - 1, eb - 1], f64::NEG_INFINITY, false, |n| self.separation(n))
    }

    /// True if the closest points `c` of two edges are those of the bodies.
    ///
    /// They are if they lie strictly inside both edges at a distance equal to the separation of their axis.
    fn are_closest(&self, e: &EdgeAxis, c: &ClosestPoints) -> bool {
        let [a, b] = &e.on;
        c.parameter.iter().all(|t| *t > MIN_END_DISTANCE && *t < 1.0 - MIN_END_DISTANCE)
            && !edges::are_nearly_parallel(a, b)
            && c.distance_squared.sqrt() <= e.separation + TIE * self.size
    }

    /// Returns the best axis perpendicular to two edges, if it is better than the best face of bodies that no face
    /// separates.
    ///
    /// `known` is such an axis, if one is known. The edges near the face decide ([`edges`]) as soon as the bodies are
    /// known to overlap or to be at most `max_distance` apart, the larger of the depth and the alert distance. Otherwise the
    /// bodies are separated by a facet that is no face.
    fn best_edges(
        &self,
        face: &BestFace,
        known: Option<EdgeAxis>,
        motion_bound: MotionBound,
        cache: &mut ContactCache,
        scratch: &mut Scratch,
    ) -> SearchResult<Option<EdgeAxis>> {
        let floor = face.separation + TIE * self.size;
        self.list_edge_pairs(face, motion_bound, scratch);
        let best = edges::best_edge_axis(
            self,
            scratch.edge_pairs.list.iter().map(|edges| (*edges, f64::INFINITY)),
            known,
            floor,
            false,
            |n| self.separation(n),
        );
        let max_distance = self.alert.max(-face.separation);
        if let Some(e) = &best
            && (e.separation > 0.0 || e.closest().distance_squared <= max_distance * max_distance)
        {
            return Ok(best);
        }
        self.find_patch(&face.normal, face.separation, cache, scratch);
        if deepest(&scratch.candidates).is_some_and(|c| c.gap.abs() <= max_distance) {
            return Ok(best);
        }
        // Neither a separating axis nor near points of both bodies are known.
        if let Some((apart, _)) = separation::direction(self, None) {
            return Err(apart);
        }
        scratch.edge_pairs.max_distance = None;
        Ok(self.best_edges_of_all(known, floor))
    }

    /// Returns the best axis over all pairs of edges.
    fn best_edges_of_all(&self, known: Option<EdgeAxis>, floor: f64) -> Option<EdgeAxis> {
        let of_b = 0..self.b.edges.len();
        let pairs = (0..self.a.edges.len())
            .flat_map(|a| of_b.clone().map(move |b| ([a, b], f64::INFINITY)));
        edges::best_edge_axis(self, pairs, known, floor, false, |n| self.separation(n))
    }

    /// Lists the pairs of edges that may be the best axis while the bodies move within `motion_bound`.
    ///
    /// In such a configuration the face's axis, fixed in A, shows a depth of at most the present one plus `displacement`.
    /// Heights of A along it do not change, those of B change by at most twice `displacement`.
    fn list_edge_pairs(&self, face: &BestFace, motion_bound: MotionBound, scratch: &mut Scratch) {
        let MotionBound { displacement: path, rotation: turn } = motion_bound;
        let depth = path - face.separation;
        let max_distance = depth.max(self.alert);
        scratch.edge_pairs.max_distance = Some(max_distance);
        self.gather_near_edges(
            &face.normal,
            [depth + max_distance, depth + max_distance + 2.0 * path],
            scratch,
        );
        let max_distance = max_distance + path + SLAB * self.size;
        let Scratch { near_a, near_b, edge_pairs, .. } = scratch;
        for a in near_a {
            let near =
                near_b.iter().filter(|b| a.may_reach(b, max_distance) && a.may_cross(b, turn));
            edge_pairs.list.extend(near.map(|b| [a.index, b.index]));
        }
    }
}

/// Fills `heights` with the height of each vertex over the plane `slab` above the lowest one along `n`.
fn heights_over(shape: &Polyhedron, n: &Vec3, slab: f64, heights: &mut Vec<f64>) {
    let limit = pair::lowest(&shape.vertices, n) + slab;
    heights.clear();
    heights.extend(shape.vertices.iter().map(|v| n.x * v.x + n.y * v.y + n.z * v.z - limit));
}

/// Fills `out` with the edges that have an end with `heights <= 0`.
fn near_edges(
    shape: &Polyhedron,
    heights: &[f64],
    out: &mut Vec<NearEdge>,
    load: impl Fn(usize, [f64; 2]) -> NearEdge,
) {
    out.clear();
    for (index, edge) in shape.edges.iter().enumerate() {
        let [start, end] = edge.vertices;
        let ends = [heights[start as usize], heights[end as usize]];
        if ends[0] <= 0.0 || ends[1] <= 0.0 {
            out.push(load(index, ends));
        }
    }
}
