//! Detection of a step: pair list, then contact points of each pair, in parallel over fixed chunks.
//!
//! Reads: model, motion, detection range. Writes: [`Contacts`]. Cost: two to four microseconds per grain of a slowly
//! creeping settled bed. Contract: contacts are a function of model, motion and detection range; neither earlier
//! steps nor the number of threads change a bit.

use super::broad_phase::{CHUNK, PairList, PartRef, for_each_chunk};
use super::contacts::Contacts;
use super::covered::{CoveredContacts, TouchedBody};
use super::narrow_phase::{self, ContactPoint, ConvexBody, PairCache, Scratch};
use super::range::DetectionRange;
use crate::geometry::HalfSpace;
use crate::lanes;
use crate::math::{Pose, Vec3, rotation};
use crate::model::{Model, Part};
use crate::motion::Motion;

/// Relative displacement in a step from which a grain may pass another body without touching it, over its radius.
const MIN_PASSING_DISPLACEMENT: f64 = 1e-3;
/// Number of pairs by which prefetching of caches runs ahead.
const PREFETCH_PAIRS: usize = 2;

/// Contact detector with its caches.
#[derive(Debug, Default)]
pub struct Detector {
    pairs: PairList,
    part_poses: Vec<PartPose>,
    chunks: Vec<ChunkContacts>,
    covered: CoveredContacts,
}

/// Part of a driven body at its pose in the world.
#[derive(Debug, Clone, Copy)]
enum PartPose {
    Convex { shape: u32, pose: Pose },
    HalfSpace(HalfSpace),
}

/// Contacts of one chunk of grains, and buffers.
#[derive(Debug, Default)]
struct ChunkContacts {
    /// Buffers of the search; hold the chunk's contact points.
    scratch: Scratch,
    /// Candidate and antagonist of each point.
    bodies: Vec<[u32; 2]>,
}

impl Detector {
    /// Updates the list of candidate pairs.
    ///
    /// The list is valid for all configurations in which no point of a body has moved by more than the margin of its
    /// box. It is rebuilt only if one has, or if bodies, shapes or detection range have changed.
    pub fn broad_phase(&mut self, model: &Model, motion: &Motion, range: &DetectionRange) {
        self.pairs.update(model, motion, range);
    }

    /// Returns the number of candidate pairs of grains with grains and convex parts.
    pub fn pair_count(&self) -> usize {
        self.pairs.antagonists.len()
    }

    /// Fills `out` with all contacts of the configuration; requires a preceding [`Detector::broad_phase`] for it.
    pub fn narrow_phase(
        &mut self,
        model: &Model,
        motion: &Motion,
        range: &DetectionRange,
        out: &mut Contacts,
    ) {
        self.narrow_phase_where(model, motion, range, |_| true, out);
    }

    /// Fills `out` with the contacts of the pairs that `is_wanted` selects; requires [`Detector::broad_phase`].
    pub fn narrow_phase_where(
        &mut self,
        model: &Model,
        motion: &Motion,
        range: &DetectionRange,
        is_wanted: impl Fn([usize; 2]) -> bool + Sync,
        out: &mut Contacts,
    ) {
        self.pairs.advance(motion);
        let ng = model.grains.len();
        transform_parts(&self.pairs.parts, model, motion, &mut self.part_poses);
        self.chunks.resize_with(ng.div_ceil(CHUNK), ChunkContacts::default);
        let PairList { starts, antagonists, memory, parts, travel, .. } = &mut self.pairs;
        let (starts, antagonists, part_poses) = (&*starts, &*antagonists, &*self.part_poses);
        let travel = &*travel.length;
        let search = PairSearch {
            model,
            motion,
            range,
            is_wanted,
            starts,
            antagonists,
            parts,
            part_poses,
            travel,
        };
        for_each_chunk(starts, 0..ng, memory, &mut self.chunks, &|grains, memory, chunk| {
            search.chunk(grains, memory, chunk);
        });
        join(&self.chunks, out);
        let body = |[b, part]: [u32; 2]| search.touched(b, part);
        self.covered.remove(ng, out, &body);
    }
}

/// Transforms all parts of driven bodies to the world.
fn transform_parts(
    parts: &[PartRef],
    model: &Model,
    motion: &Motion,
    part_poses: &mut Vec<PartPose>,
) {
    part_poses.clear();
    part_poses.extend(parts.iter().map(|p| {
        let body = motion.pose(model.grains.len() + p.driven as usize);
        match &model.driven[p.driven as usize].parts[p.part as usize] {
            Part::Convex { shape, pose } => {
                PartPose::Convex { shape: *shape, pose: body.then(pose) }
            }
            Part::HalfSpace { normal, offset } => {
                PartPose::HalfSpace(HalfSpace { normal: *normal, offset: *offset }.at(&body))
            }
        }
    }));
}

/// Inputs of a search that all chunks share.
struct PairSearch<'a, F> {
    model: &'a Model,
    motion: &'a Motion,
    range: &'a DetectionRange,
    /// Selects the pairs of bodies whose contacts are wanted.
    is_wanted: F,
    starts: &'a [usize],
    antagonists: &'a [u32],
    parts: &'a [PartRef],
    part_poses: &'a [PartPose],
    travel: &'a [f64],
}

