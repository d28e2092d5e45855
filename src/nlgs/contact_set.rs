//! A set of contacts swept as one: a subdomain, or a group of the interface.
//!
//! Reads: a [`LocalProblem`]. Writes: its own lines and impulses. Cost: 160 bytes of memory traffic per visit.
//! Contract: a sweep is an exact Gauss-Seidel pass in the order of [`ContactSet::order`]; the set
//! shares nothing with other sets, so sets may be swept in parallel.

use super::block::{NncgBlock, PairBlock, Row64, SingleBlock};
use super::kernel::{BlockSubset, Blocks, OperationCounts};
use super::residual::{NaturalMapSums, VisitNorms};
use crate::contact_graph::{PADDING, Packing};
use crate::lanes::{self, BodyVelocity, InstructionSet, LANES};
use crate::local_problem::LocalProblem;
use crate::math::Vec3;
use std::ops::AddAssign;

/// Bytes of a sweep over a set, padding included.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MemoryTraffic {
    /// Blocks and lines: what the set takes in a cache.
    pub footprint: usize,
    /// Loads and stores of the visits: between the processor and its first cache.
    pub core: usize,
    /// The least that is moved where nothing is left in a cache from the sweep before: every block and line once in,
    /// every cache line that was written once out.
    pub streamed: usize,
}

impl AddAssign for MemoryTraffic {
    fn add_assign(&mut self, other: Self) {
        self.footprint += other.footprint;
        self.core += other.core;
        self.streamed += other.streamed;
    }
}

/// Contacts and the lines of their grains.
#[derive(Debug, Clone)]
pub struct ContactSet {
    /// Velocities of the grains, then a spare line that padding refers to. The caller fills all but
    /// the spare one after [`ContactSet::pack`].
    pub lines: Vec<BodyVelocity>,
    /// How many of the lines are grains'; mounted bodies' come after them.
    pub grains: usize,
    blocks: Blocks,
    /// Contacts of the problem lane by lane, in the order of the sweep; padding between.
    order: Vec<u32>,
    contact_count: usize,
    /// Contacts in blocks that are active; all while nobody has looked.
    active_count: Option<usize>,
    /// Visits since the contacts were packed.
    visits: u64,
    singles: Packing,
    pairs: Packing,
    /// The caller's contacts split in two kinds.
    single_contacts: Vec<u32>,
    pair_contacts: Vec<u32>,
    arithmetic: InstructionSet,
}

impl Default for ContactSet {
    fn default() -> Self {
        Self {
            lines: Vec::new(),
            grains: 0,
            blocks: Blocks::default(),
            order: Vec::new(),
            contact_count: 0,
            active_count: None,
            visits: 0,
            singles: Packing::default(),
            pairs: Packing::default(),
            single_contacts: Vec::new(),
            pair_contacts: Vec::new(),
            arithmetic: InstructionSet::detect(),
        }
    }
}

impl ContactSet {
    /// Packs `contacts` of the problem with their initial impulses; `line(g)` is the line of grain g,
    /// below `line_count`. Resizes `lines`, which the caller fills then.
    pub fn pack(
        &mut self,
        problem: &LocalProblem,
        contacts: &[u32],
        line_count: usize,
        line: impl Fn(u32) -> u32,
    ) {
        self.contact_count = contacts.len();
        self.active_count = None;
        self.visits = 0;
        self.lines.clear();
        self.lines.resize(line_count + 1, BodyVelocity::default());
        self.blocks.reset(line_count);
        self.single_contacts.clear();
        self.pair_contacts.clear();
        // Those that are likely to carry first: blocks in which nothing does need no visit.
        for likely in [true, false] {
            for &i in contacts.iter().filter(|&&i| problem.contacts[i as usize].likely == likely) {
                let kind = if problem.is_single(i as usize) {
                    &mut self.single_contacts
                } else {
                    &mut self.pair_contacts
                };
                kind.push(i);
            }
        }
        let contact = |list: &[u32], i: u32| &problem.contacts[list[i as usize] as usize];
        // They lie scattered: the next block's are fetched while one is filled.
        let expect = |list: &[u32], block: Option<&[u32; LANES]>| {
            for &i in block.into_iter().flatten().filter(|&&i| i != PADDING) {
                lanes::prefetch(contact(list, i));
            }
        };
        let list = &self.single_contacts;
        self.singles
            .build(list.len(), line_count, |i| [line(contact(list, i as u32).bodies[0]); 2]);
        for (k, block) in self.singles.blocks.iter().enumerate() {
            expect(list, self.singles.blocks.get(k + 1));
            self.blocks.push_single(|lane| {
                (block[lane] != PADDING).then(|| {
                    let contact = contact(list, block[lane]);
                    (contact, line(contact.bodies[0]))
                })
            });
        }
        let list = &self.pair_contacts;
        self.pairs.build(list.len(), line_count, |i| contact(list, i as u32).bodies.map(&line));
        for (k, block) in self.pairs.blocks.iter().enumerate() {
            expect(list, self.pairs.blocks.get(k + 1));
            self.blocks.push_pair(|lane| {
                (block[lane] != PADDING).then(|| {
                    let contact = contact(list, block[lane]);
                    (contact, contact.bodies.map(&line))
                })
            });
        }
        self.order.clear();
        for (packing, list) in
            [(&self.singles, &self.single_contacts), (&self.pairs, &self.pair_contacts)]
        {
            self.order.extend(
                packing
                    .blocks
                    .iter()
                    .flatten()
                    .map(|&i| if i == PADDING { PADDING } else { list[i as usize] }),
            );
        }
    }

