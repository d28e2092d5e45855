//! Operations on eight f64 at a time, with one arithmetic on every processor.
//!
//! Every operation is an IEEE operation rounded once (fused where stated), so all implementations give the same bits.

use super::body_velocity::BodyVelocity;

/// Number of lanes: numbers that one operation processes.
pub const LANES: usize = 8;

/// Array `[f(0), f(1), ...]` without a closure.
///
/// A closure (as in `array::map`) is a separate function without the target features of its caller: kernels must not
/// depend on the optimiser to inline it.
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
    /// Mask with one truth value per lane.
    type Mask: Copy;

    /// True if there are enough registers to process two blocks at a time.
    const PAIRS_OF_BLOCKS: bool = false;

    /// Returns `x` in all lanes.
    fn splat(x: f64) -> Self;
    /// Loads eight f64.
    fn load(row: &[f64; LANES]) -> Self;
    /// Loads eight f32.
    fn load32(row: &[f32; LANES]) -> Self;
    /// Stores eight f64.
    fn store(self, row: &mut [f64; LANES]);
    /// Stores eight f32, rounded to nearest.
    fn store32(self, row: &mut [f32; LANES]);

    /// Returns `self + other`.
    fn add(self, other: Self) -> Self;
    /// Returns `self - other`.
    fn sub(self, other: Self) -> Self;
    /// Returns `self * other`.
    fn mul(self, other: Self) -> Self;
    /// Returns `self / other`.
    fn div(self, other: Self) -> Self;
    /// Returns the square root.
    fn sqrt(self) -> Self;
    /// Returns the absolute value.
    fn abs(self) -> Self;
    /// Returns `self * b + c`, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// Returns `self * b - c`, rounded once.
    fn mul_sub(self, b: Self, c: Self) -> Self;
    /// Returns `c - self * b`, rounded once.
    fn neg_mul_add(self, b: Self, c: Self) -> Self;

    /// Returns `self < other`; false for NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// Returns `self <= other`; false for NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// Returns `a` and `b`.
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Returns `a` or `b`.
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Returns `a` and not `b`.
    fn and_not(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Returns true if any lane is set.
    fn any(mask: Self::Mask) -> bool;
    /// Returns `yes` where the mask is set, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// Returns component `j` of the body velocities `indices`, for every `j`.
    ///
    /// # Safety
    /// Every index is below `lines.len()`.
    unsafe fn gather(lines: &[BodyVelocity], indices: &[u32; LANES]) -> [Self; 8];
    /// Stores the components that [`Lanes::gather`] returns, in the order of the lanes.
    ///
    /// # Safety
    /// Every index is below `lines.len()`.
    unsafe fn scatter(rows: [Self; 8], lines: &mut [BodyVelocity], indices: &[u32; LANES]);
}
