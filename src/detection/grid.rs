//! Boxes sorted into cells by their centres.
//!
//! Reads: boxes. Writes: only its own buffers. Cost: O(boxes) to build, O(neighbours) per query. Contract: cells are
//! as large as all but the largest hundredth of the boxes, so that a box overlaps only boxes of its cell and the 26
//! around it. The largest hundredth is tested separately. Cells are numbered modulo the number of buckets: a distant
//! body costs no memory.

use crate::geometry::AxisBox;
use rayon::prelude::*;

/// Boxes per unit of parallel work.
const CHUNK: usize = 1024;

/// Boxes by cell.
#[derive(Debug, Default)]
pub(super) struct CellGrid {
    cell: f64,
    /// Cells in a row and in a layer, modulo the number of buckets.
    strides: [i64; 2],
    /// Number of buckets minus one; one less than a power of two.
    mask: i64,
    /// Start of each bucket in `members`.
    starts: Vec<u32>,
    /// Boxes by bucket, ascending, without the large ones.
    members: Vec<u32>,
    /// Largest boxes, ascending.
    large: Vec<u32>,
    is_large: Vec<bool>,
    bounds: [[i64; 3]; 2],
    /// Buffers of [`CellGrid::build`]: sizes of boxes, and the bucket of each.
    sizes: Vec<f64>,
    bucket_of: Vec<u32>,
}

impl CellGrid {
    pub fn build(&mut self, boxes: &[AxisBox]) {
        let size = |b: &AxisBox| (b.high - b.low).max();
        refill_in_parallel(&mut self.sizes, boxes, size);
        self.cell = 1.0;
        if !boxes.is_empty() {
            let rank = boxes.len().saturating_sub(1 + boxes.len() / 100);
            let (_, largest, _) = self.sizes.select_nth_unstable_by(rank, f64::total_cmp);
            if *largest > 0.0 {
                self.cell = *largest;
            }
        }
        let cell = self.cell;
        refill_in_parallel(&mut self.is_large, boxes, |b| size(b) > cell);
        let large = (0..boxes.len() as u32).filter(|i| self.is_large[*i as usize]);
        refill(&mut self.large, large);
        let small = || (0..boxes.len()).filter(|i| !self.is_large[*i]);

        let cells = (boxes, &self.is_large)
            .into_par_iter()
            .with_min_len(CHUNK)
            .filter(|(_, large)| !**large);
        let bounds = cells.map(|(b, _)| [self.cell_of(b); 2]);
        self.bounds = bounds.reduce(|| [[i64::MAX; 3], [i64::MIN; 3]], join);
        let buckets = (2 * boxes.len().max(1)).next_power_of_two();
        self.mask = buckets as i64 - 1;
        // One spare cell on each side distinguishes neighbours in the next row.
        let width =
            |k: usize| self.bounds[1][k].saturating_sub(self.bounds[0][k]).clamp(0, self.mask) + 3;
        let strides = [width(0) & self.mask, width(0).wrapping_mul(width(1)) & self.mask];
        self.strides = strides;

        let mut bucket = std::mem::take(&mut self.bucket_of);
        refill_in_parallel(&mut bucket, boxes, |b| self.bucket(&self.cell_of(b)) as u32);
        self.starts.clear();
        self.starts.resize(buckets + 1, 0);
        small().for_each(|i| self.starts[bucket[i] as usize] += 1);
        for k in 0..buckets {
            self.starts[k + 1] += self.starts[k];
        }
        // Fills the buckets from their ends backwards to their starts.
        self.members.resize(self.starts[buckets] as usize, 0);
        for i in (0..boxes.len()).rev().filter(|i| !self.is_large[*i]) {
            let slot = &mut self.starts[bucket[i] as usize];
            *slot -= 1;
            self.members[*slot as usize] = i as u32;
        }
        self.bucket_of = bucket;
    }

    fn cell_of(&self, b: &AxisBox) -> [i64; 3] {
        // A cast saturates, and maps NaN to zero.
        let c = (b.low + b.high) * (0.5 / self.cell);
        [c.x.floor() as i64, c.y.floor() as i64, c.z.floor() as i64]
            .map(|k| k.clamp(-MAX_CELL_INDEX, MAX_CELL_INDEX))
    }

