//! Detection of a step: pair list, then contact points of each pair, in parallel over fixed chunks.
//!
//! Reads: model, motion, reach. Writes: [`Contacts`]. Cost: two to four microseconds per grain
//! of a settled bed that creeps.
//! Contract: contacts are a function of model, motion and reach; neither earlier steps nor the number of
//! threads change a bit.

use super::Contacts;
use super::broad_phase::{CHUNK, PairList, PartRef, by_chunk};
use super::narrow_phase::{self, PairMemory, Scratch, Solid};
use super::range::DetectionRange;
use crate::geometry::HalfSpace;
use crate::lanes;
use crate::math::{Pose, Vec3};
use crate::model::{Model, Part};
use crate::motion::Motion;

/// How many pairs before its turn a pair's memory is fetched.
const AHEAD: usize = 2;

/// Finds contacts; keeps what makes the next step faster.
#[derive(Debug, Default)]
pub struct Detector {
    pairs: PairList,
    placed: Vec<Placed>,
    chunks: Vec<Chunk>,
}

/// A part of a driven body, placed in the world.
#[derive(Debug, Clone, Copy)]
enum Placed {
    Convex { shape: u32, pose: Pose },
    HalfSpace(HalfSpace),
}

/// Buffers of one chunk of grains.
#[derive(Debug, Default)]
struct Chunk {
    /// Holds the chunk's contact points.
    scratch: Scratch,
    /// Candidate and antagonist of each point.
    bodies: Vec<[u32; 2]>,
}

impl Detector {
    /// Brings the list of candidate pairs up to date.
    ///
    /// The list holds for all configurations in which no point of a body has moved by more than its box allows for; it is
    /// rebuilt only when one has, or when the number of bodies, their shapes' numbers or their reach have changed.
    pub fn broad_phase(&mut self, model: &Model, motion: &Motion, reach: &DetectionRange) {
        self.pairs.update(model, motion, reach);
    }

    /// Number of candidate pairs of grains with grains and convex parts.
    pub fn pair_count(&self) -> usize {
        self.pairs.antagonists.len()
    }

    /// Fills `out` with all contacts of the configuration, after [`Detector::broad_phase`] for it.
    pub fn narrow_phase(
        &mut self,
        model: &Model,
        motion: &Motion,
        reach: &DetectionRange,
        out: &mut Contacts,
    ) {
        self.narrow_phase_where(model, motion, reach, |_| true, out);
    }

    /// The same with the contacts of those pairs only that are asked for.
    pub fn narrow_phase_where(
        &mut self,
        model: &Model,
        motion: &Motion,
        reach: &DetectionRange,
        asked: impl Fn([usize; 2]) -> bool + Sync,
        out: &mut Contacts,
    ) {
        self.pairs.advance(motion);
        let ng = model.grains.len();
        place_parts(&self.pairs.parts, model, motion, &mut self.placed);
        self.chunks.resize_with(ng.div_ceil(CHUNK), Chunk::default);
        let PairList { starts, antagonists, memory, parts, travel, .. } = &mut self.pairs;
        let (starts, antagonists, placed) = (&*starts, &*antagonists, &*self.placed);
        let travel = &*travel.length;
        let search =
            Search { model, motion, reach, asked, starts, antagonists, parts, placed, travel };
        by_chunk(starts, 0..ng, memory, &mut self.chunks, &|grains, memory, chunk| {
            search.chunk(grains, memory, chunk);
        });
        join(&self.chunks, out);
    }
}

/// Where all parts of driven bodies are.
fn place_parts(parts: &[PartRef], model: &Model, motion: &Motion, placed: &mut Vec<Placed>) {
    placed.clear();
    placed.extend(parts.iter().map(|p| {
        let body = motion.pose(model.grains.len() + p.driven as usize);
        match &model.driven[p.driven as usize].parts[p.part as usize] {
            Part::Convex { shape, pose } => Placed::Convex { shape: *shape, pose: body.then(pose) },
            Part::HalfSpace { normal, offset } => {
                Placed::HalfSpace(HalfSpace { normal: *normal, offset: *offset }.at(&body))
            }
        }
    }));
}

/// What all chunks read.
struct Search<'a, F> {
    model: &'a Model,
    motion: &'a Motion,
    reach: &'a DetectionRange,
    /// Whether contacts of two bodies are wanted.
    asked: F,
    starts: &'a [usize],
    antagonists: &'a [u32],
    parts: &'a [PartRef],
    placed: &'a [Placed],
    travel: &'a [f64],
}

