//! Greedy packing of contacts in blocks of eight that share no grain.
//!
//! Reads: the grains of each contact, in the caller's order. Writes: [`Packing`]. Cost: O(contacts).
//! Contract: every contact is in exactly one block; no grain occurs twice in a block; the result is
//! a function of the input alone.
//!
//! Contacts of a block are independent, so solving them simultaneously equals solving them one after the other: a
//! sweep over the blocks is an exact Gauss-Seidel sweep in the order *blocks, then lanes*. Blocks are ordered by
//! their first contacts, so that this order stays close to the caller's and recent blocks have brought a block's
//! grains into the cache. A block that shares grains with its predecessor is moved back by a few positions if that
//! helps: neighbours without common grains can be visited simultaneously.

use crate::lanes::LANES;

/// Mark of a lane without contact.
pub const PADDING: u32 = u32::MAX;

/// Maximum number of open blocks: one per bit of a grain's mask.
const MAX_OPEN_BLOCKS: usize = 64;

/// Number of blocks searched for one that shares no grain with its predecessor.
const MAX_SEARCHED_BLOCKS: usize = 32;

/// Blocks of contacts that share no grain, and the buffers to build them.
#[derive(Debug, Clone, Default)]
pub struct Packing {
    /// Positions in the caller's list, or [`PADDING`] `[blocks]`.
    pub blocks: Vec<[u32; LANES]>,
    /// Bit w is set if the grain is in open block w `[grains]`. All zero between calls.
    open_blocks: Vec<u64>,
    /// Grains of the contacts.
    grains: Vec<[u32; 2]>,
    /// Last block in the final order that contains the grain, counted from 1 `[grains]`.
    last_block: Vec<u32>,
}

/// Blocks with free lanes; slot `w` is bit `w` of the grains' masks.
struct OpenBlocks {
    /// Index of the block in the output.
    block: [u32; MAX_OPEN_BLOCKS],
    count: [u8; MAX_OPEN_BLOCKS],
    open: u64,
}

impl Packing {
    /// Packs contacts `0..count`; `grains(i)` are the grains of contact `i`, below `grain_count`.
    ///
    /// A contact with a driven body names its only grain twice.
    pub fn build(&mut self, count: usize, grain_count: usize, grains: impl Fn(usize) -> [u32; 2]) {
        self.blocks.clear();
        self.blocks.reserve(count.div_ceil(LANES) + 8);
        self.grains.clear();
        self.grains.extend((0..count).map(grains));
        self.open_blocks.resize(grain_count.max(self.open_blocks.len()), 0);
        let mut window =
            OpenBlocks { block: [0; MAX_OPEN_BLOCKS], count: [0; MAX_OPEN_BLOCKS], open: 0 };
        for i in 0..count {
            let [a, b] = self.grains[i].map(|g| g as usize);
            let free = window.open & !(self.open_blocks[a] | self.open_blocks[b]);
            let slot = if free != 0 {
                self.oldest(&window, free)
            } else {
                if window.open == u64::MAX {
                    let oldest = self.oldest(&window, window.open);
                    self.close(&mut window, oldest);
                }
                let slot = (!window.open).trailing_zeros() as usize;
                window.block[slot] = self.blocks.len() as u32;
                window.count[slot] = 0;
                window.open |= 1 << slot;
                self.blocks.push([PADDING; LANES]);
                slot
            };
            let lane = window.count[slot] as usize;
            self.blocks[window.block[slot] as usize][lane] = i as u32;
            window.count[slot] += 1;
            self.open_blocks[a] |= 1 << slot;
            self.open_blocks[b] |= 1 << slot;
            if window.count[slot] as usize == LANES {
                self.close(&mut window, slot);
            }
        }
        while window.open != 0 {
            let slot = window.open.trailing_zeros() as usize;
            self.close(&mut window, slot);
        }
        self.separate_neighbours();
    }

