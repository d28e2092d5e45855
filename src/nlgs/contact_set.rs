//! Set of contacts swept as one: a subdomain, or a group of the interface.
//!
//! Reads: a [`LocalProblem`]. Writes: its own lines and impulses. Cost: 176 bytes of memory traffic per visit.
//! Contract: a sweep is an exact Gauss-Seidel pass in the order of [`ContactSet::order`]; the set
//! shares nothing with other sets, so sets may be swept in parallel.

use super::block::{NncgBlock, PairBlock, Row64, SingleBlock};
use super::kernel::{BlockSubset, Blocks, OperationCounts};
use super::residual::{ContactLawSums, VisitNorms};
use crate::contact_graph::{PADDING, Packing};
use crate::lanes::{self, BodyVelocity, InstructionSet, LANES};
use crate::local_problem::LocalProblem;
use crate::math::Vec3;
use std::ops::AddAssign;

/// Memory traffic of a sweep over a set in bytes, padding included.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MemoryTraffic {
    /// Size of blocks and lines, which the set occupies in a cache.
    pub footprint: usize,
    /// Loads and stores of the visits, between the processor and its first cache.
    pub core: usize,
    /// Minimum traffic with cold caches: every block and line once in, every written cache line once out.
    pub streamed: usize,
}

impl AddAssign for MemoryTraffic {
    fn add_assign(&mut self, other: Self) {
        self.footprint += other.footprint;
        self.core += other.core;
        self.streamed += other.streamed;
    }
}

/// Contacts in blocks, with the velocities of their bodies.
#[derive(Debug, Clone)]
pub struct ContactSet {
    /// Velocities of the bodies, one line each, then a spare line for padding.
    ///
    /// The caller fills all but the spare one after [`ContactSet::pack`].
    pub lines: Vec<BodyVelocity>,
    /// Number of lines of grains; those of mounted bodies follow.
    pub grains: usize,
    blocks: Blocks,
    /// Contacts of the problem lane by lane, in the order of the sweep; padding between.
    order: Vec<u32>,
    contact_count: usize,
    /// Number of contacts in active blocks; `None` before the first [`ContactSet::update_active`].
    active_count: Option<usize>,
    /// Number of visits since the contacts were packed.
    visits: u64,
    singles: Packing,
    pairs: Packing,
    /// Contacts with driven bodies.
    single_contacts: Vec<u32>,
    /// Contacts between mobile bodies.
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
    /// Packs `contacts` of the problem with their initial impulses, and resizes `lines`, which the caller fills then.
    ///
    /// `line(g)` is the line of body g, below `line_count`.
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
        // Likely active contacts first: inactive blocks need no visit.
        for likely in [true, false] {
            for &i in contacts
                .iter()
                .filter(|&&i| problem.contacts[i as usize].is_likely_active == likely)
            {
                let kind = if problem.is_single(i as usize) {
                    &mut self.single_contacts
                } else {
                    &mut self.pair_contacts
                };
                kind.push(i);
            }
        }
        let contact = |list: &[u32], i: u32| &problem.contacts[list[i as usize] as usize];
        // The contacts are scattered in memory: those of the next block are prefetched while one is filled.
        let prefetch = |list: &[u32], block: Option<&[u32; LANES]>| {
            for &i in block.into_iter().flatten().filter(|&&i| i != PADDING) {
                lanes::prefetch(contact(list, i));
            }
        };
        let list = &self.single_contacts;
        self.singles
            .build(list.len(), line_count, |i| [line(contact(list, i as u32).bodies[0]); 2]);
        for (k, block) in self.singles.blocks.iter().enumerate() {
            prefetch(list, self.singles.blocks.get(k + 1));
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
            prefetch(list, self.pairs.blocks.get(k + 1));
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

    /// Packed contacts.
    #[cfg(test)]
    pub fn blocks(&self) -> &Blocks {
        &self.blocks
    }

    /// Sets the instruction set, on which results do not depend.
    pub fn set_arithmetic(&mut self, arithmetic: InstructionSet) {
        self.arithmetic = arithmetic;
    }

    /// Number of contacts; a sweep visits each once.
    pub fn contact_count(&self) -> usize {
        self.contact_count
    }

    /// Returns the contacts in the order of a sweep.
    pub fn order(&self) -> impl Iterator<Item = u32> + '_ {
        self.order.iter().copied().filter(|&i| i != PADDING)
    }

    /// Fraction of the blocks' lanes that hold a contact.
    pub fn fill_ratio(&self) -> f64 {
        self.contact_count as f64 / self.order.len().max(1) as f64
    }

    /// Counts the lane operations of the next sweep, which is made on copies.
    pub fn operations(&self, relaxation: f64) -> OperationCounts {
        self.blocks.count(&self.lines, relaxation)
    }

    /// Computes the memory traffic of a sweep from the layout.
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

    /// Adds the effect of the current impulses to the velocities, `V += M⁻¹ H r`: once, after the lines were filled with
    /// free velocities.
    pub fn apply_impulses(&mut self) {
        self.blocks.apply_impulses(self.arithmetic, &mut self.lines);
    }

    /// Number of visits since the contacts were packed.
    pub fn visits(&self) -> u64 {
        self.visits
    }

    /// Visits every contact once; `r += relaxation (r⁺ - r)`, and `r = 0` where one opens (T-17).
    pub fn sweep(&mut self, relaxation: f64) {
        self.visits += self.contact_count as u64;
        self.blocks.sweep(self.arithmetic, &mut self.lines, relaxation);
    }

