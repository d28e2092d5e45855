//! Eight lanes in two registers of AVX2 with FMA.

use super::body_velocity::BodyVelocity;
use super::operations::{LANES, Lanes, each};
use core::arch::x86_64::*;

/// Lanes 0 to 3 and 4 to 7.
///
/// Values exist only inside [`super::run`] after detection of AVX2 and FMA, which makes the calls below sound.
#[derive(Clone, Copy)]
pub struct Avx2(__m256d, __m256d);

/// Mask of lanes: all bits of a lane are set or none.
#[derive(Clone, Copy)]
pub struct Mask(__m256d, __m256d);

impl Lanes for Avx2 {
    type Mask = Mask;

    #[inline(always)]
    fn splat(x: f64) -> Self {
        unsafe { Self(_mm256_set1_pd(x), _mm256_set1_pd(x)) }
    }
    #[inline(always)]
    fn load(row: &[f64; LANES]) -> Self {
        unsafe { Self(_mm256_loadu_pd(row.as_ptr()), _mm256_loadu_pd(row[4..].as_ptr())) }
    }
    #[inline(always)]
    fn load32(row: &[f32; LANES]) -> Self {
        unsafe {
            Self(
                _mm256_cvtps_pd(_mm_loadu_ps(row.as_ptr())),
                _mm256_cvtps_pd(_mm_loadu_ps(row[4..].as_ptr())),
            )
        }
    }
    #[inline(always)]
    fn store(self, row: &mut [f64; LANES]) {
        unsafe {
            _mm256_storeu_pd(row.as_mut_ptr(), self.0);
            _mm256_storeu_pd(row[4..].as_mut_ptr(), self.1);
        }
    }
    #[inline(always)]
    fn store32(self, row: &mut [f32; LANES]) {
        unsafe {
            _mm_storeu_ps(row.as_mut_ptr(), _mm256_cvtpd_ps(self.0));
            _mm_storeu_ps(row[4..].as_mut_ptr(), _mm256_cvtpd_ps(self.1));
        }
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        unsafe { Self(_mm256_add_pd(self.0, other.0), _mm256_add_pd(self.1, other.1)) }
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        unsafe { Self(_mm256_sub_pd(self.0, other.0), _mm256_sub_pd(self.1, other.1)) }
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        unsafe { Self(_mm256_mul_pd(self.0, other.0), _mm256_mul_pd(self.1, other.1)) }
    }
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        unsafe { Self(_mm256_div_pd(self.0, other.0), _mm256_div_pd(self.1, other.1)) }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        unsafe { Self(_mm256_sqrt_pd(self.0), _mm256_sqrt_pd(self.1)) }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        unsafe {
            let sign = _mm256_set1_pd(-0.0);
            Self(_mm256_andnot_pd(sign, self.0), _mm256_andnot_pd(sign, self.1))
        }
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        unsafe { Self(_mm256_fmadd_pd(self.0, b.0, c.0), _mm256_fmadd_pd(self.1, b.1, c.1)) }
    }
    #[inline(always)]
    fn mul_sub(self, b: Self, c: Self) -> Self {
        unsafe { Self(_mm256_fmsub_pd(self.0, b.0, c.0), _mm256_fmsub_pd(self.1, b.1, c.1)) }
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        unsafe { Self(_mm256_fnmadd_pd(self.0, b.0, c.0), _mm256_fnmadd_pd(self.1, b.1, c.1)) }
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Mask {
        unsafe {
            Mask(
                _mm256_cmp_pd::<_CMP_LT_OQ>(self.0, other.0),
                _mm256_cmp_pd::<_CMP_LT_OQ>(self.1, other.1),
            )
        }
    }
    #[inline(always)]
    fn le(self, other: Self) -> Mask {
        unsafe {
            Mask(
                _mm256_cmp_pd::<_CMP_LE_OQ>(self.0, other.0),
                _mm256_cmp_pd::<_CMP_LE_OQ>(self.1, other.1),
            )
        }
    }
    #[inline(always)]
    fn and(a: Mask, b: Mask) -> Mask {
        unsafe { Mask(_mm256_and_pd(a.0, b.0), _mm256_and_pd(a.1, b.1)) }
    }
    #[inline(always)]
    fn or(a: Mask, b: Mask) -> Mask {
        unsafe { Mask(_mm256_or_pd(a.0, b.0), _mm256_or_pd(a.1, b.1)) }
    }
    #[inline(always)]
    fn and_not(a: Mask, b: Mask) -> Mask {
        unsafe { Mask(_mm256_andnot_pd(b.0, a.0), _mm256_andnot_pd(b.1, a.1)) }
    }
    #[inline(always)]
    fn any(mask: Mask) -> bool {
        unsafe { _mm256_movemask_pd(_mm256_or_pd(mask.0, mask.1)) != 0 }
    }
    #[inline(always)]
    fn select(mask: Mask, yes: Self, no: Self) -> Self {
        unsafe {
            Self(_mm256_blendv_pd(no.0, yes.0, mask.0), _mm256_blendv_pd(no.1, yes.1, mask.1))
        }
    }
    #[inline(always)]
    unsafe fn gather(lines: &[BodyVelocity], indices: &[u32; LANES]) -> [Self; 8] {
        // SAFETY: by the caller's contract; a body velocity is 64 aligned bytes.
        unsafe {
            let start = lines.as_ptr();
            let line = each!(I in 8 => start.add(indices[I] as usize).cast::<f64>());
            let a = transpose(&each!(I in 4 => _mm256_load_pd(line[I])));
            let b = transpose(&each!(I in 4 => _mm256_load_pd(line[4 + I])));
            let c = transpose(&each!(I in 4 => _mm256_load_pd(line[I].add(4))));
            let d = transpose(&each!(I in 4 => _mm256_load_pd(line[4 + I].add(4))));
            let low = each!(J in 4 => Self(a[J], b[J]));
            let high = each!(J in 4 => Self(c[J], d[J]));
            [low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]]
        }
    }
    #[inline(always)]
    unsafe fn scatter(rows: [Self; 8], lines: &mut [BodyVelocity], indices: &[u32; LANES]) {
        // SAFETY: by the caller's contract; a body velocity is 64 aligned bytes.
        unsafe {
            let start = lines.as_mut_ptr();
            let line = each!(I in 8 => start.add(indices[I] as usize).cast::<f64>());
            let a = transpose(&each!(J in 4 => rows[J].0));
            let b = transpose(&each!(J in 4 => rows[J].1));
            let c = transpose(&each!(J in 4 => rows[4 + J].0));
            let d = transpose(&each!(J in 4 => rows[4 + J].1));
            // Stored in the order of the lanes, so that padding lanes, which share a body, are well defined.
            each!(I in 4 => _mm256_store_pd(line[I], a[I]));
            each!(I in 4 => _mm256_store_pd(line[I].add(4), c[I]));
            each!(I in 4 => _mm256_store_pd(line[4 + I], b[I]));
            each!(I in 4 => _mm256_store_pd(line[4 + I].add(4), d[I]));
        }
    }
}

/// Transposes 4 x 4.
#[inline(always)]
unsafe fn transpose(r: &[__m256d; 4]) -> [__m256d; 4] {
    // SAFETY: the caller has AVX.
    unsafe {
        let p = [
            _mm256_unpacklo_pd(r[0], r[1]),
            _mm256_unpackhi_pd(r[0], r[1]),
            _mm256_unpacklo_pd(r[2], r[3]),
            _mm256_unpackhi_pd(r[2], r[3]),
        ];
        [
            _mm256_permute2f128_pd::<0x20>(p[0], p[2]),
            _mm256_permute2f128_pd::<0x20>(p[1], p[3]),
            _mm256_permute2f128_pd::<0x31>(p[0], p[2]),
            _mm256_permute2f128_pd::<0x31>(p[1], p[3]),
        ]
    }
}