    /// Reorders blocks so that neighbours share no grain, within [`MAX_SEARCHED_BLOCKS`].
    fn separate_neighbours(&mut self) {
        let Self { blocks, grains, last_block, open_blocks } = self;
        last_block.clear();
        last_block.resize(open_blocks.len(), 0);
        let of_block = |block: &[u32; LANES]| {
            // Padding is beyond the list.
            block
                .map(|i| grains.get(i as usize))
                .into_iter()
                .flatten()
                .flatten()
                .map(|&g| g as usize)
        };
        for (k, number) in (1..blocks.len()).zip(1_u32..) {
            of_block(&blocks[k - 1]).for_each(|g| last_block[g] = number);
            let candidates = &mut blocks[k..];
            let reach = candidates.len().min(MAX_SEARCHED_BLOCKS);
            let is_apart = |block: &[u32; LANES]| of_block(block).all(|g| last_block[g] != number);
            if let Some(next) = candidates[..reach].iter().position(is_apart) {
                candidates[..=next].rotate_right(1);
            }
        }
    }

    /// Returns the slot of `candidates` whose block was opened first; filling it first keeps blocks local.
    fn oldest(&self, window: &OpenBlocks, mut candidates: u64) -> usize {
        let mut best = candidates.trailing_zeros() as usize;
        while candidates != 0 {
            let slot = candidates.trailing_zeros() as usize;
            candidates &= candidates - 1;
            if window.block[slot] < window.block[best] {
                best = slot;
            }
        }
        best
    }

    fn close(&mut self, window: &mut OpenBlocks, slot: usize) {
        let bit = 1_u64 << slot;
        for &i in &self.blocks[window.block[slot] as usize] {
            if i != PADDING {
                for g in self.grains[i as usize] {
                    self.open_blocks[g as usize] &= !bit;
                }
            }
        }
        window.open &= !bit;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, RngExt, SeedableRng};

    /// Fraction of lanes that contain a contact, and of blocks that share no grain with the next one.
    fn check(count: usize, grains: usize, pairs: &[[u32; 2]]) -> (f64, f64) {
        let mut packing = Packing::default();
        packing.build(count, grains, |i| pairs[i]);
        assert!(packing.open_blocks.iter().all(|&m| m == 0));
        let mut seen = vec![false; count];
        for block in &packing.blocks {
            let mut inside: Vec<u32> = Vec::new();
            for &i in block.iter().filter(|&&i| i != PADDING) {
                assert!(!std::mem::replace(&mut seen[i as usize], true));
                let [a, b] = pairs[i as usize];
                assert!(!inside.contains(&a) && !inside.contains(&b));
                inside.extend([a, b]);
            }
        }
        assert!(seen.iter().all(|&s| s));
        let of_block = |block: &[u32; LANES]| -> Vec<u32> {
            let contacts = block.iter().filter(|&&i| i != PADDING);
            contacts.flat_map(|&i| pairs[i as usize]).collect()
        };
        let is_apart = |two: &&[[u32; LANES]]| {
            let grains = of_block(&two[0]);
            of_block(&two[1]).iter().all(|g| !grains.contains(g))
        };
        let apart = packing.blocks.windows(2).filter(is_apart).count();
        let blocks = packing.blocks.len() as f64;
        (count as f64 / LANES as f64 / blocks, apart as f64 / blocks)
    }

    #[test]
    fn blocks_share_no_grain_hold_every_contact_and_are_nearly_full() {
        let mut rng = rand_pcg::Pcg64::seed_from_u64(3);
        // A line of grains with several points per neighbour pair: the shape of a real bed.
        let mut pairs = Vec::new();
        for g in 0..4000_u32 {
            for _ in 0..3 {
                let other = g + 1 + rng.next_u32() % 40;
                for _ in 0..rng.random_range(1..4) {
                    pairs.push([g, other.min(4040)]);
                }
            }
        }
        let (fill, _) = check(pairs.len(), 4100, &pairs);
        assert!(fill > 0.99, "{fill}");
    }

    #[test]
    fn blocks_of_a_bed_share_no_grain_with_the_next_one() {
        let mut pairs = Vec::new();
        for g in 0..12_u32.pow(3) {
            let is_last = |step: u32| g / step % 12 == 11;
            for step in [1, 12, 144].into_iter().filter(|&step| !is_last(step)) {
                pairs.extend([[g, g + step]; 3]);
            }
        }
        let (fill, apart) = check(pairs.len(), 1728, &pairs);
        assert!(fill > 0.97 && apart > 0.9, "{fill} {apart}");
    }

    #[test]
    fn one_grain_in_all_contacts_gives_one_contact_per_block() {
        let pairs: Vec<[u32; 2]> = (0..300).map(|_| [5, 5]).collect();
        assert_eq!(check(300, 6, &pairs), (1.0 / 8.0, 0.0));
        assert!(check(0, 0, &[]).0.is_nan());
    }
}