impl<F: Fn([usize; 2]) -> bool + Sync> PairSearch<'_, F> {
    fn chunk(
        &self,
        grains: std::ops::Range<usize>,
        memory: &mut [PairCache],
        out: &mut ChunkContacts,
    ) {
        out.scratch.points.clear();
        out.scratch.hull.prefers_overlaps = !self.model.is_rigid();
        out.bodies.clear();
        let first = self.starts[grains.start];
        let all = &self.antagonists[first..first + memory.len()];
        for i in grains.clone() {
            if i + 1 < grains.end {
                self.prefetch_grain(i + 1);
            }
            let pairs = self.starts[i] - first..self.starts[i + 1] - first;
            let of_grains = all[pairs.clone()].partition_point(|j| self.is_grain(*j));
            let parts = pairs.start + of_grains;
            for k in pairs.start..parts {
                if let Some(next) = all.get(k + PREFETCH_PAIRS).filter(|j| self.is_grain(**j)) {
                    self.prefetch_pair(*next, &memory[k + PREFETCH_PAIRS]);
                }
                let j = all[k];
                let b = || self.grain(j as usize);
                if self.examine_pair([i, j as usize], b, &mut memory[k], &mut out.scratch) {
                    out.label_points([i as u32, j], 0);
                }
            }
            self.examine_parts(i, &all[parts..pairs.end], &mut memory[parts..pairs.end], out);
        }
    }

    fn is_grain(&self, body: u32) -> bool {
        (body as usize) < self.model.grains.len()
    }

    /// Prefetches the data that a pair with grain `j` reads if it touches.
    fn prefetch_pair(&self, j: u32, memory: &PairCache) {
        if memory.prefetch() {
            self.prefetch_grain(j as usize);
        }
    }

    /// Prefetches a grain's shape.
    fn prefetch_grain(&self, i: usize) {
        let shape = &self.model.shapes[self.model.grains.shape[i] as usize];
        lanes::prefetch(&*shape.vertices);
        lanes::prefetch(&*shape.face_normals);
        lanes::prefetch(&*shape.face_offsets);
        lanes::prefetch(&*shape.edges);
    }

    /// Finds the contacts of grain `i` with all parts: the listed convex ones, and all half-spaces.
    fn examine_parts(
        &self,
        i: usize,
        listed: &[u32],
        memory: &mut [PairCache],
        out: &mut ChunkContacts,
    ) {
        let ng = self.model.grains.len();
        let mut next = 0;
        for (k, (part, part_poses)) in self.parts.iter().zip(self.part_poses).enumerate() {
            let pair = [i, ng + part.driven as usize];
            match part_poses {
                PartPose::HalfSpace(HalfSpace { normal, offset }) => {
                    if !(self.is_wanted)(pair) {
                        continue;
                    }
                    let a = self.grain(i);
                    let alert = self.range.distance(self.motion, a.shape.radius, pair);
                    narrow_phase::generate_half_space_contacts(
                        a,
                        normal,
                        *offset,
                        alert,
                        &mut out.scratch,
                    );
                }
                PartPose::Convex { shape, pose } => {
                    if listed.get(next) != Some(&((ng + k) as u32)) {
                        continue;
                    }
                    let shape = &self.model.shapes[*shape as usize];
                    let memory = &mut memory[next];
                    next += 1;
                    let b = || ConvexBody { shape, pose: *pose };
                    if !self.examine_pair(pair, b, memory, &mut out.scratch) {
                        continue;
                    }
                }
            }
            out.label_points(pair.map(|b| b as u32), part.part as usize);
        }
    }

    /// Finds the contacts of a grain with another body, `b`. Returns false if the cache rules them out.
    fn examine_pair<'s>(
        &self,
        pair: [usize; 2],
        b: impl Fn() -> ConvexBody<'s>,
        memory: &mut PairCache,
        scratch: &mut Scratch,
    ) -> bool {
        let travel = pair.map(|b| self.travel[b]).iter().sum();
        let max_distance = self.range.max_distance(pair);
        if !(self.is_wanted)(pair) || memory.is_surely_separated(travel, max_distance) {
            return false;
        }
        let a = self.grain(pair[0]);
        // A body may have half-spaces in addition to this part; their detection distance is larger.
        let alert = self.range.distance(self.motion, a.shape.radius, pair).min(max_distance);
        let is_examined = !memory.is_surely_separated(travel, alert);
        if is_examined {
            let start = scratch.points.len();
            narrow_phase::generate_contacts(a, b(), alert, travel, memory, scratch);
            if self.may_pass(pair, &scratch.points[start..]) {
                let end = [self.end_pose(pair[0], a.pose), self.end_pose(pair[1], b().pose)];
                narrow_phase::replace_passing_contact(a, b(), end, alert, start, scratch);
            }
        }
        is_examined
    }

    /// Returns true if a grain's free motion would close the gap of these contact points with another body, and is long
    /// enough to lead it past the body instead.
    fn may_pass(&self, [grain, other]: [usize; 2], points: &[ContactPoint]) -> bool {
        let Some(closest) = points.iter().min_by(|p, q| p.gap.total_cmp(&q.gap)) else {
            return false;
        };
        if closest.gap <= 0.0 {
            return false;
        }
        let h = self.model.stepping.h();
        let displacement = |b: usize| {
            let lever = closest.point - self.motion.position[b];
            (self.motion.velocity[b] + self.motion.angular_velocity[b].cross(&lever)) * h
        };
        let relative = displacement(grain) - displacement(other);
        let min_displacement = MIN_PASSING_DISPLACEMENT * self.model.grain_radius(grain);
        closest.gap + closest.normal.dot(&relative) < 0.0
            && relative.norm_squared() > min_displacement * min_displacement
    }

    /// Returns the pose to which the free velocity of body `b` leads itself, or a part of it that is at `pose`.
    fn end_pose(&self, b: usize, pose: Pose) -> Pose {
        let h = self.model.stepping.h();
        let turn = rotation::exp(&(self.motion.angular_velocity[b] * h));
        let origin = self.motion.position[b];
        let position = origin + self.motion.velocity[b] * h + turn * (pose.position - origin);
        Pose { position, orientation: turn * pose.orientation }
    }

    /// Returns body `b`, or part `part` of it if it is driven.
    fn touched(&self, b: u32, part: u32) -> TouchedBody<'_> {
        let Some(driven) = (b as usize).checked_sub(self.model.grains.len()) else {
            return TouchedBody::Convex(self.grain(b as usize));
        };
        let first = self.parts.partition_point(|p| (p.driven as usize) < driven);
        match &self.part_poses[first + part as usize] {
            PartPose::Convex { shape, pose } => {
                let shape = &self.model.shapes[*shape as usize];
                TouchedBody::Convex(ConvexBody { shape, pose: *pose })
            }
            PartPose::HalfSpace(plane) => TouchedBody::HalfSpace(*plane),
        }
    }

    fn grain(&self, i: usize) -> ConvexBody<'_> {
        let shape = &self.model.shapes[self.model.grains.shape[i] as usize];
        ConvexBody { shape, pose: self.motion.pose(i) }
    }
}

