//! Passes over blocks, written once for all arithmetics.

use super::coupling::{ContactBlock, dot};
use crate::lanes::{BodyVelocity, Lanes, VelocityKernel, each, prefetch_at};
use crate::nlgs::block::{NncgBlock, PairBlock, Row64, SingleBlock};
use crate::nlgs::local_solve::{self, LawLanes, LocalSolve};
use crate::nlgs::residual::{NaturalMapSums, VisitNorms};

/// What a sweep takes down of its visits.
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

/// Lane by lane sums of a measured sweep, in the order of [`VisitNorms`]' fields but the last.
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

/// Blocks that are asked for before their turn. They come in order, but each is a third of a page, at
/// whose end the processor's own prefetching stops: a quarter to a half is gained out of cache.
const PREFETCH_DISTANCE: usize = 6;

/// Asks for a block; its number may be anything.
#[inline(always)]
fn expect<B>(blocks: &[B], number: usize) {
    prefetch_at(blocks.as_ptr().wrapping_add(number).cast(), size_of::<B>());
}

/// The `k`-th of some numbers of blocks; any number if `k` is too large.
#[inline(always)]
fn number(of: &[u32], k: usize) -> usize {
    of.get(k).map_or(0, |&i| i as usize)
}

/// The blocks that a sweep visits, in ascending order.
pub trait BlockSelection {
    /// Whether many of them are likely to carry nothing: then it pays to look before the law is solved.
    const MOSTLY_INACTIVE: bool;
    fn count(&self) -> usize;
    /// The `k`-th of them; any number if `k` is too large.
    fn block(&self, k: usize) -> usize;
    /// Whether there is a next one, which shares no grain with the `k`-th.
    fn is_disjoint_from_next(&self, k: usize) -> bool;
}

/// All blocks; whether each shares no grain with the one after it.
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

/// Some of the blocks.
pub struct ActiveBlocks<'a> {
    pub blocks: &'a [u32],
    /// Of all blocks, as in [`AllBlocks`].
    pub apart: &'a [bool],
}

impl BlockSelection for ActiveBlocks<'_> {
    const MOSTLY_INACTIVE: bool = false;
    #[inline(always)]
    fn count(&self) -> usize {
        self.blocks.len()
    }
    #[inline(always)]
    fn block(&self, k: usize) -> usize {
        number(self.blocks, k)
    }
    #[inline(always)]
    fn is_disjoint_from_next(&self, k: usize) -> bool {
        let i = self.block(k);
        // Of others it is not known.
        self.block(k + 1) == i + 1 && self.apart[i]
    }
}

/// Where an impulse is not zero, or not a number.
#[inline(always)]
fn carries<L: Lanes>(r: &[L; 3]) -> L::Mask {
    let zero = L::splat(0.0);
    let size = r[0].abs().add(r[1].abs().add(r[2].abs()));
    L::and_not(zero.le(zero), size.le(zero))
}

/// A block as a visit finds it.
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

    /// Open contacts that stay open: nothing would change.
    #[inline(always)]
    fn rests(&self) -> bool {
        !L::any(L::or(self.approach.1, carries(&self.r)))
    }

    #[inline(always)]
    fn visit(&self, block: &B) -> LocalSolve<L> {
        LocalSolve::begin(&self.law, self.approach, &self.u, &self.r, &block.law().slip)
    }

    /// Ends the visit: impulses and lines are changed by what it has found, relaxed.
    #[inline(always)]
    unsafe fn end<R: SweepRecorder<L>>(
        self,
        visit: LocalSolve<L>,
        block: &mut B,
        lines: &mut [BodyVelocity],
        relaxation: L,
        record: &mut R,
    ) {
        let (impulse, slip) = block.outcome();
        let closed = self.approach.1;
        let solved = visit.end(&self.law, slip);
        let change = each!(K in 3 => solved[K].sub(self.r[K]));
        // What opens loses all of its impulse: a share would stay on a contact that moves apart, and never quite be gone.
        let share = L::select(closed, relaxation, L::splat(1.0));
        let delta = each!(K in 3 => share.mul(change[K]));
        let after = each!(K in 3 => self.r[K].add(delta[K]));
        for k in 0..3 {
            after[k].store(&mut impulse[k]);
        }
        // Not what is done of it: a relaxed visit is no better solved.
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
        expect(blocks, choice.block(k + PREFETCH_DISTANCE));
        let i = choice.block(k);
        if L::PAIRS_OF_BLOCKS && choice.is_disjoint_from_next(k) {
            expect(blocks, choice.block(k + 1 + PREFETCH_DISTANCE));
            let [one, other] = &mut blocks[i..][..2] else { unreachable!("a slice of two") };
            k += 2;
            // SAFETY: the caller's.
            let (first, second) =
                unsafe { (LoadedBlock::read(&*one, lines), LoadedBlock::read(&*other, lines)) };
            if C::MOSTLY_INACTIVE && first.rests() && second.rests() {
                continue;
            }
            let mut visits = [first.visit(one), second.visit(other)];
            local_solve::search(&mut visits);
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
            if C::MOSTLY_INACTIVE && found.rests() {
                continue;
            }
            let mut visits = [found.visit(block)];
            local_solve::search(&mut visits);
            let [visit] = visits;
            // SAFETY: the caller's.
            unsafe { found.end(visit, block, lines, relaxation, record) };
        }
    }
}

