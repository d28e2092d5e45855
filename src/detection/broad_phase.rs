//! List of body pairs that may touch until a body has moved by more than the margin of its box.
//!
//! The margin is half a skin, or the displacement at its speed in some steps. Reads: model, motion, detection range.
//! Writes: [`PairList`]. Cost: a comparison per body and step; after a large motion, bounding boxes, a counting sort
//! into cells and O(pairs). Contract: the list contains every pair within its detection distance, in canonical order.
//! It may contain more, so results must not depend on separated pairs.

use super::grid::CellGrid;
use super::narrow_phase::PairCache;
use super::range::{self, DetectionRange};
use super::travel::{self, TravelledDistance};
use crate::geometry::{AxisBox, Polyhedron};
use crate::math::{Pose, Quat, Vec3};
use crate::model::{Model, Part};
use crate::motion::Motion;
use rayon::prelude::*;
use std::mem::take;
use std::ops::Range;

/// Grains per unit of parallel work. Fixed, so that results do not depend on threads.
pub(super) const CHUNK: usize = 64;
/// Skin over the mean radius of the grains.
const SKIN: f64 = 0.1;
/// Minimum lifetime of the list in steps, however fast a body is.
///
/// Without it, one fast grain would force a rebuild in every step.
const MAX_SKIN_LIFETIME_STEPS: f64 = 4.0;

/// Part of a driven body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PartRef {
    /// Number among the driven bodies.
    pub driven: u32,
    /// Number among the body's parts.
    pub part: u32,
    pub half_space: bool,
}

/// Candidate pairs, by grain.
///
/// An antagonist below the number of grains is a grain; above, it is that number plus an index into `parts`.
#[derive(Debug, Default)]
pub(super) struct PairList {
    /// Start of each grain's pairs `[ng + 1]`.
    pub starts: Vec<usize>,
    /// Antagonists, ascending for each grain `[np]`.
    pub antagonists: Vec<u32>,
    /// Caches of the narrow phase for each pair `[np]`.
    pub memory: Vec<PairCache>,
    /// Parts of all driven bodies, by body.
    pub parts: Vec<PartRef>,
    /// Path lengths of all bodies between configurations in which pairs were examined.
    pub travel: TravelledDistance,
    listed: ListedConfiguration,
    boxes: Vec<AxisBox>,
    grid: CellGrid,
    /// Pairs of large boxes and of parts, which the grid does not list by grain.
    extra: Vec<(u32, u32)>,
    chunk_pairs: Vec<ChunkPairs>,
}

/// Configuration for which the list was built.
#[derive(Debug, Default)]
struct ListedConfiguration {
    position: Vec<Vec3>,
    orientation: Vec<Quat>,
    /// Largest distance of a point of a body from its origin `[nb]`, m.
    bounding_radius: Vec<f64>,
    /// Contributions of bodies to detection distances `[nb]`, m.
    range: Vec<f64>,
    /// Sum of displacement and growth of range that a body may reach before a rebuild `[nb]`, m.
    slack: Vec<f64>,
    fingerprint: ModelFingerprint,
}

/// Identity of a model. Caches of pairs refer to shapes.
#[derive(Debug, Default)]
struct ModelFingerprint {
    /// Shapes of the grains.
    shape: Vec<u32>,
    /// Numbers of vertices, edges and faces of each shape.
    counts: Vec<[usize; 3]>,
    /// Vertices of all shapes in order; only they distinguish a rotated or mirrored shape.
    corners: Vec<Vec3>,
    parts: Vec<Vec<Part>>,
}

fn counts(s: &Polyhedron) -> [usize; 3] {
    [s.vertices.len(), s.edges.len(), s.face_count()]
}

impl ModelFingerprint {
    fn record(&mut self, model: &Model) {
        self.shape.clone_from(&model.grains.shape);
        self.counts.clear();
        self.counts.extend(model.shapes.iter().map(counts));
        self.corners.clear();
        self.corners.extend(model.shapes.iter().flat_map(|s| &s.vertices));
        self.parts.clear();
        self.parts.extend(model.driven.iter().map(|d| d.parts.clone()));
    }

    fn matches(&self, model: &Model) -> bool {
        let mut corners = &self.corners[..];
        let mut are_corners =
            |of: &[Vec3]| corners.split_off(..of.len()).is_some_and(|known| known == of);
        self.shape == model.grains.shape
            && self.counts.len() == model.shapes.len()
            && self
                .counts
                .iter()
                .zip(&model.shapes)
                .all(|(known, s)| *known == counts(s) && are_corners(&s.vertices))
            && self.parts.len() == model.driven.len()
            && self.parts.iter().zip(&model.driven).all(|(p, d)| *p == d.parts)
    }
}