    /// Visits the contacts of blocks that were active at the last [`ContactSet::update_active`].
    ///
    /// A visit does not change an open contact that stays open: skipping it is exact. One that would close
    /// waits for the next sweep over all contacts.
    pub fn sweep_active(&mut self, relaxation: f64) {
        let Some(count) = self.active_count else {
            self.sweep(relaxation);
            return self.update_active();
        };
        self.visits += count as u64;
        self.blocks.sweep_active(self.arithmetic, &mut self.lines, relaxation);
    }

    /// Updates the active blocks: those in which a contact has an impulse.
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

    /// Makes a [`ContactSet::sweep`] with the same bits, and returns the norms of its visits.
    pub fn measured_sweep(&mut self, relaxation: f64) -> VisitNorms {
        self.visits += self.contact_count as u64;
        let norms = self.blocks.measured_sweep(self.arithmetic, &mut self.lines, relaxation);
        // Prescribed freedoms of a mounted body have huge effective masses, so its angular velocity is no scale.
        let (grains, mounted) = self.lines.split_at(self.grains);
        let mounted = mounted.iter().map(|line| line.velocity().norm_squared());
        let speed_squared =
            grains.iter().map(BodyVelocity::speed_squared).chain(mounted).fold(0.0, f64::max);
        VisitNorms { speed_squared, ..norms }
    }

    /// Copies the active blocks to `subset`.
    pub fn copy_active_blocks(&self, subset: &mut BlockSubset) {
        self.blocks.copy_active_blocks(subset);
    }

    /// Returns the impulses of a subset, N s, padding included, in the order of [`ContactSet::replace_impulses`].
    pub fn subset_impulses<'a>(&'a self, subset: &'a BlockSubset) -> impl Iterator<Item = f64> {
        self.blocks.subset(subset).flat_map(|(_, r)| r.as_flattened()).copied()
    }

    /// Returns the weight of each component of [`ContactSet::subset_impulses`], kg^(-1/2).
    pub fn subset_weights<'a>(&'a self, subset: &'a BlockSubset) -> impl Iterator<Item = f64> {
        self.blocks.subset(subset).flat_map(|(law, _)| [law.weight(); 3]).flatten()
    }

    /// Sets the impulses of a subset to the projections of `impulses` on their cones, and updates the velocities.
    pub fn replace_impulses(&mut self, subset: &BlockSubset, impulses: &[f64]) {
        let (rows, rest) = impulses.as_chunks::<LANES>();
        let (triples, more) = rows.as_chunks();
        assert!(rest.is_empty() && more.is_empty(), "{} numbers", impulses.len());
        let Self { blocks, arithmetic, lines, .. } = self;
        if blocks.replace_impulses(*arithmetic, subset, triples, lines) {
            self.recount_active();
        }
    }

    /// Returns the weight of each contact, block after block: square root of a third of `tr W_αα`, kg^(-1/2).
    pub fn weights(&self) -> impl Iterator<Item = Row64> {
        let singles = self.blocks.singles().iter().map(|block| block.law.weight());
        singles.chain(self.blocks.pairs().iter().map(|block| block.law.weight()))
    }

    /// Initialises the NNCG data of a subset from its current impulses; `weights` come from [`ContactSet::weights`].
    pub fn begin_nncg(
        &self,
        subset: &BlockSubset,
        weights: &[Row64],
        memories: &mut Vec<NncgBlock>,
    ) {
        let impulses = self.blocks.subset(subset).map(|(_, impulse)| *impulse);
        let weights = self.blocks.numbers_of(subset).map(|i| weights[i]);
        memories.clear();
        memories.extend(impulses.zip(weights).map(|(before, weight)| NncgBlock {
            before,
            direction: [[0.0; LANES]; 3],
            weight,
        }));
    }

    /// Squared weighted change of a subset's impulses since the last extrapolation (T-37), N² s²/kg.
    pub fn change_squared(&self, subset: &BlockSubset, memories: &[NncgBlock]) -> f64 {
        let mut sum = 0.0;
        for ((_, impulse), memory) in self.blocks.subset(subset).zip(memories) {
            for (r, before) in impulse.iter().zip(&memory.before) {
                let squares: Row64 =
                    std::array::from_fn(|i| ((r[i] - before[i]) * memory.weight[i]).powi(2));
                sum = squares.iter().fold(sum, |sum, square| sum + square);
            }
        }
        sum
    }

    /// Moves the impulses of a subset along their search direction by the factor `beta` (T-37), within their cones,
    /// and updates the velocities.
    pub fn extrapolate(&mut self, subset: &BlockSubset, memories: &mut [NncgBlock], beta: f64) {
        let Self { blocks, arithmetic, lines, .. } = self;
        if blocks.extrapolate(*arithmetic, subset, memories, beta, lines) {
            self.recount_active();
        }
    }

    fn recount_active(&mut self) {
        if self.active_count.is_some() {
            self.count_active();
        }
    }

    /// Computes how far the contacts are from their law at the current impulses and velocities.
    pub fn law_sums(&self) -> ContactLawSums {
        self.blocks.law_sums(self.arithmetic, &self.lines)
    }

    /// Returns the contacts with their impulses (n, t, s), N s, in the order of the sweep.
    pub fn impulses(&self) -> impl Iterator<Item = (u32, Vec3)> + '_ {
        let lanes = (self.blocks.singles().iter().map(|b| &b.impulse))
            .chain(self.blocks.pairs().iter().map(|b| &b.impulse))
            .flat_map(|r| (0..LANES).map(|i| Vec3::new(r[0][i], r[1][i], r[2][i])));
        self.order.iter().copied().zip(lanes).filter(|&(i, _)| i != PADDING)
    }

    /// Writes the impulses (n, t, s), N s, of this set's contacts to `impulse` `[nc]`.
    pub fn unpack(&self, impulse: &mut [Vec3]) {
        for (i, local) in self.impulses() {
            impulse[i as usize] = local;
        }
    }
}
