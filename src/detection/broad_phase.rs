//! Pairs of bodies that may touch before anything has moved by more than its box allows for: half a skin, or some steps of
//! its speed.
//!
//! Reads: model, motion, reach. Writes: [`PairList`]. Cost: a comparison per body and step; when a body has
//! moved too far, bounding boxes, a counting sort into cells and O(pairs).
//! Contract: the list holds every pair that is within reach of each other, and its order is canonical. It may hold
//! more, so what is found must not depend on pairs that are apart.

use super::grid::Grid;
use super::narrow_phase::PairMemory;
use super::reach::{self, Reach};
use super::travel::{self, Travel};
use crate::geometry::Polyhedron;
use crate::math::{Pose, Quat, Vec3};
use crate::model::{Model, Part};
use crate::motion::Motion;
use rayon::prelude::*;

/// Grains per unit of parallel work. Fixed, so that results do not depend on threads.
pub(super) const CHUNK: usize = 64;
/// Skin over the mean radius of the grains.
const SKIN: f64 = 0.1;
/// Steps for which the list should hold, however fast a body is: one stone that was flung would else have it rebuilt
/// in every step.
const LASTING: f64 = 4.0;

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Aabb {
    pub low: Vec3,
    pub high: Vec3,
}

impl Aabb {
    fn of(shape: &Polyhedron, pose: &Pose, margin: f64) -> Self {
        let r = pose.orientation.to_rotation_matrix().into_inner();
        let (mut low, mut high) = (Vec3::repeat(f64::INFINITY), Vec3::repeat(f64::NEG_INFINITY));
        for v in &shape.vertices {
            let x = r * v;
            low = low.inf(&x);
            high = high.sup(&x);
        }
        let margin = Vec3::repeat(margin);
        Self { low: pose.position + low - margin, high: pose.position + high + margin }
    }

    /// Whether the boxes have a common point.
    pub fn meets(&self, other: &Aabb) -> bool {
        self.low.x <= other.high.x
            && other.low.x <= self.high.x
            && self.low.y <= other.high.y
            && other.low.y <= self.high.y
            && self.low.z <= other.high.z
            && other.low.z <= self.high.z
    }
}

/// A part of a driven body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PartRef {
    /// Among the driven bodies.
    pub driven: u32,
    /// Among the body's parts.
    pub part: u32,
    pub half_space: bool,
}

/// Candidate pairs, by grain. An antagonist below the number of grains is a grain; above, it is
/// that number plus the index of a part in `parts`.
#[derive(Debug, Default)]
pub(super) struct PairList {
    /// Where each grain's pairs start `[ng + 1]`.
    pub starts: Vec<usize>,
    /// Antagonists, ascending for each grain `[np]`.
    pub antagonists: Vec<u32>,
    /// What the narrow phase remembers of each pair `[np]`.
    pub memory: Vec<PairMemory>,
    /// All parts of driven bodies, by body.
    pub parts: Vec<PartRef>,
    /// Of all bodies, from configuration to configuration for which pairs were examined.
    pub travel: Travel,
    built: Option<Built>,
    boxes: Vec<Aabb>,
    grid: Grid,
    fresh: Vec<Fresh>,
}

/// The configuration for which the list was built.
#[derive(Debug)]
struct Built {
    position: Vec<Vec3>,
    orientation: Vec<Quat>,
    /// Largest distance of a point of a body from its origin `[nb]`, m.
    extent: Vec<f64>,
    /// Shares in the distances up to which contacts are looked for `[nb]`, m.
    share: Vec<f64>,
    /// By how much a body may move, and its share grow, before the list is rebuilt `[nb]`, m.
    slack: Vec<f64>,
    identity: Identity,
}

/// By which a model is known again: pairs' memory is about shapes.
#[derive(Debug, PartialEq)]
struct Identity {
    /// Of the grains.
    shape: Vec<u32>,
    shapes: Vec<ShapeMark>,
    parts: Vec<Vec<Part>>,
}

/// Tells shapes apart without comparing all their features: no two different ones agree in all
/// digits of these.
#[derive(Debug, PartialEq)]
struct ShapeMark {
    counts: [usize; 3],
    radius: f64,
    volume: f64,
    unit_inertia: Vec3,
}