impl ChunkContacts {
    /// Stores the bodies of the last points, and the antagonist's part in their features.
    fn label_points(&mut self, bodies: [u32; 2], part: usize) {
        let points = &mut self.scratch.points;
        for p in &mut points[self.bodies.len()..] {
            p.feature = narrow_phase::with_part(p.feature, part);
        }
        self.bodies.resize(points.len(), bodies);
    }
}

/// Concatenates the chunks' contacts in `out`.
fn join(chunks: &[ChunkContacts], out: &mut Contacts) {
    let count = points(chunks);
    out.bodies.resize(count, [0; 2]);
    out.feature.resize(count, 0);
    out.point.resize(count, Vec3::zeros());
    out.normal.resize(count, Vec3::zeros());
    out.gap.resize(count, 0.0);
    let Contacts { bodies, feature, point, normal, gap } = out;
    ContactSlices { bodies, feature, point, normal, gap }.fill(chunks);
}

fn points(chunks: &[ChunkContacts]) -> usize {
    chunks.iter().map(|chunk| chunk.bodies.len()).sum()
}

/// Slices of the output for the contacts of some chunks.
struct ContactSlices<'a> {
    bodies: &'a mut [[u32; 2]],
    feature: &'a mut [u64],
    point: &'a mut [Vec3],
    normal: &'a mut [Vec3],
    gap: &'a mut [f64],
}

impl ContactSlices<'_> {
    fn fill(self, chunks: &[ChunkContacts]) {
        match chunks {
            [] => {}
            [chunk] => self.copy(chunk),
            _ => {
                let (left, right) = chunks.split_at(chunks.len() / 2);
                let [before, after] = self.split_at(points(left));
                rayon::join(|| before.fill(left), || after.fill(right));
            }
        }
    }

    fn copy(self, chunk: &ChunkContacts) {
        let Self { bodies, feature, point, normal, gap } = self;
        bodies.copy_from_slice(&chunk.bodies);
        let places = feature.iter_mut().zip(point).zip(normal).zip(gap);
        for (p, (((feature, point), normal), gap)) in chunk.scratch.points.iter().zip(places) {
            (*feature, *point, *normal, *gap) = (p.feature, p.point, p.normal, p.gap);
        }
    }

    fn split_at(self, n: usize) -> [Self; 2] {
        let (bodies, bodies_after) = self.bodies.split_at_mut(n);
        let (feature, feature_after) = self.feature.split_at_mut(n);
        let (point, point_after) = self.point.split_at_mut(n);
        let (normal, normal_after) = self.normal.split_at_mut(n);
        let (gap, gap_after) = self.gap.split_at_mut(n);
        let after = Self {
            bodies: bodies_after,
            feature: feature_after,
            point: point_after,
            normal: normal_after,
            gap: gap_after,
        };
        [Self { bodies, feature, point, normal, gap }, after]
    }
}
