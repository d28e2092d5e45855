//! Passes over the blocks of a set: sweep, measured sweep, application of impulses, distance from the contact law.
//!
//! Reads: blocks. Writes: lines and impulses. Cost: about 176 bytes of memory traffic per visit.
//! Contract: the same bits from every [`InstructionSet`].
//!
//! `unsafe` is sound here because a set is packed with indices checked against its number of lines, and passes
//! check that number again, so [`Lanes::gather`](crate::lanes::Lanes::gather) and
//! [`Lanes::scatter`](crate::lanes::Lanes::scatter) stay inside.

mod counting;
mod coupling;
mod passes;
mod roofline;

pub use counting::OperationCounts;

use super::block::{LawRows, NncgBlock, PairBlock, Row64, SingleBlock};
use super::residual::{ContactLawSums, VisitNorms};
use crate::lanes::{BodyVelocity, InstructionSet, LANES, VelocityKernel, run};
use crate::local_problem::LocalContact;
use passes::{
    ActiveBlocks, AllBlocks, ApplyImpulses, Extrapolate, LawPass, MeasuredSweep, PlainSweep,
    ReplaceImpulses, SweepPass,
};

/// Subset of the blocks: indices of singles and of pairs, ascending.
#[derive(Debug, Clone, Default)]
pub struct BlockSubset([Vec<u32>; 2]);

/// Packed contacts whose indices are checked on entry.
#[derive(Debug, Clone, Default)]
pub struct Blocks {
    singles: Vec<SingleBlock>,
    pairs: Vec<PairBlock>,
    /// Singles and pairs with an impulse at the last [`Blocks::update_active`].
    active: [Vec<u32>; 2],
    /// True for each of the singles and of the pairs that shares no body with the next: both may be visited at once.
    disjoint_from_next: [Vec<bool>; 2],
    /// Number of lines of bodies; the spare line of padding follows.
    line_count: u32,
}

impl Blocks {
    /// Empties the blocks and sets the number of lines without the spare one.
    pub fn reset(&mut self, line_count: usize) {
        assert!(line_count < u32::MAX as usize, "more lines than indices");
        self.singles.clear();
        self.pairs.clear();
        self.active.iter_mut().for_each(Vec::clear);
        self.disjoint_from_next.iter_mut().for_each(Vec::clear);
        self.line_count = line_count as u32;
    }