impl ShapeMark {
    fn of(s: &Polyhedron) -> Self {
        let counts = [s.vertices.len(), s.edges.len(), s.face_count()];
        Self { counts, radius: s.radius, volume: s.volume, unit_inertia: s.unit_inertia }
    }
}

impl Identity {
    fn of(model: &Model) -> Self {
        Self {
            shape: model.grains.shape.clone(),
            shapes: model.shapes.iter().map(ShapeMark::of).collect(),
            parts: model.driven.iter().map(|d| d.parts.clone()).collect(),
        }
    }

    fn is_of(&self, model: &Model) -> bool {
        self.shape == model.grains.shape
            && self.shapes.len() == model.shapes.len()
            && self.shapes.iter().zip(&model.shapes).all(|(m, s)| *m == ShapeMark::of(s))
            && self.parts.len() == model.driven.len()
            && self.parts.iter().zip(&model.driven).all(|(p, d)| *p == d.parts)
    }
}

/// Pairs of one chunk of grains in a new list.
#[derive(Debug, Default)]
struct Fresh {
    counts: Vec<usize>,
    antagonists: Vec<u32>,
    memory: Vec<PairMemory>,
}

impl PairList {
    /// Brings the list up to date: rebuilt if the model is another one, or if a body has moved, and its reach grown, by
    /// more than it was given. Pairs of another model are forgotten.
    pub fn update(&mut self, model: &Model, motion: &Motion, reach: &Reach) {
        let known = self.built.take().filter(|b| b.identity.is_of(model));
        if known.is_none() {
            self.starts.clear();
            self.travel.clear();
        }
        if let Some(built) = known
            && built.still_holds(motion, reach)
        {
            self.built = Some(built);
        } else {
            self.rebuild(model, motion, reach);
        }
    }

    /// Adds to the bodies' travel their way to the configuration in which pairs will be examined.
    pub fn advance(&mut self, motion: &Motion) {
        if let Some(built) = &self.built {
            self.travel.update(motion, &built.extent);
        }
    }

    fn rebuild(&mut self, model: &Model, motion: &Motion, reach: &Reach) {
        let ng = model.grains.len();
        self.parts = parts_of(model);
        let built = Built::new(model, motion, reach);
        let boxes: Vec<Aabb> = (0..ng)
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let shape = &model.shapes[model.grains.shape[i] as usize];
                Aabb::of(shape, &pose(motion, i), built.margin(i))
            })
            .collect();
        self.boxes = boxes;
        self.grid.build(&self.boxes);
        let mut extra = self.grid.large_pairs(&self.boxes);
        self.part_pairs(model, motion, &built, &mut extra);
        extra.sort_unstable();
        self.fill(ng, &extra);
        self.built = Some(built);
    }

    /// Pairs of grains and convex parts.
    fn part_pairs(&self, model: &Model, motion: &Motion, built: &Built, out: &mut Vec<(u32, u32)>) {
        let ng = model.grains.len();
        for (k, part) in self.parts.iter().enumerate() {
            let body = part.driven as usize;
            if let Part::Convex { shape, pose: local } =
                &model.driven[body].parts[part.part as usize]
            {
                let placed = pose(motion, ng + body).then(local);
                let bounds =
                    Aabb::of(&model.shapes[*shape as usize], &placed, built.margin(ng + body));
                self.grid
                    .for_each_meeting(&self.boxes, &bounds, |i| out.push((i, (ng + k) as u32)));
            }
        }
    }

    /// Collects all pairs by chunk, then joins them; pairs of the old list keep their memory.
    fn fill(&mut self, ng: usize, extra: &[(u32, u32)]) {
        let mut fresh = std::mem::take(&mut self.fresh);
        fresh.resize_with(ng.div_ceil(CHUNK), Fresh::default);
        fresh.par_iter_mut().enumerate().for_each(|(c, chunk)| {
            chunk.collect(self, c * CHUNK..ng.min((c + 1) * CHUNK), extra);
        });
        self.starts.clear();
        self.antagonists.clear();
        self.memory.clear();
        self.starts.push(0);
        for chunk in &mut fresh {
            for count in &chunk.counts {
                self.starts.push(self.starts[self.starts.len() - 1] + count);
            }
            self.antagonists.extend_from_slice(&chunk.antagonists);
            self.memory.append(&mut chunk.memory);
        }
        self.fresh = fresh;
    }

    /// Old pairs of grain `i`.
    fn old(&self, i: usize) -> std::ops::Range<usize> {
        if i + 1 < self.starts.len() { self.starts[i]..self.starts[i + 1] } else { 0..0 }
    }
}

