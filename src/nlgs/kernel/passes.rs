//! Passes over blocks, generic over the instruction set.

use super::coupling::{ContactBlock, dot};
use crate::lanes::{BodyVelocity, Lanes, VelocityKernel, each, prefetch_at};
use crate::nlgs::block::{NncgBlock, PairBlock, Row64, SingleBlock};
use crate::nlgs::local_solve::{self, LawLanes, LocalSolve};
use crate::nlgs::residual::{ComplementarityGap, ContactLawSums, VisitNorms};

/// Recorder of the visits of a sweep.
trait SweepRecorder<L: Lanes>: Copy {
    fn none() -> Self;
    fn visit(&mut self, law: &LawLanes<L>, change: &[L; 3], r: &[L; 3]);
    fn sums(self) -> VisitNorms;
}

impl<L: Lanes> SweepRecorder<L> for () {
    #[inline(always)]
    fn none() {}
    #[inline(always)]
    fn visit(&mut self, _: &LawLanes<L>, _: &[L; 3], _: &[L; 3]) {}
    #[inline(always)]
    fn sums(self) -> VisitNorms {
        VisitNorms::default()
    }
}

/// Lane-wise sums of a measured sweep, in the order of the fields of [`VisitNorms`] without the last.
#[derive(Clone, Copy)]
struct NormSums<L>([L; 7]);

impl<L: Lanes> SweepRecorder<L> for NormSums<L> {
    #[inline(always)]
    fn none() -> Self {
        Self([L::splat(0.0); 7])
    }
    #[inline(always)]
    fn visit(&mut self, law: &LawLanes<L>, change: &[L; 3], r: &[L; 3]) {
        let zero = L::splat(0.0);
        let change_squared = dot(change, *change, zero);
        let active = L::or(zero.lt(r[0]), zero.lt(change_squared));
        let dv = local_solve::delassus_times(law, change, active);
        let wr = local_solve::delassus_times(law, r, active);
        let dv_squared = dot(&dv, dv, zero);
        let terms = [
            L::select(active, L::splat(1.0), zero),
            dv_squared,
            dot(&wr, wr, zero),
            dot(r, wr, zero),
            dot(r, dv, zero),
            dv_squared.mul(dot(r, *r, zero)),
        ];
        let max = L::select(self.0[6].lt(dv_squared), dv_squared, self.0[6]);
        let [a, b, c, d, e, f] = each!(J in [0, 1, 2, 3, 4, 5] => self.0[J].add(terms[J]));
        self.0 = [a, b, c, d, e, f, max];
    }
    #[inline(always)]
    fn sums(self) -> VisitNorms {
        let rows = self.0.map(|lanes| {
            let mut row = [0.0; 8];
            lanes.store(&mut row);
            row
        });
        let sum = |i: usize| rows[i].iter().sum::<f64>();
        VisitNorms {
            active: sum(0),
            dv_squared: sum(1),
            wr_squared: sum(2),
            r_wr: sum(3),
            r_dv: sum(4),
            r_squared_dv_squared: sum(5),
            max_dv_squared: rows[6].iter().copied().fold(0.0, f64::max),
            speed_squared: 0.0,
        }
    }
}

/// Prefetch distance in blocks.
///
/// Blocks are read in order, but each is a third of a page, at whose end hardware prefetching stops. Prefetching saves a
/// quarter to a half of the time of a sweep out of cache.
const PREFETCH_DISTANCE: usize = 6;

/// Prefetches a block; its number may be out of range.
#[inline(always)]
fn prefetch_block<B>(blocks: &[B], number: usize) {
    prefetch_at(blocks.as_ptr().wrapping_add(number).cast(), size_of::<B>());
}

/// Returns the `k`-th block number; zero if `k` is out of range.
#[inline(always)]
fn block_number(of: &[u32], k: usize) -> usize {
    of.get(k).map_or(0, |&i| i as usize)
}

/// Selection of the blocks of a sweep, in ascending order.
pub trait BlockSelection {
    /// True if many of the blocks are likely inactive, so that a test before the local solve pays.
    const MOSTLY_INACTIVE: bool;
    /// Number of selected blocks.
    fn count(&self) -> usize;
    /// Returns the number of the `k`-th block; any number if `k` is out of range.
    fn block(&self, k: usize) -> usize;
    /// Returns true if there is a next block, which shares no body with the `k`-th.
    fn is_disjoint_from_next(&self, k: usize) -> bool;
}

/// Selection of all blocks, with the flags of those that share no body with the next.
pub struct AllBlocks<'a>(pub &'a [bool]);