/// Pairs of one chunk of grains in a new list.
#[derive(Debug, Default)]
struct ChunkPairs {
    counts: Vec<usize>,
    antagonists: Vec<u32>,
    memory: Vec<PairCache>,
}

impl PairList {
    /// Updates the list: rebuilds it for another model, or if a body has moved or its range has grown by more than
    /// its slack.
    ///
    /// Pairs of another model are dropped.
    pub fn update(&mut self, model: &Model, motion: &Motion, range: &DetectionRange) {
        let known = self.listed.fingerprint.matches(model);
        if !known {
            self.listed.fingerprint.record(model);
            self.parts = part_refs(model);
            self.starts.clear();
            self.starts.resize(model.grains.len() + 1, 0);
            self.antagonists.clear();
            self.memory.clear();
            self.travel.clear();
        }
        if !known || !self.listed.is_valid(motion, range) {
            self.rebuild(model, motion, range);
        }
    }

    /// Adds the displacement to the configuration in which pairs will be examined to the bodies' path lengths.
    pub fn advance(&mut self, motion: &Motion) {
        self.travel.update(motion, &self.listed.bounding_radius);
    }

    fn rebuild(&mut self, model: &Model, motion: &Motion, range: &DetectionRange) {
        let ng = model.grains.len();
        self.listed.record(model, motion, range);
        let listed = &self.listed;
        (0..ng)
            .into_par_iter()
            .with_min_len(256)
            .map(|i| {
                let shape = &model.shapes[model.grains.shape[i] as usize];
                bounds(shape, &motion.pose(i), listed.margin(i))
            })
            .collect_into_vec(&mut self.boxes);
        self.grid.build(&self.boxes);
        self.extra.clear();
        self.grid.large_pairs(&self.boxes, &mut self.extra);
        self.part_pairs(model, motion);
        self.extra.sort_unstable();
        self.fill(ng);
    }

    /// Adds pairs of grains and convex parts.
    fn part_pairs(&mut self, model: &Model, motion: &Motion) {
        let ng = model.grains.len();
        for (k, part) in self.parts.iter().enumerate() {
            let body = part.driven as usize;
            if let Part::Convex { shape, pose: local } =
                &model.driven[body].parts[part.part as usize]
            {
                let shape = &model.shapes[*shape as usize];
                let pose_of_part = motion.pose(ng + body).then(local);
                let bounds = bounds(shape, &pose_of_part, self.listed.margin(ng + body));
                let mut found = |i| self.extra.push((i, (ng + k) as u32));
                self.grid.for_each_meeting(&self.boxes, &bounds, &mut found);
            }
        }
    }

    /// Collects all pairs by chunk, then concatenates them; pairs of the old list keep their caches.
    fn fill(&mut self, ng: usize) {
        let Self { starts, antagonists, memory, grid, boxes, extra, chunk_pairs, .. } = self;
        chunk_pairs.resize_with(ng.div_ceil(CHUNK), ChunkPairs::default);
        let meetings = BoxOverlaps { grid, boxes, extra, starts, antagonists };
        for_each_chunk(starts, 0..ng, memory, chunk_pairs, &|grains, memory, chunk| {
            chunk.collect(&meetings, grains, memory);
        });
        starts.clear();
        starts.push(0);
        for count in chunk_pairs.iter().flat_map(|chunk| &chunk.counts) {
            starts.push(starts[starts.len() - 1] + count);
        }
        antagonists.resize(starts[ng], 0);
        memory.resize_with(starts[ng], PairCache::default);
        join(chunk_pairs, antagonists, memory);
    }
}

/// Moves the chunks' pairs to their positions in the list.
fn join(chunk_pairs: &mut [ChunkPairs], antagonists: &mut [u32], memory: &mut [PairCache]) {
    match chunk_pairs {
        [] => {}
        [chunk] => {
            antagonists.copy_from_slice(&chunk.antagonists);
            memory.swap_with_slice(&mut chunk.memory);
            // Caches of pairs that are no longer listed.
            chunk.memory.clear();
        }
        _ => {
            let (left, right) = chunk_pairs.split_at_mut(chunk_pairs.len() / 2);
            let pairs = left.iter().map(|chunk| chunk.memory.len()).sum();
            let (antagonists, antagonists_after) = antagonists.split_at_mut(pairs);
            let (memory, memory_after) = memory.split_at_mut(pairs);
            rayon::join(
                || join(left, antagonists, memory),
                || join(right, antagonists_after, memory_after),
            );
        }
    }
}