impl Fresh {
    fn collect(&mut self, list: &PairList, grains: std::ops::Range<usize>, extra: &[(u32, u32)]) {
        self.counts.clear();
        self.antagonists.clear();
        self.memory.clear();
        let mut next = extra.partition_point(|e| (e.0 as usize) < grains.start);
        for i in grains {
            let first = self.antagonists.len();
            list.grid.for_each_above(&list.boxes, i as u32, |j| self.antagonists.push(j));
            while next < extra.len() && extra[next].0 as usize == i {
                self.antagonists.push(extra[next].1);
                next += 1;
            }
            self.antagonists[first..].sort_unstable();
            // Cells that share a bucket report a pair more than once.
            let mut kept = first;
            for k in first..self.antagonists.len() {
                if k == first || self.antagonists[k] != self.antagonists[kept - 1] {
                    self.antagonists[kept] = self.antagonists[k];
                    kept += 1;
                }
            }
            self.antagonists.truncate(kept);
            self.counts.push(kept - first);
            self.recall(list, list.old(i), first);
        }
    }

    /// Memory of the pairs from `first` on, out of the old list's range.
    fn recall(&mut self, list: &PairList, old: std::ops::Range<usize>, first: usize) {
        let mut k = old.start;
        for j in &self.antagonists[first..] {
            while k < old.end && list.antagonists[k] < *j {
                k += 1;
            }
            let known = k < old.end && list.antagonists[k] == *j;
            self.memory.push(if known { list.memory[k].clone() } else { PairMemory::default() });
        }
    }
}

impl Built {
    fn new(model: &Model, motion: &Motion, reach: &Reach) -> Self {
        let ng = model.grains.len();
        let extent: Vec<f64> = (0..model.body_count()).map(|b| reach::extent(model, b)).collect();
        let mean = extent[..ng].iter().sum::<f64>() / ng.max(1) as f64;
        let bodies = 0..reach.body_count();
        Self {
            position: motion.position.clone(),
            orientation: motion.orientation.clone(),
            extent,
            share: bodies.clone().map(|b| reach.share(b)).collect(),
            slack: bodies.map(|b| (0.5 * SKIN * mean).max(LASTING * reach.way(b))).collect(),
            identity: Identity::of(model),
        }
    }

    /// What the box of body `b` is wider than the body.
    fn margin(&self, b: usize) -> f64 {
        self.share[b] + self.slack[b]
    }

    /// Whether no body has used up its slack by moving or by a larger reach.
    fn still_holds(&self, motion: &Motion, reach: &Reach) -> bool {
        let used_up = |b: usize| {
            let turn = travel::turn(&motion.orientation[b], &self.orientation[b]);
            let path = (motion.position[b] - self.position[b]).norm() + self.extent[b] * turn;
            let used = path + (reach.share(b) - self.share[b]).max(0.0);
            used.is_nan() || used > self.slack[b]
        };
        self.position.len() == motion.position.len()
            && !(0..self.position.len()).into_par_iter().with_min_len(4096).any(used_up)
    }
}

/// All parts of driven bodies, by body.
fn parts_of(model: &Model) -> Vec<PartRef> {
    let body = |(d, b): (usize, &crate::model::DrivenBody)| {
        let part = move |(p, part): (usize, &Part)| PartRef {
            driven: d as u32,
            part: p as u32,
            half_space: matches!(part, Part::HalfSpace { .. }),
        };
        b.parts.iter().enumerate().map(part).collect::<Vec<_>>()
    };
    model.driven.iter().enumerate().flat_map(body).collect()
}

/// Pose of body `b` at configuration m.
pub(super) fn pose(motion: &Motion, b: usize) -> Pose {
    Pose { position: motion.position[b], orientation: motion.orientation[b] }
}