    fn bucket(&self, c: &[i64; 3]) -> usize {
        let [row, layer] = self.strides;
        let sum = c[0].wrapping_add(c[1].wrapping_mul(row)).wrapping_add(c[2].wrapping_mul(layer));
        (sum & self.mask) as usize
    }

    fn in_bucket(&self, bucket: usize) -> &[u32] {
        &self.members[self.starts[bucket] as usize..self.starts[bucket + 1] as usize]
    }

    /// Calls `found` for the boxes above number `i` that overlap it, neither of them large; may repeat a box.
    pub fn for_each_above(&self, boxes: &[AxisBox], i: u32, mut found: impl FnMut(u32)) {
        if self.is_large[i as usize] {
            return;
        }
        let own = &boxes[i as usize];
        let [x, y, z] = self.cell_of(own);
        for dz in -1..=1 {
            for dy in -1..=1 {
                for dx in -1..=1 {
                    for &j in self.in_bucket(self.bucket(&[x + dx, y + dy, z + dz])) {
                        if j > i && own.meets(&boxes[j as usize]) {
                            found(j);
                        }
                    }
                }
            }
        }
    }

    /// Calls `found` for all boxes that overlap `bounds`; may repeat a box.
    pub fn for_each_meeting(
        &self,
        boxes: &[AxisBox],
        bounds: &AxisBox,
        mut found: impl FnMut(u32),
    ) {
        let mut check = |i: u32| {
            if bounds.meets(&boxes[i as usize]) {
                found(i);
            }
        };
        self.large.iter().for_each(|&i| check(i));
        // Centres of boxes that overlap `bounds` are at most half a cell outside.
        let half = crate::math::Vec3::repeat(0.5 * self.cell);
        let corner = |p| self.cell_of(&AxisBox { low: p, high: p });
        let (low, high) = (corner(bounds.low - half), corner(bounds.high + half));
        let low = [0, 1, 2].map(|k| low[k].max(self.bounds[0][k]));
        let high = [0, 1, 2].map(|k| high[k].min(self.bounds[1][k]));
        if (0..3).any(|k| low[k] > high[k]) {
            return;
        }
        let cells = (0..3).fold(1.0, |n, k| n * (high[k] - low[k] + 1) as f64);
        if cells > self.members.len() as f64 {
            self.members.iter().for_each(|&i| check(i));
            return;
        }
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    self.in_bucket(self.bucket(&[x, y, z])).iter().for_each(|&i| check(i));
                }
            }
        }
    }

    /// Appends the pairs with at least one large box, lower number first.
    pub fn large_pairs(&self, boxes: &[AxisBox], pairs: &mut Vec<(u32, u32)>) {
        for &l in &self.large {
            self.for_each_meeting(boxes, &boxes[l as usize], |j| {
                if j != l && (l < j || !self.is_large[j as usize]) {
                    pairs.push((l.min(j), l.max(j)));
                }
            });
        }
    }
}

/// Returns the bounds of both ranges.
fn join(a: [[i64; 3]; 2], b: [[i64; 3]; 2]) -> [[i64; 3]; 2] {
    let each = |side: usize, of: fn(i64, i64) -> i64| [0, 1, 2].map(|k| of(a[side][k], b[side][k]));
    [each(0, i64::min), each(1, i64::max)]
}

fn refill_in_parallel<T: Send>(
    all: &mut Vec<T>,
    boxes: &[AxisBox],
    with: impl Fn(&AxisBox) -> T + Send + Sync,
) {
    boxes.par_iter().with_min_len(CHUNK).map(with).collect_into_vec(all);
}

fn refill<T>(all: &mut Vec<T>, with: impl Iterator<Item = T>) {
    all.clear();
    all.extend(with);
}

/// Maximum absolute cell number, so that sums of cell numbers stay within i64.
const MAX_CELL_INDEX: i64 = 1 << 40;