    /// The packed contacts.
    #[cfg(test)]
    pub fn blocks(&self) -> &Blocks {
        &self.blocks
    }

    /// Chooses the instructions; results do not depend on them.
    pub fn set_arithmetic(&mut self, arithmetic: InstructionSet) {
        self.arithmetic = arithmetic;
    }

    /// Number of contacts; a sweep visits each once.
    pub fn contact_count(&self) -> usize {
        self.contact_count
    }

    /// The contacts in the order in which a sweep visits them.
    pub fn order(&self) -> impl Iterator<Item = u32> + '_ {
        self.order.iter().copied().filter(|&i| i != PADDING)
    }

    /// Share of the blocks' lanes that hold a contact.
    pub fn fill(&self) -> f64 {
        self.contact_count as f64 / self.order.len().max(1) as f64
    }

    /// OperationCounts on lanes that the next sweep would do; nothing is changed.
    pub fn operations(&self, relaxation: f64) -> OperationCounts {
        self.blocks.count(&self.lines, relaxation)
    }

    /// Bytes that a sweep moves, counted from the layout.
    pub fn traffic(&self) -> MemoryTraffic {
        let (singles, pairs) = (self.blocks.singles().len(), self.blocks.pairs().len());
        let blocks = singles * size_of::<SingleBlock>() + pairs * size_of::<PairBlock>();
        let lines = self.lines.len() * size_of::<BodyVelocity>();
        // Impulses and slip, and the cache lines that they lie in: three of impulses, one with slip.
        let written = LANES * (3 * size_of::<f64>() + size_of::<f32>());
        let gathered = LANES * (singles + 2 * pairs) * size_of::<BodyVelocity>();
        let dirty = 4 * size_of::<BodyVelocity>();
        MemoryTraffic {
            footprint: blocks + lines,
            core: blocks + (singles + pairs) * written + 2 * gathered,
            streamed: blocks + (singles + pairs) * dirty + 2 * lines,
        }
    }

    /// Adds to the lines what the present impulses cause, `V += M⁻¹ H r`: once, after lines were
    /// filled with free velocities.
    pub fn apply_impulses(&mut self) {
        self.blocks.apply_impulses(self.arithmetic, &mut self.lines);
    }

    /// Visits since the contacts were packed.
    pub fn visits(&self) -> u64 {
        self.visits
    }

    /// Visits every contact once; `r += relaxation (r⁺ - r)`, and `r = 0` where one opens (T-17).
    pub fn sweep(&mut self, relaxation: f64) {
        self.visits += self.contact_count as u64;
        self.blocks.sweep(self.arithmetic, &mut self.lines, relaxation);
    }

    /// Visits the contacts that carried an impulse when [`ContactSet::update_active`] looked, and those that share
    /// their blocks.
    ///
    /// A visit does not change an open contact that stays open: leaving it out is exact. One that would close
    /// waits for the next sweep over all.
    pub fn sweep_active(&mut self, relaxation: f64) {
        let Some(count) = self.active_count else {
            self.sweep(relaxation);
            return self.update_active();
        };
        self.visits += count as u64;
        self.blocks.sweep_active(self.arithmetic, &mut self.lines, relaxation);
    }

    /// Looks which contacts carry an impulse.
    pub fn update_active(&mut self) {
        self.blocks.update_active();
        self.count_active();
    }

    fn count_active(&mut self) {
        let contacts = |block: usize| {
            let lanes = &self.order[block * LANES..][..LANES];
            lanes.iter().filter(|&&i| i != PADDING).count()
        };
        self.active_count = Some(self.blocks.active().map(contacts).sum());
    }

    /// [`ContactSet::sweep`] with the same bits, and the norms of its visits.
    pub fn measured_sweep(&mut self, relaxation: f64) -> VisitNorms {
        self.visits += self.contact_count as u64;
        let norms = self.blocks.measured_sweep(self.arithmetic, &mut self.lines, relaxation);
        // What is footprint of a mounted body is as heavy as a mountain, and its spin no measure.
        let (grains, mounted) = self.lines.split_at(self.grains);
        let mounted = mounted.iter().map(|line| line.velocity().norm_squared());
        let speed_squared =
            grains.iter().map(BodyVelocity::speed_squared).chain(mounted).fold(0.0, f64::max);
        VisitNorms { speed_squared, ..norms }
    }

    /// The blocks that are active, to be kept in `chosen`.
    pub fn copy_active_blocks(&self, chosen: &mut BlockSubset) {
        self.blocks.copy_active_blocks(chosen);
    }

    /// Impulses of the chosen blocks, N s, padding included: the numbers that [`ContactSet::replace_impulses`]
    /// takes.
    pub fn subset_impulses<'a>(&'a self, chosen: &'a BlockSubset) -> impl Iterator<Item = f64> {
        self.blocks.chosen(chosen).flat_map(|(_, r)| r.as_flattened()).copied()
    }

    /// The root of a third of `tr W_αα` for each of these numbers, kg^(-1/2).
    pub fn subset_weights<'a>(&'a self, chosen: &'a BlockSubset) -> impl Iterator<Item = f64> {
        self.blocks.chosen(chosen).flat_map(|(law, _)| [law.weight(); 3]).flatten()
    }

    /// Gives the contacts of the chosen blocks the impulses of their cones nearest to `impulses`, and the
    /// grains the velocities that go with them.
    pub fn replace_impulses(&mut self, chosen: &BlockSubset, impulses: &[f64]) {
        let (rows, rest) = impulses.as_chunks::<LANES>();
        let (triples, more) = rows.as_chunks();
        assert!(rest.is_empty() && more.is_empty(), "{} numbers", impulses.len());
        let Self { blocks, arithmetic, lines, .. } = self;
        if blocks.replace_impulses(*arithmetic, chosen, triples, lines) {
            self.recount_active();
        }
    }

    /// The root of a third of `tr W_αα` of each contact, block after block, kg^(-1/2).
    pub fn weights(&self) -> impl Iterator<Item = Row64> {
        let singles = self.blocks.singles().iter().map(|block| block.law.weight());
        singles.chain(self.blocks.pairs().iter().map(|block| block.law.weight()))
    }

    /// What [`ContactSet::extrapolate`] begins with at the present impulses of the chosen blocks; `weights` are those of
    /// [`ContactSet::weights`].
    pub fn begin_nncg(
        &self,
        chosen: &BlockSubset,
        weights: &[Row64],
        memories: &mut Vec<NncgBlock>,
    ) {
        let impulses = self.blocks.chosen(chosen).map(|(_, impulse)| *impulse);
        let weights = self.blocks.numbers_of(chosen).map(|i| weights[i]);
        memories.clear();
        memories.extend(impulses.zip(weights).map(|(before, weight)| NncgBlock {
            before,
            direction: [[0.0; LANES]; 3],
            weight,
        }));
    }

    /// Square of the change of the chosen blocks' impulses since they last went on (T-37), N² s²/kg.
    pub fn change_squared(&self, chosen: &BlockSubset, memories: &[NncgBlock]) -> f64 {
        let mut sum = 0.0;
        for ((_, impulse), memory) in self.blocks.chosen(chosen).zip(memories) {
            for (r, before) in impulse.iter().zip(&memory.before) {
                let squares: Row64 =
                    std::array::from_fn(|i| ((r[i] - before[i]) * memory.weight[i]).powi(2));
                sum = squares.iter().fold(sum, |sum, square| sum + square);
            }
        }
        sum
    }

    /// Goes on from the impulses of the chosen blocks by `share` of the way that led there (T-37), within their
    /// cones; the grains' velocities follow.
    pub fn extrapolate(&mut self, chosen: &BlockSubset, memories: &mut [NncgBlock], share: f64) {
        let Self { blocks, arithmetic, lines, .. } = self;
        if blocks.extrapolate(*arithmetic, chosen, memories, share, lines) {
            self.recount_active();
        }
    }

    fn recount_active(&mut self) {
        if self.active_count.is_some() {
            self.count_active();
        }
    }

    /// NormSums of the natural map at the present impulses and velocities.
    pub fn natural_map(&self) -> NaturalMapSums {
        self.blocks.natural_map(self.arithmetic, &self.lines)
    }

    /// Contacts and their impulses (n, t, s), N s, in the order of the sweep.
    pub fn impulses(&self) -> impl Iterator<Item = (u32, Vec3)> + '_ {
        let lanes = (self.blocks.singles().iter().map(|b| &b.impulse))
            .chain(self.blocks.pairs().iter().map(|b| &b.impulse))
            .flat_map(|r| (0..LANES).map(|i| Vec3::new(r[0][i], r[1][i], r[2][i])));
        self.order.iter().copied().zip(lanes).filter(|&(i, _)| i != PADDING)
    }

    /// Writes the impulses (n, t, s), N s, to the places of this set's contacts in `impulse` `[nc]`.
    pub fn unpack(&self, impulse: &mut [Vec3]) {
        for (i, local) in self.impulses() {
            impulse[i as usize] = local;
        }
    }
}
