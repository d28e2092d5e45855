//! Eight f64 at a time, one arithmetic on every processor.
//!
//! Every operation is an IEEE operation rounded once (fused where it says fused), so all
//! implementations give the same bits.

use super::body_velocity::BodyVelocity;

/// Number of lanes: numbers that one operation processes.
pub const LANES: usize = 8;

/// `[f(0), f(1), ...]` written out.
///
/// A closure (as `array::map` wants) is a function of its own, which has not the instructions of the
/// function around it: kernels must not depend on the optimiser to merge the two.
macro_rules! each {
    ($j:ident in 2 => $value:expr) => {
        each!($j in [0, 1] => $value)
    };
    ($j:ident in 3 => $value:expr) => {
        each!($j in [0, 1, 2] => $value)
    };
    ($j:ident in 4 => $value:expr) => {
        each!($j in [0, 1, 2, 3] => $value)
    };
    ($j:ident in 8 => $value:expr) => {
        each!($j in [0, 1, 2, 3, 4, 5, 6, 7] => $value)
    };
    ($j:ident in [$($index:literal),*] => $value:expr) => {
        [$({
            const $j: usize = $index;
            $value
        }),*]
    };
}
pub(crate) use each;

/// Eight f64 and the operations of the kernels on them.
pub trait Lanes: Copy {
    /// One truth value per lane.
    type Mask: Copy;

    /// Whether there are registers enough for two visits at once.
    const PAIRS_OF_BLOCKS: bool = false;

    fn splat(x: f64) -> Self;
    fn load(row: &[f64; LANES]) -> Self;
    fn load32(row: &[f32; LANES]) -> Self;
    fn store(self, row: &mut [f64; LANES]);
    /// Rounds to f32.
    fn store32(self, row: &mut [f32; LANES]);

    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn div(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    fn abs(self) -> Self;
    /// `self * b + c`, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `self * b - c`, rounded once.
    fn mul_sub(self, b: Self, c: Self) -> Self;
    /// `c - self * b`, rounded once.
    fn neg_mul_add(self, b: Self, c: Self) -> Self;

    /// `self < other`; false where either is not a number.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`; false where either is not a number.
    fn le(self, other: Self) -> Self::Mask;
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// `a` and not `b`.
    fn and_not(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn any(mask: Self::Mask) -> bool;
    /// `yes` where the mask is set, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// Component `j` of the lines `indices`, for every `j`.
    ///
    /// # Safety
    /// Every index is below `lines.len()`.
    unsafe fn gather(lines: &[BodyVelocity], indices: &[u32; LANES]) -> [Self; 8];
    /// Writes what [`Lanes::gather`] read, in the order of the lanes.
    ///
    /// # Safety
    /// Every index is below `lines.len()`.
    unsafe fn scatter(rows: [Self; 8], lines: &mut [BodyVelocity], indices: &[u32; LANES]);
}
