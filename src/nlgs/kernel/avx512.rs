//! Eight lanes in one register of AVX-512F.

use super::lanes::{Lanes, each};
use crate::contact_graph::LANES;
use crate::local_problem::Line;
use core::arch::x86_64::*;

/// One 512-bit register.
///
/// Values exist only inside [`super::run`] after the processor was asked for AVX-512F: this is what
/// makes the calls below sound.
#[derive(Clone, Copy)]
pub struct Avx512(__m512d);

impl Lanes for Avx512 {
    type Mask = __mmask8;

    #[inline(always)]
    fn splat(x: f64) -> Self {
        unsafe { Self(_mm512_set1_pd(x)) }
    }
    #[inline(always)]
    fn load(row: &[f64; LANES]) -> Self {
        unsafe { Self(_mm512_loadu_pd(row.as_ptr())) }
    }
    #[inline(always)]
    fn load32(row: &[f32; LANES]) -> Self {
        unsafe { Self(_mm512_cvtps_pd(_mm256_loadu_ps(row.as_ptr()))) }
    }
    #[inline(always)]
    fn store(self, row: &mut [f64; LANES]) {
        unsafe { _mm512_storeu_pd(row.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn store32(self, row: &mut [f32; LANES]) {
        unsafe { _mm256_storeu_ps(row.as_mut_ptr(), _mm512_cvtpd_ps(self.0)) }
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        unsafe { Self(_mm512_add_pd(self.0, other.0)) }
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        unsafe { Self(_mm512_sub_pd(self.0, other.0)) }
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        unsafe { Self(_mm512_mul_pd(self.0, other.0)) }
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        unsafe { Self(_mm512_div_pd(self.0, other.0)) }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        unsafe { Self(_mm512_sqrt_pd(self.0)) }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        unsafe { Self(_mm512_abs_pd(self.0)) }
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        unsafe { Self(_mm512_fmadd_pd(self.0, b.0, c.0)) }
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        unsafe { Self(_mm512_fmsub_pd(self.0, b.0, c.0)) }
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        unsafe { Self(_mm512_fnmadd_pd(self.0, b.0, c.0)) }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        unsafe { _mm512_cmp_pd_mask::<_CMP_LT_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    fn le(self, other: Self) -> Self::Mask {
        unsafe { _mm512_cmp_pd_mask::<_CMP_LE_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a & b
    }
    #[inline(always)]
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a | b
    }
    #[inline(always)]
    fn and_not(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        a & !b
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        mask != 0
    }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        unsafe { Self(_mm512_mask_blend_pd(mask, no.0, yes.0)) }
    }
    #[inline(always)]
    unsafe fn gather(lines: &[Line], indices: &[u32; LANES]) -> [Self; 8] {
        // SAFETY: the caller's; a line is 64 aligned bytes.
        unsafe {
            let start = lines.as_ptr();
            let read = each!(I in 8 => _mm512_load_pd(start.add(indices[I] as usize).cast()));
            let rows = transpose(&read);
            each!(J in 8 => Self(rows[J]))
        }
    }
    #[inline(always)]
    unsafe fn scatter(rows: [Self; 8], lines: &mut [Line], indices: &[u32; LANES]) {
        // SAFETY: the caller's; a line is 64 aligned bytes.
        unsafe {
            let columns = transpose(&each!(J in 8 => rows[J].0));
            let start = lines.as_mut_ptr();
            each!(I in 8 => _mm512_store_pd(start.add(indices[I] as usize).cast(), columns[I]));
        }
    }
    #[inline(always)]
    fn prefetch<T>(value: *const T) {
        // SAFETY: a prefetch reads nothing.
        unsafe {
            for offset in (0..size_of::<T>()).step_by(64) {
                _mm_prefetch::<_MM_HINT_T0>(value.cast::<i8>().wrapping_add(offset));
            }
        }
    }
}

/// Transposes 8 x 8 in three rounds: pairs, quarters, halves.
#[inline(always)]
unsafe fn transpose(r: &[__m512d; 8]) -> [__m512d; 8] {
    // SAFETY: the caller has AVX-512F.
    unsafe {
        let p = [
            _mm512_unpacklo_pd(r[0], r[1]),
            _mm512_unpackhi_pd(r[0], r[1]),
            _mm512_unpacklo_pd(r[2], r[3]),
            _mm512_unpackhi_pd(r[2], r[3]),
            _mm512_unpacklo_pd(r[4], r[5]),
            _mm512_unpackhi_pd(r[4], r[5]),
            _mm512_unpacklo_pd(r[6], r[7]),
            _mm512_unpackhi_pd(r[6], r[7]),
        ];
        // 0x88: quarters 0 and 2 of each operand, 0xdd: quarters 1 and 3.
        macro_rules! even {
            ($a:expr, $b:expr) => {
                _mm512_shuffle_f64x2::<0x88>($a, $b)
            };
        }
        macro_rules! odd {
            ($a:expr, $b:expr) => {
                _mm512_shuffle_f64x2::<0xdd>($a, $b)
            };
        }
        let q = [
            even!(p[0], p[2]),
            even!(p[1], p[3]),
            odd!(p[0], p[2]),
            odd!(p[1], p[3]),
            even!(p[4], p[6]),
            even!(p[5], p[7]),
            odd!(p[4], p[6]),
            odd!(p[5], p[7]),
        ];
        [
            even!(q[0], q[4]),
            even!(q[1], q[5]),
            even!(q[2], q[6]),
            even!(q[3], q[7]),
            odd!(q[0], q[4]),
            odd!(q[1], q[5]),
            odd!(q[2], q[6]),
            odd!(q[3], q[7]),
        ]
    }
}