    /// Appends a block of contacts with driven bodies: contact and line per lane, or `None`.
    pub fn push_single<'c>(&mut self, lane: impl Fn(usize) -> Option<(&'c LocalContact, u32)>) {
        let mut block = SingleBlock::empty(self.line_count);
        for i in 0..8 {
            if let Some((contact, grain)) = lane(i) {
                self.check(grain);
                block.set(i, contact, grain);
            }
        }
        let before = self.singles.last().map(|before| before.grain);
        self.push_disjoint(
            0,
            before.is_some_and(|before| self.are_disjoint(&before, &block.grain)),
        );
        self.singles.push(block);
    }

    /// Appends a block of contacts between grains: contact and lines per lane, or `None`.
    pub fn push_pair<'c>(&mut self, lane: impl Fn(usize) -> Option<(&'c LocalContact, [u32; 2])>) {
        let mut block = PairBlock::empty(self.line_count);
        for i in 0..8 {
            if let Some((contact, grains)) = lane(i) {
                grains.iter().for_each(|&g| self.check(g));
                block.set(i, contact, grains);
            }
        }
        let grains = |block: &PairBlock| [block.candidate, block.antagonist];
        let before = self.pairs.last().map(grains);
        let is_disjoint_from_next = |before: [[u32; LANES]; 2]| {
            self.are_disjoint(before.as_flattened(), grains(&block).as_flattened())
        };
        self.push_disjoint(1, before.is_some_and(is_disjoint_from_next));
        self.pairs.push(block);
    }

    /// Records if the next block of a kind is disjoint from the one before.
    fn push_disjoint(&mut self, kind: usize, is_disjoint: bool) {
        if let Some(before) = self.disjoint_from_next[kind].last_mut() {
            *before = is_disjoint;
        }
        self.disjoint_from_next[kind].push(false);
    }

    /// Returns true if two blocks share no line but the spare one.
    fn are_disjoint(&self, one: &[u32], other: &[u32]) -> bool {
        // Branchless, so that it is vectorised.
        let has_not = |line: u32| other.iter().fold(true, |disjoint, &o| disjoint & (o != line));
        one.iter().all(|&line| line == self.line_count || has_not(line))
    }

    fn check(&self, line: u32) {
        assert!(line < self.line_count, "line {line} of {}", self.line_count);
    }

    /// Blocks of contacts with driven bodies, which are swept first.
    pub fn singles(&self) -> &[SingleBlock] {
        &self.singles
    }

    /// Blocks of contacts between grains.
    pub fn pairs(&self) -> &[PairBlock] {
        &self.pairs
    }

    /// Number of lines that a pass needs, including the spare one.
    pub fn lines_needed(&self) -> usize {
        self.line_count as usize + 1
    }

    fn check_lines(&self, lines: &[BodyVelocity]) {
        let (found, needed) = (lines.len(), self.lines_needed());
        assert!(found >= needed, "{found} lines, {needed} needed");
    }

    fn as_sweep<'a>(
        &'a mut self,
        lines: &'a mut [BodyVelocity],
        relaxation: f64,
    ) -> SweepPass<'a, AllBlocks<'a>> {
        self.check_lines(lines);
        let choice = self.disjoint_from_next.each_ref().map(|disjoint| AllBlocks(disjoint));
        let (singles, pairs) = (&mut self.singles, &mut self.pairs);
        SweepPass { singles, pairs, choice, lines, relaxation }
    }

    /// Visits every contact once.
    pub fn sweep(
        &mut self,
        arithmetic: InstructionSet,
        lines: &mut [BodyVelocity],
        relaxation: f64,
    ) {
        let pass = PlainSweep(self.as_sweep(lines, relaxation));
        // SAFETY: indices were checked by `push_*`, lines by `as_sweep`.
        unsafe { run(arithmetic, pass) }
    }

    /// Visits the contacts of the active blocks.
    pub fn sweep_active(
        &mut self,
        arithmetic: InstructionSet,
        lines: &mut [BodyVelocity],
        relaxation: f64,
    ) {
        self.check_lines(lines);
        let [of_singles, of_pairs] = &self.disjoint_from_next;
        let choice = [
            ActiveBlocks { blocks: &self.active[0], disjoint_from_next: of_singles },
            ActiveBlocks { blocks: &self.active[1], disjoint_from_next: of_pairs },
        ];
        let (singles, pairs) = (&mut self.singles, &mut self.pairs);
        let pass = PlainSweep(SweepPass { singles, pairs, choice, lines, relaxation });
        // SAFETY: indices were checked by `push_*`, lines above.
        unsafe { run(arithmetic, pass) }
    }

    /// Updates the active blocks: those with an impulse.
    pub fn update_active(&mut self) {
        fn update<'b>(active: &mut Vec<u32>, normal: impl Iterator<Item = &'b Row64>) {
            let carries = |row: &Row64| row.iter().any(|&r| r != 0.0);
            active.clear();
            active.extend((0u32..).zip(normal).filter(|(_, row)| carries(row)).map(|(i, _)| i));
        }
        let [singles, pairs] = &mut self.active;
        update(singles, self.singles.iter().map(|b| &b.impulse[0]));
        update(pairs, self.pairs.iter().map(|b| &b.impulse[0]));
    }

    /// Returns the active blocks, numbered in the order of a sweep.
    pub fn active(&self) -> impl Iterator<Item = usize> + '_ {
        self.numbers(&self.active)
    }

    /// Returns the blocks of a subset, numbered in the order of a sweep.
    pub fn numbers_of<'a>(&'a self, subset: &'a BlockSubset) -> impl Iterator<Item = usize> + 'a {
        self.numbers(&subset.0)
    }

    fn numbers<'a>(&self, some: &'a [Vec<u32>; 2]) -> impl Iterator<Item = usize> + use<'a> {
        let (before, [singles, pairs]) = (self.singles.len(), some);
        singles.iter().map(|&i| i as usize).chain(pairs.iter().map(move |&i| before + i as usize))
    }

    /// Makes a sweep with the same bits, and returns the norms of its visits.
    pub fn measured_sweep(
        &mut self,
        arithmetic: InstructionSet,
        lines: &mut [BodyVelocity],
        relaxation: f64,
    ) -> VisitNorms {
        let pass = MeasuredSweep(self.as_sweep(lines, relaxation));
        // SAFETY: indices were checked by `push_*`, lines by `as_sweep`.
        unsafe { run(arithmetic, pass) }
    }

    /// Counts the lane operations of a sweep, which is made on copies.
    pub fn count(&self, lines: &[BodyVelocity], relaxation: f64) -> OperationCounts {
        let (mut blocks, mut lines) = (self.clone(), lines.to_vec());
        let pass = PlainSweep(blocks.as_sweep(&mut lines, relaxation));
        // SAFETY: indices were checked by `push_*`, lines by `as_sweep`; the lanes need no special instructions.
        counting::count_operations(|| unsafe { pass.run::<counting::CountingLanes>() })
    }

    /// Adds the effect of the impulses to the velocities: `V += M⁻¹ H r`.
    pub fn apply_impulses(&self, arithmetic: InstructionSet, lines: &mut [BodyVelocity]) {
        self.check_lines(lines);
        let pass = ApplyImpulses { singles: &self.singles, pairs: &self.pairs, lines };
        // SAFETY: indices were checked by `push_*`, lines above.
        unsafe { run(arithmetic, pass) }
    }

    /// Copies the active blocks to `subset`.
    pub fn copy_active_blocks(&self, subset: &mut BlockSubset) {
        for (to, from) in subset.0.iter_mut().zip(&self.active) {
            to.clone_from(from);
        }
    }

    /// Returns laws and impulses of a subset.
    pub fn subset<'a>(
        &'a self,
        subset: &'a BlockSubset,
    ) -> impl Iterator<Item = (&'a LawRows, &'a [Row64; 3])> {
        let [singles, pairs] = &subset.0;
        let single = |&i: &u32| (&self.singles[i as usize].law, &self.singles[i as usize].impulse);
        let pair = |&i: &u32| (&self.pairs[i as usize].law, &self.pairs[i as usize].impulse);
        singles.iter().map(single).chain(pairs.iter().map(pair))
    }

    /// Sets the impulses of a subset to the projections of `impulses` on their cones, and updates the velocities.
    ///
    /// Activates the subset, because changed impulses need visits; returns true if a block was inactive.
    pub fn replace_impulses(
        &mut self,
        arithmetic: InstructionSet,
        subset: &BlockSubset,
        impulses: &[[Row64; 3]],
        lines: &mut [BodyVelocity],
    ) -> bool {
        self.check_lines(lines);
        let choice = subset.0.each_ref().map(Vec::as_slice);
        assert_eq!(
            impulses.len(),
            choice[0].len() + choice[1].len(),
            "one triple of rows per block"
        );
        let (singles, pairs) = (&mut self.singles, &mut self.pairs);
        let pass = ReplaceImpulses { singles, pairs, choice, impulses, lines };
        // SAFETY: indices were checked by `push_*`, lines above.
        unsafe { run(arithmetic, pass) }
        self.activate(subset)
    }

    /// Moves the impulses of a subset along their search direction by the factor `beta` (T-37), within their cones,
    /// and updates the velocities.
    ///
    /// Activates the subset; returns true if a block was inactive.
    pub fn extrapolate(
        &mut self,
        arithmetic: InstructionSet,
        subset: &BlockSubset,
        memories: &mut [NncgBlock],
        beta: f64,
        lines: &mut [BodyVelocity],
    ) -> bool {
        self.check_lines(lines);
        let choice = subset.0.each_ref().map(Vec::as_slice);
        assert_eq!(memories.len(), choice[0].len() + choice[1].len(), "one memory per block");
        let (singles, pairs) = (&mut self.singles, &mut self.pairs);
        let pass = Extrapolate { singles, pairs, choice, memories, beta, lines };
        // SAFETY: indices were checked by `push_*`, lines above.
        unsafe { run(arithmetic, pass) }
        self.activate(subset)
    }

    /// Activates a subset; returns true if a block was inactive.
    fn activate(&mut self, subset: &BlockSubset) -> bool {
        let mut has_new = false;
        for (active, subset) in self.active.iter_mut().zip(&subset.0) {
            // Both lists ascend.
            let mut rest = active.iter();
            if !subset.iter().all(|i| rest.any(|j| j == i)) {
                active.extend(subset);
                active.sort_unstable();
                active.dedup();
                has_new = true;
            }
        }
        has_new
    }

    /// Computes how far the contacts are from their law at the current impulses and velocities.
    pub fn law_sums(&self, arithmetic: InstructionSet, lines: &[BodyVelocity]) -> ContactLawSums {
        self.check_lines(lines);
        let pass = LawPass { singles: &self.singles, pairs: &self.pairs, lines };
        // SAFETY: indices were checked by `push_*`, lines above.
        unsafe { run(arithmetic, pass) }
    }
}