impl BlockSelection for AllBlocks<'_> {
    const MOSTLY_INACTIVE: bool = true;
    #[inline(always)]
    fn count(&self) -> usize {
        self.0.len()
    }
    #[inline(always)]
    fn block(&self, k: usize) -> usize {
        k
    }
    #[inline(always)]
    fn is_disjoint_from_next(&self, k: usize) -> bool {
        self.0[k]
    }
}

/// Selection of the active blocks.
pub struct ActiveBlocks<'a> {
    /// Numbers of the selected blocks.
    pub blocks: &'a [u32],
    /// Flags of all blocks, as in [`AllBlocks`].
    pub disjoint_from_next: &'a [bool],
}

impl BlockSelection for ActiveBlocks<'_> {
    const MOSTLY_INACTIVE: bool = false;
    #[inline(always)]
    fn count(&self) -> usize {
        self.blocks.len()
    }
    #[inline(always)]
    fn block(&self, k: usize) -> usize {
        block_number(self.blocks, k)
    }
    #[inline(always)]
    fn is_disjoint_from_next(&self, k: usize) -> bool {
        let i = self.block(k);
        // The flag is known for consecutive blocks only.
        self.block(k + 1) == i + 1 && self.disjoint_from_next[i]
    }
}

/// Lanes whose impulse is not zero, or NaN.
#[inline(always)]
fn has_impulse<L: Lanes>(r: &[L; 3]) -> L::Mask {
    let zero = L::splat(0.0);
    let size = r[0].abs().add(r[1].abs().add(r[2].abs()));
    L::and_not(zero.le(zero), size.le(zero))
}

/// Block loaded for a visit, with its relative velocities and impulses.
struct LoadedBlock<L: Lanes, B: ContactBlock> {
    gathered: B::Gathered<L>,
    u: [L; 3],
    r: [L; 3],
    law: LawLanes<L>,
    approach: (L, L::Mask),
}

impl<L: Lanes, B: ContactBlock> LoadedBlock<L, B> {
    #[inline(always)]
    unsafe fn read(block: &B, lines: &[BodyVelocity]) -> Self {
        // SAFETY: the caller's.
        let (gathered, u) = unsafe { block.read::<L>(lines) };
        let law = LawLanes::load(block.law());
        let r = each!(K in 3 => L::load(&block.impulse()[K]));
        let approach = local_solve::approach(&law, &u, &r);
        Self { gathered, u, r, law, approach }
    }

    /// Returns true if all contacts are open and stay open, so that a visit changes nothing.
    #[inline(always)]
    fn stays_open(&self) -> bool {
        !L::any(L::or(self.approach.1, has_impulse(&self.r)))
    }

    #[inline(always)]
    fn visit(&self, block: &B) -> LocalSolve<L> {
        LocalSolve::start(&self.law, self.approach, &self.u, &self.r, &block.law().slip)
    }

    /// Ends the visit: applies the relaxed result to impulses and velocities.
    #[inline(always)]
    unsafe fn end<R: SweepRecorder<L>>(
        self,
        visit: LocalSolve<L>,
        block: &mut B,
        lines: &mut [BodyVelocity],
        relaxation: L,
        record: &mut R,
    ) {
        let (impulse, slip) = block.result_mut();
        let closed = self.approach.1;
        let solved = visit.finish(&self.law, slip);
        let change = each!(K in 3 => solved[K].sub(self.r[K]));
        // An opening contact loses its whole impulse: a relaxed remainder would never vanish from a separating contact.
        let factor = L::select(closed, relaxation, L::splat(1.0));
        let delta = each!(K in 3 => factor.mul(change[K]));
        let after = each!(K in 3 => self.r[K].add(delta[K]));
        for k in 0..3 {
            after[k].store(&mut impulse[k]);
        }
        // The unrelaxed change: relaxation does not reduce the residual.
        record.visit(&self.law, &change, &after);
        // SAFETY: the caller's.
        unsafe { block.push(self.gathered, &delta, lines) };
    }
}