pub struct SweepPass<'a, C> {
    pub singles: &'a mut [SingleBlock],
    pub pairs: &'a mut [PairBlock],
    /// Which of the singles and which of the pairs.
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

pub struct PlainSweep<'a, C>(pub SweepPass<'a, C>);

impl<C: BlockSelection> VelocityKernel for PlainSweep<'_, C> {
    type Output = ();
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) {
        // SAFETY: the caller's.
        unsafe { self.0.recorded::<L, ()>() };
    }
}

pub struct MeasuredSweep<'a>(pub SweepPass<'a, AllBlocks<'a>>);

impl VelocityKernel for MeasuredSweep<'_> {
    type Output = VisitNorms;
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) -> VisitNorms {
        // SAFETY: the caller's.
        unsafe { self.0.recorded::<L, NormSums<L>>() }
    }
}

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

/// Impulses of the chosen blocks as they are to be, block after block.
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

/// Gives a block the impulses of its cones nearest to `wanted`, and the lines what the change causes; returns them.
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
    let (impulse, _) = block.outcome();
    for k in 0..3 {
        r[k].store(&mut impulse[k]);
    }
    // SAFETY: the caller's.
    unsafe { block.push(gathered, &delta, lines) };
    r
}

/// Goes on from the impulses that the chosen blocks have, block after block (T-37).
pub struct Extrapolate<'a> {
    pub singles: &'a mut [SingleBlock],
    pub pairs: &'a mut [PairBlock],
    pub choice: [&'a [u32]; 2],
    pub memories: &'a mut [NncgBlock],
    pub share: f64,
    pub lines: &'a mut [BodyVelocity],
}

impl VelocityKernel for Extrapolate<'_> {
    type Output = ();
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) {
        let ([singles, pairs], share) = (self.choice, L::splat(self.share));
        let (of_singles, of_pairs) = self.memories.split_at_mut(singles.len());
        // SAFETY: the caller's.
        unsafe {
            extrapolate(self.singles, singles, of_singles, share, self.lines);
            extrapolate(self.pairs, pairs, of_pairs, share, self.lines);
        }
    }
}

#[inline(always)]
unsafe fn extrapolate<L: Lanes, B: ContactBlock>(
    blocks: &mut [B],
    choice: &[u32],
    memories: &mut [NncgBlock],
    share: L,
    lines: &mut [BodyVelocity],
) {
    for (k, (&i, memory)) in choice.iter().zip(memories).enumerate() {
        expect(blocks, number(choice, k + PREFETCH_DISTANCE));
        let block = &mut blocks[i as usize];
        let r = each!(K in 3 => L::load(&block.impulse()[K]));
        let change = each!(K in 3 => r[K].sub(L::load(&memory.before[K])));
        let further = each!(K in 3 => share.mul(L::load(&memory.direction[K])));
        // SAFETY: the caller's.
        let on = unsafe { replace(block, &each!(K in 3 => r[K].add(further[K])), lines) };
        for k in 0..3 {
            on[k].store(&mut memory.before[k]);
            further[k].add(change[k]).store(&mut memory.direction[k]);
        }
    }
}

pub struct NaturalMapPass<'a> {
    pub singles: &'a [SingleBlock],
    pub pairs: &'a [PairBlock],
    pub lines: &'a [BodyVelocity],
}

impl VelocityKernel for NaturalMapPass<'_> {
    type Output = NaturalMapSums;
    #[inline(always)]
    unsafe fn run<L: Lanes>(self) -> NaturalMapSums {
        let mut sums = [L::splat(0.0); 2];
        // SAFETY: the caller's.
        unsafe {
            natural_blocks(self.singles, self.lines, &mut sums);
            natural_blocks(self.pairs, self.lines, &mut sums);
        }
        let [map_squared, r_squared] = sums.map(|lanes| {
            let mut row = [0.0; 8];
            lanes.store(&mut row);
            row.iter().sum()
        });
        NaturalMapSums { map_squared, r_squared }
    }
}

#[inline(always)]
unsafe fn natural_blocks<L: Lanes, B: ContactBlock>(
    blocks: &[B],
    lines: &[BodyVelocity],
    sums: &mut [L; 2],
) {
    for block in blocks {
        // SAFETY: the caller's.
        let (_, u) = unsafe { block.read::<L>(lines) };
        let r = each!(K in 3 => L::load(&block.impulse()[K]));
        let map = local_solve::natural_map(&LawLanes::load(block.law()), &u, &r);
        sums[0] = dot(&map, map, sums[0]);
        sums[1] = dot(&r, r, sums[1]);
    }
}
