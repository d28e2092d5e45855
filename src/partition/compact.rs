//! Compact subdomains of equal weight: recursive bisection across the longest side.

use crate::geometry::AxisBox;
use crate::math::Vec3;

/// Slices of the longest side in the search for the median.
///
/// A slice of a bed is thinner than a grain, so the imbalance is a few grains at most.
const SLICES: usize = 1024;

/// Minimum number of grains of a branch that runs on another thread.
const GRAIN_OF_WORK: usize = 4096;

/// Assigns a subdomain `0..n` to each position, so that weights are equal and boxes compact.
pub(super) fn assign(n: usize, position: &[Vec3], weight: &[u32], owner: &mut [u32]) {
    let mut items: Vec<u32> = (0..position.len() as u32).collect();
    let mut spare = items.clone();
    let parts = bisect(n, 0, &mut items, &mut spare, position, weight);
    for (range, part) in parts {
        for &item in &items[range] {
            owner[item as usize] = part;
        }
    }
}

type Parts = Vec<(std::ops::Range<usize>, u32)>;

/// Splits `items` into `n` parts numbered from `first`; ranges are relative to `items`.
fn bisect(
    n: usize,
    first: u32,
    items: &mut [u32],
    spare: &mut [u32],
    position: &[Vec3],
    weight: &[u32],
) -> Parts {
    if n <= 1 || items.is_empty() {
        return vec![(0..items.len(), first)];
    }
    let below = n / 2;
    let cut = split(below as f64 / n as f64, items, spare, position, weight);
    let (left, right) = items.split_at_mut(cut);
    let (spare_left, spare_right) = spare.split_at_mut(cut);
    let next = first + below as u32;
    let parallel = left.len() + right.len() > GRAIN_OF_WORK;
    let a = |left, spare_left| bisect(below, first, left, spare_left, position, weight);
    let b = |right, spare_right| bisect(n - below, next, right, spare_right, position, weight);
    let (mut parts, above) = if parallel {
        rayon::join(|| a(left, spare_left), || b(right, spare_right))
    } else {
        (a(left, spare_left), b(right, spare_right))
    };
    parts.extend(above.into_iter().map(|(r, part)| (r.start + cut..r.end + cut, part)));
    parts
}

/// Reorders `items` so that the first ones have about `share` of the weight and lie below a plane.
///
/// The plane is perpendicular to the longest side. Returns the number of items below; the order on either side is
/// kept.
fn split(
    share: f64,
    items: &mut [u32],
    spare: &mut [u32],
    position: &[Vec3],
    weight: &[u32],
) -> usize {
    let AxisBox { low, high } = AxisBox::around(items.iter().map(|&i| position[i as usize]));
    let extent = high - low;
    let axis = extent.imax();
    let scale = if extent[axis] > 0.0 { SLICES as f64 / extent[axis] } else { 0.0 };
    let slice =
        |i: u32| (((position[i as usize][axis] - low[axis]) * scale) as usize).min(SLICES - 1);
    let mut histogram = [0u64; SLICES];
    for &i in items.iter() {
        histogram[slice(i)] += u64::from(weight[i as usize]);
    }
    let wanted = share * histogram.iter().sum::<u64>() as f64;
    let mut sum = 0.0;
    let mut first_above = 0;
    // A slice is below if that brings the share nearer to the requested one.
    while first_above < SLICES && sum + 0.5 * histogram[first_above] as f64 <= wanted {
        sum += histogram[first_above] as f64;
        first_above += 1;
    }
    let (mut below, mut above) = (0, 0);
    for k in 0..items.len() {
        let item = items[k];
        if slice(item) < first_above {
            items[below] = item;
            below += 1;
        } else {
            spare[above] = item;
            above += 1;
        }
    }
    items[below..].copy_from_slice(&spare[..above]);
    below
}