#[inline(always)]
unsafe fn sweep_blocks<L: Lanes, B: ContactBlock, R: SweepRecorder<L>, C: BlockSelection>(
    blocks: &mut [B],
    choice: C,
    lines: &mut [BodyVelocity],
    relaxation: L,
    record: &mut R,
) {
    let mut k = 0;
    while k < choice.count() {
        prefetch_block(blocks, choice.block(k + PREFETCH_DISTANCE));
        let i = choice.block(k);
        if L::PAIRS_OF_BLOCKS && choice.is_disjoint_from_next(k) {
            prefetch_block(blocks, choice.block(k + 1 + PREFETCH_DISTANCE));
            let [one, other] = &mut blocks[i..][..2] else { unreachable!("a slice of two") };
            k += 2;
            // SAFETY: the caller's.
            let (first, second) =
                unsafe { (LoadedBlock::read(&*one, lines), LoadedBlock::read(&*other, lines)) };
            if C::MOSTLY_INACTIVE && first.stays_open() && second.stays_open() {
                continue;
            }
            let mut visits = [first.visit(one), second.visit(other)];
            local_solve::solve_slip(&mut visits);
            let [of_first, of_second] = visits;
            // SAFETY: the caller's.
            unsafe {
                first.end(of_first, one, lines, relaxation, record);
                second.end(of_second, other, lines, relaxation, record);
            }
        } else {
            let block = &mut blocks[i];
            k += 1;
            // SAFETY: the caller's.
            let found = unsafe { LoadedBlock::<L, B>::read(block, lines) };
            if C::MOSTLY_INACTIVE && found.stays_open() {
                continue;
            }
            let mut visits = [found.visit(block)];
            local_solve::solve_slip(&mut visits);
            let [visit] = visits;
            // SAFETY: the caller's.
            unsafe { found.end(visit, block, lines, relaxation, record) };
        }
    }
}

/// Sweep over the selected blocks.
pub struct SweepPass<'a, C> {
    pub singles: &'a mut [SingleBlock],
    pub pairs: &'a mut [PairBlock],
    /// Selections of singles and of pairs.
    pub choice: [C; 2],
    pub lines: &'a mut [BodyVelocity],
    pub relaxation: f64,
}

impl<C: BlockSelection> SweepPass<'_, C> {
    #[inline(always)]
    unsafe fn recorded<L: Lanes, R: SweepRecorder<L>>(self) -> VisitNorms {
        let relaxation = L::splat(self.relaxation);
        let mut record = R::none();
        let [singles, pairs] = self.choice;
        // SAFETY: the caller's.
        unsafe {
            sweep_blocks(self.singles, singles, self.lines, relaxation, &mut record);
            sweep_blocks(self.pairs, pairs, self.lines, relaxation, &mut record);
        }
        record.sums()
    }
}

/// Sweep without measurement.
pub struct PlainSweep<'a, C>(pub SweepPass<'a, C>);

impl<C: BlockSelection> VelocityKernel for PlainSweep<'_, C> {
    type Output = ();
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) {
        // SAFETY: the caller's.
        unsafe { self.0.recorded::<L, ()>() };
    }
}

/// Sweep with the norms of its visits.
pub struct MeasuredSweep<'a>(pub SweepPass<'a, AllBlocks<'a>>);

impl VelocityKernel for MeasuredSweep<'_> {
    type Output = VisitNorms;
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) -> VisitNorms {
        // SAFETY: the caller's.
        unsafe { self.0.recorded::<L, NormSums<L>>() }
    }
}

/// Pass that adds the effect of the impulses to the velocities.
pub struct ApplyImpulses<'a> {
    pub singles: &'a [SingleBlock],
    pub pairs: &'a [PairBlock],
    pub lines: &'a mut [BodyVelocity],
}

impl VelocityKernel for ApplyImpulses<'_> {
    type Output = ();
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) {
        // SAFETY: the caller's.
        unsafe {
            apply_blocks::<L, _>(self.singles, self.lines);
            apply_blocks::<L, _>(self.pairs, self.lines);
        }
    }
}

#[inline(always)]
unsafe fn apply_blocks<L: Lanes, B: ContactBlock>(blocks: &[B], lines: &mut [BodyVelocity]) {
    for block in blocks {
        let r = each!(K in 3 => L::load(&block.impulse()[K]));
        // SAFETY: the caller's.
        unsafe {
            let (gathered, _) = block.read::<L>(lines);
            block.push(gathered, &r, lines);
        }
    }
}

/// Pass that replaces the impulses of a subset, block after block.
pub struct ReplaceImpulses<'a> {
    pub singles: &'a mut [SingleBlock],
    pub pairs: &'a mut [PairBlock],
    pub choice: [&'a [u32]; 2],
    pub impulses: &'a [[Row64; 3]],
    pub lines: &'a mut [BodyVelocity],
}

impl VelocityKernel for ReplaceImpulses<'_> {
    type Output = ();
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) {
        let [singles, pairs] = self.choice;
        let (of_singles, of_pairs) = self.impulses.split_at(singles.len());
        // SAFETY: the caller's.
        unsafe {
            replace_blocks::<L, _>(self.singles, singles, of_singles, self.lines);
            replace_blocks::<L, _>(self.pairs, pairs, of_pairs, self.lines);
        }
    }
}

#[inline(always)]
unsafe fn replace_blocks<L: Lanes, B: ContactBlock>(
    blocks: &mut [B],
    choice: &[u32],
    impulses: &[[Row64; 3]],
    lines: &mut [BodyVelocity],
) {
    for (&i, wanted) in choice.iter().zip(impulses) {
        let block = &mut blocks[i as usize];
        let wanted = each!(K in 3 => L::load(&wanted[K]));
        // SAFETY: the caller's.
        unsafe { replace(block, &wanted, lines) };
    }
}

