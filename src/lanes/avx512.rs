//! Eight lanes in one register of AVX-512F.

use super::body_velocity::BodyVelocity;
use super::operations::{LANES, Lanes, each};
use core::arch::x86_64::*;

/// One 512-bit register.
///
/// Values exist only inside [`super::run`] after detection of AVX-512F, which makes the calls below sound.
#[derive(Clone, Copy)]
pub struct Avx512(__m512d);

impl Lanes for Avx512 {
    type Mask = __mmask8;

    const PAIRS_OF_BLOCKS: bool = true;

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
    unsafe fn gather(lines: &[BodyVelocity], indices: &[u32; LANES]) -> [Self; 8] {
        // SAFETY: by the caller's contract; a body velocity is 64 aligned bytes.
        unsafe {
            let start = lines.as_ptr().cast::<f64>();
            let [first, last] = each!(H in 2 => transpose(&each!(I in 4 => {
                let place = |lane: usize| 8 * indices[lane] as usize + 4 * H;
                two_halves(start.add(place(LOW[I])), start.add(place(LOW[I] + 2)))
            })));
            each!(J in 8 => Self(if J < 4 { first[J % 4] } else { last[J % 4] }))
        }
    }
    #[inline(always)]
    unsafe fn scatter(rows: [Self; 8], lines: &mut [BodyVelocity], indices: &[u32; LANES]) {
        // SAFETY: by the caller's contract; a body velocity is 64 aligned bytes.
        unsafe {
            let start = lines.as_mut_ptr().cast::<f64>();
            each!(H in 2 => {
                let halves = transpose_back(&each!(J in 4 => rows[4 * H + J].0));
                each!(I in 4 => {
                    let place = |lane: usize| 8 * indices[lane] as usize + 4 * H;
                    _mm256_store_pd(start.add(place(LOW[I])), _mm512_castpd512_pd256(halves[I]));
                    let high = _mm512_extractf64x4_pd::<1>(halves[I]);
                    _mm256_store_pd(start.add(place(LOW[I] + 2)), high);
                });
            });
        }
    }
}

/// Lanes whose half lines are the lower halves of the four registers that [`transpose`] takes.
///
/// The upper halves belong to the lanes two further.
const LOW: [usize; 4] = [0, 1, 4, 5];

/// Loads eight numbers from two addresses.
///
/// The insertion reads memory and costs no shuffle; on Intel's processors a single unit executes shuffles.
#[inline(always)]
unsafe fn two_halves(low: *const f64, high: *const f64) -> __m512d {
    // SAFETY: the caller has AVX-512F, and both are 32 aligned bytes.
    unsafe {
        let low = _mm512_castpd256_pd512(_mm256_load_pd(low));
        _mm512_insertf64x4::<1>(low, _mm256_load_pd(high))
    }
}

/// Transposes halves of the lines 0 and 2, 1 and 3, 4 and 6, 5 and 7 to four rows of eight lanes.
#[inline(always)]
unsafe fn transpose(r: &[__m512d; 4]) -> [__m512d; 4] {
    // SAFETY: the caller has AVX-512F.
    unsafe {
        let p = [
            _mm512_unpacklo_pd(r[0], r[1]),
            _mm512_unpackhi_pd(r[0], r[1]),
            _mm512_unpacklo_pd(r[2], r[3]),
            _mm512_unpackhi_pd(r[2], r[3]),
        ];
        // 0x88: quarters 0 and 2 of each operand, 0xdd: quarters 1 and 3.
        [
            _mm512_shuffle_f64x2::<0x88>(p[0], p[2]),
            _mm512_shuffle_f64x2::<0x88>(p[1], p[3]),
            _mm512_shuffle_f64x2::<0xdd>(p[0], p[2]),
            _mm512_shuffle_f64x2::<0xdd>(p[1], p[3]),
        ]
    }
}

/// Inverts [`transpose`].
#[inline(always)]
unsafe fn transpose_back(r: &[__m512d; 4]) -> [__m512d; 4] {
    // SAFETY: the caller has AVX-512F.
    unsafe {
        // Numbers 0 to 7 are those of the first operand.
        let low = _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11);
        let high = _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15);
        let p = [
            _mm512_permutex2var_pd(r[0], low, r[2]),
            _mm512_permutex2var_pd(r[1], low, r[3]),
            _mm512_permutex2var_pd(r[0], high, r[2]),
            _mm512_permutex2var_pd(r[1], high, r[3]),
        ];
        [
            _mm512_unpacklo_pd(p[0], p[1]),
            _mm512_unpackhi_pd(p[0], p[1]),
            _mm512_unpacklo_pd(p[2], p[3]),
            _mm512_unpackhi_pd(p[2], p[3]),
        ]
    }
}