/// Calls `work` for each chunk of `grains` with the caches of their pairs, in parallel.
pub(super) fn for_each_chunk<C: Send>(
    starts: &[usize],
    grains: Range<usize>,
    memory: &mut [PairCache],
    chunks: &mut [C],
    work: &(impl Fn(Range<usize>, &mut [PairCache], &mut C) + Sync),
) {
    match chunks {
        [] => {}
        [chunk] => work(grains, memory, chunk),
        _ => {
            let (left, right) = chunks.split_at_mut(chunks.len() / 2);
            let middle = grains.start + left.len() * CHUNK;
            let (before, after) = memory.split_at_mut(starts[middle] - starts[grains.start]);
            rayon::join(
                || for_each_chunk(starts, grains.start..middle, before, left, work),
                || for_each_chunk(starts, middle..grains.end, after, right, work),
            );
        }
    }
}

/// Overlapping boxes, and the previous list.
struct BoxOverlaps<'a> {
    grid: &'a CellGrid,
    boxes: &'a [AxisBox],
    extra: &'a [(u32, u32)],
    starts: &'a [usize],
    antagonists: &'a [u32],
}

impl ChunkPairs {
    /// Collects the pairs of these grains; `known` are the caches of their previous pairs.
    fn collect(&mut self, all: &BoxOverlaps, grains: Range<usize>, known: &mut [PairCache]) {
        self.counts.clear();
        self.antagonists.clear();
        self.memory.clear();
        let from = all.starts[grains.start];
        let mut next = all.extra.partition_point(|e| (e.0 as usize) < grains.start);
        for i in grains {
            let first = self.antagonists.len();
            all.grid.for_each_above(all.boxes, i as u32, |j| self.antagonists.push(j));
            while next < all.extra.len() && all.extra[next].0 as usize == i {
                self.antagonists.push(all.extra[next].1);
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
            let old = all.starts[i]..all.starts[i + 1];
            self.restore_caches(
                first,
                &all.antagonists[old.clone()],
                &mut known[old.start - from..],
            );
        }
    }

    /// Moves the caches of previous pairs of the same grain to the pairs from `first` on.
    fn restore_caches(&mut self, first: usize, old: &[u32], known: &mut [PairCache]) {
        let mut k = 0;
        for j in &self.antagonists[first..] {
            while k < old.len() && old[k] < *j {
                k += 1;
            }
            let is_known = old.get(k) == Some(j);
            self.memory.push(if is_known { take(&mut known[k]) } else { PairCache::default() });
        }
    }
}

impl ListedConfiguration {
    /// Stores the configuration of the list.
    fn record(&mut self, model: &Model, motion: &Motion, range: &DetectionRange) {
        let ng = model.grains.len();
        self.position.clone_from(&motion.position);
        self.orientation.clone_from(&motion.orientation);
        (0..model.body_count())
            .into_par_iter()
            .with_min_len(1024)
            .map(|b| range::bounding_radius(model, b))
            .collect_into_vec(&mut self.bounding_radius);
        let mean = self.bounding_radius[..ng].iter().sum::<f64>() / ng.max(1) as f64;
        self.range.clear();
        self.range.extend((0..range.body_count()).map(|b| range.body_range(b)));
        self.slack.clear();
        let slack =
            |b| (0.5 * SKIN * mean).max(MAX_SKIN_LIFETIME_STEPS * range.free_displacement(b));
        self.slack.extend((0..range.body_count()).map(slack));
    }

    /// Returns the margin of the box of body `b`, m.
    fn margin(&self, b: usize) -> f64 {
        self.range[b] + self.slack[b]
    }

    /// True if no body has used up its slack by displacement or growth of range.
    fn is_valid(&self, motion: &Motion, range: &DetectionRange) -> bool {
        let used_up = |b: usize| {
            let rotation_bound =
                travel::rotation_bound(&motion.orientation[b], &self.orientation[b]);
            let displacement = (motion.position[b] - self.position[b]).norm()
                + self.bounding_radius[b] * rotation_bound;
            let used = displacement + (range.body_range(b) - self.range[b]).max(0.0);
            used.is_nan() || used > self.slack[b]
        };
        self.position.len() == motion.position.len()
            && !(0..self.position.len()).into_par_iter().with_min_len(4096).any(used_up)
    }
}

/// Returns the parts of all driven bodies, by body.
fn part_refs(model: &Model) -> Vec<PartRef> {
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

/// Returns the bounding box of a shape at `pose`, enlarged by a margin.
fn bounds(shape: &Polyhedron, pose: &Pose, margin: f64) -> AxisBox {
    let r = pose.orientation.to_rotation_matrix().into_inner();
    let AxisBox { low, high } = AxisBox::around(shape.vertices.iter().map(|v| r * v));
    let margin = Vec3::repeat(margin);
    AxisBox { low: pose.position + low - margin, high: pose.position + high + margin }
}