#[cfg(test)]
mod tests {
    use crate::nlgs::ContactSet;
    use crate::nlgs::lattice_scene::LatticeScene;

    #[test]
    fn blocks_that_are_visited_at_once_share_no_body() {
        let problem = LatticeScene::grid([6, 5, 4], 3, 0.2, 11).problem;
        let contacts: Vec<u32> = (0..problem.contacts.len() as u32).collect();
        let mut set = ContactSet::default();
        set.pack(&problem, &contacts, problem.body_count(), |grain| grain);
        let blocks = set.blocks();
        let singles: Vec<Vec<u32>> = blocks.singles.iter().map(|b| b.grain.to_vec()).collect();
        let pairs = blocks.pairs.iter().map(|b| [b.candidate, b.antagonist].concat()).collect();
        let mut counts = [0; 2];
        for (grains, apart) in [singles, pairs].iter().zip(&blocks.disjoint_from_next) {
            assert_eq!(apart.len(), grains.len());
            assert!(!apart[grains.len() - 1]);
            for (two, &is_disjoint_from_next) in grains.windows(2).zip(apart) {
                let of_grain = |g: &&u32| **g < blocks.line_count;
                let shared = two[0].iter().filter(of_grain).any(|g| two[1].contains(g));
                assert_eq!(is_disjoint_from_next, !shared, "{two:?}");
                counts[usize::from(is_disjoint_from_next)] += 1;
            }
        }
        assert!(counts[0] > 0 && counts[1] > 0, "{counts:?}");
    }
}
