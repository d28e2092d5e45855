//! Eight lanes as an array, for any processor.

use super::body_velocity::BodyVelocity;
use super::operations::{LANES, Lanes};

/// Plain array of lanes.
#[derive(Clone, Copy)]
pub struct Portable([f64; LANES]);

#[inline(always)]
fn each(f: impl Fn(usize) -> f64) -> Portable {
    Portable(std::array::from_fn(f))
}

impl Lanes for Portable {
    type Mask = [bool; LANES];

    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([x; LANES])
    }
    #[inline(always)]
    fn load(row: &[f64; LANES]) -> Self {
        Self(*row)
    }
    #[inline(always)]
    fn load32(row: &[f32; LANES]) -> Self {
        each(|i| row[i].into())
    }
    #[inline(always)]
    fn store(self, row: &mut [f64; LANES]) {
        *row = self.0;
    }
    #[inline(always)]
    fn store32(self, row: &mut [f32; LANES]) {
        *row = self.0.map(|x| x as f32);
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        each(|i| self.0[i] + other.0[i])
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        each(|i| self.0[i] - other.0[i])
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        each(|i| self.0[i] * other.0[i])
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        each(|i| self.0[i] / other.0[i])
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        each(|i| self.0[i].sqrt())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        each(|i| self.0[i].abs())
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        each(|i| self.0[i].mul_add(b.0[i], c.0[i]))
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        each(|i| self.0[i].mul_add(b.0[i], -c.0[i]))
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        each(|i| (-self.0[i]).mul_add(b.0[i], c.0[i]))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        std::array::from_fn(|i| self.0[i] < other.0[i])
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        std::array::from_fn(|i| self.0[i] <= other.0[i])
    }
    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        std::array::from_fn(|i| a[i] & b[i])
    }
    #[inline(always)]
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        std::array::from_fn(|i| a[i] | b[i])
    }
    #[inline(always)]
    fn and_not(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        std::array::from_fn(|i| a[i] & !b[i])
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        mask.contains(&true)
    }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        each(|i| if mask[i] { yes.0[i] } else { no.0[i] })
    }
    #[inline(always)]
    unsafe fn gather(lines: &[BodyVelocity], indices: &[u32; LANES]) -> [Self; 8] {
        let read = indices.map(|i| lines[i as usize].0);
        std::array::from_fn(|j| each(|lane| read[lane][j]))
    }
    #[inline(always)]
    unsafe fn scatter(rows: [Self; 8], lines: &mut [BodyVelocity], indices: &[u32; LANES]) {
        for lane in 0..LANES {
            lines[indices[lane] as usize] = BodyVelocity(rows.map(|row| row.0[lane]));
        }
    }
}
