//! What is reported along the axis that was chosen.

use super::closest::ClosestPoints;
use super::edges::EdgeAxis;
use super::pair::{self, Pair};
use super::reduce::{self, Candidate};
use super::{Point, SLAB, Scratch, TIE, Touching, feature, patch};
use crate::math::Vec3;

/// Points of a patch closer than this, over the radii, count as one.
const LOOSE: f64 = 1e-7;

/// The best face of either body.
#[derive(Debug, Clone, Copy)]
pub struct BestFace {
    pub of_b: bool,
    /// From A to B, in the frame of A.
    pub normal: Vec3,
    pub separation: f64,
}

impl BestFace {
    /// As the axis that was chosen.
    pub fn chosen(&self) -> Chosen {
        Chosen { normal: self.normal, separation: self.separation, edges: None }
    }
}

/// The axis that was chosen, for the next steps.
#[derive(Debug, Clone, Copy)]
pub struct Chosen {
    pub normal: Vec3,
    pub separation: f64,
    pub edges: Option<[usize; 2]>,
}

impl Pair<'_> {
    /// Reports the contact of two edges, `c` being their closest points, and remembers them.
    pub fn push_edges(
        &self,
        e: &EdgeAxis,
        c: &ClosestPoints,
        memory: &mut Touching,
        scratch: &mut Scratch,
    ) -> Chosen {
        memory.edges = e.edges.map(|e| e as u32 + 1);
        self.push_closest(c, &e.normal, e.separation, memory, scratch);
        Chosen { normal: e.normal, separation: e.separation, edges: Some(e.edges) }
    }

    /// Reports the contact of bodies whose closest points are `c`.
    pub fn push_closest(
        &self,
        c: &ClosestPoints,
        normal: &Vec3,
        gap: f64,
        memory: &mut Touching,
        scratch: &mut Scratch,
    ) {
        let closest = || {
            let feature = feature::edges([self.a, self.b], c.edges, c.parameter);
            Candidate { point: (c.on_a + c.on_b) * 0.5, gap, feature }
        };
        self.find_patch(normal, gap, memory, scratch);
        self.push_patch(normal, gap, closest, scratch);
    }

    /// Reports the contact along a face's normal, its patch in `scratch.candidates`.
    pub fn push_face(&self, face: &BestFace, scratch: &mut Scratch) -> Chosen {
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
            Candidate { point, gap: *gap, feature }
        };
        self.push_patch(normal, *gap, closest, scratch);
        face.chosen()
    }

    /// Reports the four of `scratch.candidates`, the patch along `normal`, that best stand for it.
    ///
    /// `closest` is where the gap is the axis's separation, which no corner's is below but for
    /// rounding; it is reported if rounding hides it from the patch.
    fn push_patch(
        &self,
        normal: &Vec3,
        separation: f64,
        closest: impl Fn() -> Candidate,
        scratch: &mut Scratch,
    ) {
        let Scratch { candidates, hull, .. } = scratch;
        if lowest_gap(candidates) > separation + LOOSE * self.size {
            let closest = closest();
            candidates.retain(|c| c.feature != closest.feature);
            candidates.push(closest);
        }
        reduce::keep_four(candidates, normal, self.alert, self.size, hull);
        if let Some(d) = candidates.iter_mut().min_by(|c, d| c.gap.total_cmp(&d.gap)) {
            d.gap = separation;
        }
        candidates.iter_mut().for_each(|c| c.gap = c.gap.max(separation));
        self.report(normal, scratch);
    }

    /// Fills `scratch.candidates` with the corners of the gap along `n`, in the frame of A.
    pub fn find_patch(
        &self,
        n: &Vec3,
        separation: f64,
        memory: &mut Touching,
        scratch: &mut Scratch,
    ) {
        let axis = patch::Axis {
            normal: *n,
            alert: self.alert,
            lowest: separation - LOOSE * self.size,
            slab: (self.alert - separation).max(0.0) + SLAB * self.size,
            tolerance: TIE * self.size,
        };
        let Touching { patch, patch_worth, .. } = memory;
        axis.corners(self, patch, patch_worth, &mut scratch.sides, &mut scratch.candidates);
    }

    /// Turns the candidates, at most four and in the frame of A, into contact points of the world.
    fn report(&self, normal: &Vec3, scratch: &mut Scratch) {
        let pose = &self.pose;
        let normal = -(pose.orientation * normal);
        scratch.points.extend(scratch.candidates.iter().map(|c| Point {
            feature: c.feature,
            point: pose.point(&c.point),
            normal,
            gap: c.gap,
        }));
    }
}

/// The first of the candidates of lowest gap.
pub fn deepest(candidates: &[Candidate]) -> Option<&Candidate> {
    candidates.iter().reduce(|d, c| if c.gap < d.gap { c } else { d })
}

/// The lowest gap, infinite if there are no candidates.
pub fn lowest_gap(candidates: &[Candidate]) -> f64 {
    deepest(candidates).map_or(f64::INFINITY, |c| c.gap)
}