/// Sets the impulses of a block to the projections of `wanted` on its cones, updates the velocities, and returns the
/// impulses.
#[inline(always)]
unsafe fn replace<L: Lanes, B: ContactBlock>(
    block: &mut B,
    wanted: &[L; 3],
    lines: &mut [BodyVelocity],
) -> [L; 3] {
    // SAFETY: the caller's.
    let (gathered, _) = unsafe { block.read::<L>(lines) };
    let r = local_solve::project(L::load32(&block.law().friction), wanted);
    let delta = each!(K in 3 => r[K].sub(L::load(&block.impulse()[K])));
    let (impulse, _) = block.result_mut();
    for k in 0..3 {
        r[k].store(&mut impulse[k]);
    }
    // SAFETY: the caller's.
    unsafe { block.push(gathered, &delta, lines) };
    r
}

/// Pass that moves the impulses of a subset along their search direction, block after block (T-37).
pub struct Extrapolate<'a> {
    pub singles: &'a mut [SingleBlock],
    pub pairs: &'a mut [PairBlock],
    pub choice: [&'a [u32]; 2],
    pub memories: &'a mut [NncgBlock],
    pub beta: f64,
    pub lines: &'a mut [BodyVelocity],
}

impl VelocityKernel for Extrapolate<'_> {
    type Output = ();
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) {
        let ([singles, pairs], beta) = (self.choice, L::splat(self.beta));
        let (of_singles, of_pairs) = self.memories.split_at_mut(singles.len());
        // SAFETY: the caller's.
        unsafe {
            extrapolate_blocks(self.singles, singles, of_singles, beta, self.lines);
            extrapolate_blocks(self.pairs, pairs, of_pairs, beta, self.lines);
        }
    }
}

#[inline(always)]
unsafe fn extrapolate_blocks<L: Lanes, B: ContactBlock>(
    blocks: &mut [B],
    choice: &[u32],
    memories: &mut [NncgBlock],
    beta: L,
    lines: &mut [BodyVelocity],
) {
    for (k, (&i, memory)) in choice.iter().zip(memories).enumerate() {
        prefetch_block(blocks, block_number(choice, k + PREFETCH_DISTANCE));
        let block = &mut blocks[i as usize];
        let r = each!(K in 3 => L::load(&block.impulse()[K]));
        let change = each!(K in 3 => r[K].sub(L::load(&memory.before[K])));
        let further = each!(K in 3 => beta.mul(L::load(&memory.direction[K])));
        // SAFETY: the caller's.
        let on = unsafe { replace(block, &each!(K in 3 => r[K].add(further[K])), lines) };
        for k in 0..3 {
            on[k].store(&mut memory.before[k]);
            further[k].add(change[k]).store(&mut memory.direction[k]);
        }
    }
}

/// Pass that sums the natural map and the complementarity gap.
pub struct LawPass<'a> {
    pub singles: &'a [SingleBlock],
    pub pairs: &'a [PairBlock],
    pub lines: &'a [BodyVelocity],
}

impl VelocityKernel for LawPass<'_> {
    type Output = ContactLawSums;
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) -> ContactLawSums {
        let mut sums = [L::splat(0.0); 4];
        // SAFETY: the caller's.
        unsafe {
            law_blocks(self.singles, self.lines, &mut sums);
            law_blocks(self.pairs, self.lines, &mut sums);
        }
        let [map_squared, r_squared, gap, infeasible] = sums.map(|lanes| {
            let mut row = [0.0; 8];
            lanes.store(&mut row);
            row.iter().sum()
        });
        let complementarity = ComplementarityGap { gap, infeasible };
        ContactLawSums { map_squared, r_squared, complementarity }
    }
}

#[inline(always)]
unsafe fn law_blocks<L: Lanes, B: ContactBlock>(
    blocks: &[B],
    lines: &[BodyVelocity],
    sums: &mut [L; 4],
) {
    for block in blocks {
        // SAFETY: the caller's.
        let (_, u) = unsafe { block.read::<L>(lines) };
        let r = each!(K in 3 => L::load(&block.impulse()[K]));
        let law = LawLanes::load(block.law());
        let map = local_solve::natural_map(&law, &u, &r);
        sums[0] = dot(&map, map, sums[0]);
        sums[1] = dot(&r, r, sums[1]);
        let [gap, infeasible] = local_solve::complementarity(&law, &u, &r);
        sums[2] = sums[2].add(gap);
        sums[3] = sums[3].add(infeasible);
    }
}