impl<F: Fn([usize; 2]) -> bool + Sync> Search<'_, F> {
    fn chunk(&self, grains: std::ops::Range<usize>, memory: &mut [PairMemory], out: &mut Chunk) {
        out.scratch.points.clear();
        out.bodies.clear();
        let first = self.starts[grains.start];
        let all = &self.antagonists[first..first + memory.len()];
        for i in grains.clone() {
            if i + 1 < grains.end {
                self.expect_grain(i + 1);
            }
            let pairs = self.starts[i] - first..self.starts[i + 1] - first;
            let of_grains = all[pairs.clone()].partition_point(|j| self.is_grain(*j));
            let parts = pairs.start + of_grains;
            for k in pairs.start..parts {
                if let Some(next) = all.get(k + AHEAD).filter(|j| self.is_grain(**j)) {
                    self.expect(*next, &memory[k + AHEAD]);
                }
                let j = all[k];
                let b = || self.grain(j as usize);
                if self.touch([i, j as usize], b, &mut memory[k], &mut out.scratch) {
                    out.note([i as u32, j], 0);
                }
            }
            self.parts_of(i, &all[parts..pairs.end], &mut memory[parts..pairs.end], out);
        }
    }

    fn is_grain(&self, body: u32) -> bool {
        (body as usize) < self.model.grains.len()
    }

    /// Brings to the cache what a pair with grain `j` will read if it touches.
    fn expect(&self, j: u32, memory: &PairMemory) {
        if memory.expect() {
            self.expect_grain(j as usize);
        }
    }

    /// Brings a grain's shape to the cache.
    fn expect_grain(&self, i: usize) {
        let shape = &self.model.shapes[self.model.grains.shape[i] as usize];
        lanes::prefetch(&*shape.vertices);
        lanes::prefetch(&*shape.face_normals);
        lanes::prefetch(&*shape.face_offsets);
        lanes::prefetch(&*shape.edges);
    }

    /// Contacts of grain `i` with all parts: the convex ones that are listed, and all half-spaces.
    fn parts_of(&self, i: usize, listed: &[u32], memory: &mut [PairMemory], out: &mut Chunk) {
        let ng = self.model.grains.len();
        let mut next = 0;
        for (k, (part, placed)) in self.parts.iter().zip(self.placed).enumerate() {
            let pair = [i, ng + part.driven as usize];
            match placed {
                Placed::HalfSpace(HalfSpace { normal, offset }) => {
                    if !(self.asked)(pair) {
                        continue;
                    }
                    let a = self.grain(i);
                    let alert = self.reach.distance(self.motion, a.shape.radius, pair);
                    narrow_phase::touch_half_space(a, normal, *offset, alert, &mut out.scratch);
                }
                Placed::Convex { shape, pose } => {
                    if listed.get(next) != Some(&((ng + k) as u32)) {
                        continue;
                    }
                    let shape = &self.model.shapes[*shape as usize];
                    let memory = &mut memory[next];
                    next += 1;
                    let b = || Solid { shape, pose: *pose };
                    if !self.touch(pair, b, memory, &mut out.scratch) {
                        continue;
                    }
                }
            }
            out.note(pair.map(|b| b as u32), part.part as usize);
        }
    }

    /// Finds the contacts of a grain with another body, `b` of it; whether the two had to be looked at.
    fn touch<'s>(
        &self,
        pair: [usize; 2],
        b: impl Fn() -> Solid<'s>,
        memory: &mut PairMemory,
        scratch: &mut Scratch,
    ) -> bool {
        let travel = pair.map(|b| self.travel[b]).iter().sum();
        let at_most = self.reach.max_distance(pair);
        if !(self.asked)(pair) || memory.sleeps(travel, at_most) {
            return false;
        }
        let a = self.grain(pair[0]);
        // A body may have half-spaces beside this part: they are looked for further away.
        let alert = self.reach.distance(self.motion, a.shape.radius, pair).min(at_most);
        let looked = !memory.sleeps(travel, alert);
        if looked {
            narrow_phase::touch(a, b(), alert, travel, memory, scratch);
        }
        looked
    }

    fn grain(&self, i: usize) -> Solid<'_> {
        let shape = &self.model.shapes[self.model.grains.shape[i] as usize];
        Solid { shape, pose: self.motion.pose(i) }
    }
}

impl Chunk {
    /// Notes whose the points are that have been found last, and on which part of the antagonist.
    fn note(&mut self, bodies: [u32; 2], part: usize) {
        let points = &mut self.scratch.points;
        for p in &mut points[self.bodies.len()..] {
            p.feature = narrow_phase::on_part(p.feature, part);
        }
        self.bodies.resize(points.len(), bodies);
    }
}

/// Copies the chunks' contacts to `out`, one after the other.
fn join(chunks: &[Chunk], out: &mut Contacts) {
    let count = points(chunks);
    out.bodies.resize(count, [0; 2]);
    out.feature.resize(count, 0);
    out.point.resize(count, Vec3::zeros());
    out.normal.resize(count, Vec3::zeros());
    out.gap.resize(count, 0.0);
    let Contacts { bodies, feature, point, normal, gap } = out;
    Places { bodies, feature, point, normal, gap }.fill(chunks);
}

fn points(chunks: &[Chunk]) -> usize {
    chunks.iter().map(|chunk| chunk.bodies.len()).sum()
}

/// Where contacts of some chunks go.
struct Places<'a> {
    bodies: &'a mut [[u32; 2]],
    feature: &'a mut [u64],
    point: &'a mut [Vec3],
    normal: &'a mut [Vec3],
    gap: &'a mut [f64],
}

impl Places<'_> {
    fn fill(self, chunks: &[Chunk]) {
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

    fn copy(self, chunk: &Chunk) {
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
