//! Computation of frames, arms and Delassus blocks, eight contacts at a time (T-5 to T-9).
//!
//! Contract: each contact depends on its bodies alone, not on the other lanes, and every [`Lanes`] gives the same bits.

use super::contact::{ContactSide, LocalContact};
use super::rows::{Row32, Row64};
use crate::lanes::{Lanes, each};
use crate::math::{Vec3, frame, round, widen};

/// Data of one body of each of eight contacts.
#[derive(Default)]
struct BodyRows {
    lever: [Row64; 3],
    inverse_mass: Row64,
    /// Whitening matrices by columns.
    whitening: [Row64; 9],
    /// One where there is a shift, else zero.
    shifted: Row64,
    shift: [Row64; 9],
}

/// Normals and bodies of up to eight contacts. Lanes that are not set keep the data of earlier contacts.
#[derive(Default)]
pub struct ContactGeometryRows {
    /// Rounded normals.
    normal: [Row64; 3],
    /// Two tangents in any direction.
    tangents: [[Row64; 3]; 2],
    candidate: BodyRows,
    antagonist: BodyRows,
    /// One where the antagonist is mobile, else zero.
    paired: Row64,
    /// Rounded compliances (normal, tangential), 1/kg.
    compliance: [Row64; 2],
}

/// Rows of the fields of [`LocalContact`] by the same names.
#[derive(Default)]
pub struct ContactRows {
    normal: [Row32; 3],
    tangent: [Row32; 3],
    candidate_arms: [[Row32; 3]; 3],
    antagonist_arms: [[Row32; 3]; 3],
    normal_mass: Row32,
    coupling: [Row32; 2],
    tangent_mass: Row32,
    tangent_ratio: Row32,
}

impl BodyRows {
    #[inline(always)]
    fn set(&mut self, lane: usize, side: &ContactSide) {
        put(&mut self.lever, lane, side.lever.as_slice());
        self.inverse_mass[lane] = side.inverse_mass;
        put(&mut self.whitening, lane, side.whitening.as_slice());
        self.shifted[lane] = 0.0;
        if let Some(shift) = &side.shift {
            self.shifted[lane] = 1.0;
            put(&mut self.shift, lane, shift.as_slice());
        }
    }
}

impl ContactGeometryRows {
    /// Sets a lane to a contact; the antagonist is `None` if it is driven.
    #[inline(always)]
    pub fn set(
        &mut self,
        lane: usize,
        normal: &Vec3,
        candidate: &ContactSide,
        antagonist: Option<&ContactSide>,
        compliance: &[f32; 2],
    ) {
        put(&mut self.compliance, lane, &compliance.map(f64::from));
        let normal = widen(&round(normal));
        let (t, s) = frame::tangents(&normal);
        put(&mut self.normal, lane, normal.as_slice());
        put(&mut self.tangents[0], lane, t.as_slice());
        put(&mut self.tangents[1], lane, s.as_slice());
        self.candidate.set(lane, candidate);
        self.paired[lane] = 0.0;
        if let Some(antagonist) = antagonist {
            self.paired[lane] = 1.0;
            self.antagonist.set(lane, antagonist);
        }
    }

    /// Rotates the tangents, rounds, and computes all that follows from the rounded geometry.
    #[inline(always)]
    pub fn build<L: Lanes>(&self, out: &mut ContactRows) {
        let zero = L::splat(0.0);
        let paired = zero.lt(L::load(&self.paired));
        let (candidate, antagonist) =
            (BodyLanes::<L>::load(&self.candidate), BodyLanes::load(&self.antagonist));
        let normal = load3::<L>(&self.normal);
        let inverse_mass =
            candidate.inverse_mass.add(L::select(paired, antagonist.inverse_mass, zero));
        // First with unrounded tangents, to find the rotation; then with the rotated, rounded ones.
        let [t, s] = [load3::<L>(&self.tangents[0]), load3::<L>(&self.tangents[1])];
        let axes = [normal, t, s];
        let of_candidate = candidate.delassus(&axes);
        let of_antagonist = antagonist.delassus(&axes);
        let [of_normal, of_tangent] = each!(K in 2 => L::load(&self.compliance[K]));
        // Of the entries nn, tn, sn, tt, ts, ss.
        let compliance = [of_normal, zero, zero, of_tangent, zero, of_tangent];
        let w = each!(K in [0, 1, 2, 3, 4, 5] => {
            let of_bodies = of_candidate[K].add(L::select(paired, of_antagonist[K], zero));
            of_bodies.add(compliance[K])
        });
        let (cos, sin) = principal_rotation(&tangential_schur(&w));
        each!(J in 3 => normal[J].store32(&mut out.normal[J]));
        each!(J in 3 => t[J].mul(cos).add(s[J].mul(sin)).store32(&mut out.tangent[J]));
        let tangent = load32::<L>(&out.tangent);
        // Products of two f32 are exact in f64, so each component is rounded once: the kernels' fused
        // operations give the same bits.
        let axes = [normal, tangent, cross(&normal, &tangent)];
        let arms = each!(K in 3 => {
            let of_candidate = candidate.arm(&axes[K]);
            let of_antagonist = antagonist.arm(&axes[K]);
            each!(J in 3 => of_candidate[J].store32(&mut out.candidate_arms[K][J]));
            each!(J in 3 => L::select(paired, of_antagonist[J], zero).store32(&mut out.antagonist_arms[K][J]));
            [load32::<L>(&out.candidate_arms[K]), load32::<L>(&out.antagonist_arms[K])]
        });
        let w = each_entry!((I, J) => {
            let own = inverse_mass.mul(dot(&axes[I], &axes[J])).add(dot(&arms[I][0], &arms[J][0]));
            own.add(dot(&arms[I][1], &arms[J][1]))
        });
        let w = each!(K in [0, 1, 2, 3, 4, 5] => w[K].add(compliance[K]));
        let [nn, tn, sn, ..] = w;
        let [tt, _, ss] = tangential_schur(&w);
        let one = L::splat(1.0);
        one.div(nn).store32(&mut out.normal_mass);
        tn.div(nn).store32(&mut out.coupling[0]);
        sn.div(nn).store32(&mut out.coupling[1]);
        one.div(ss).store32(&mut out.tangent_mass);
        // Equal up to rounding when S is isotropic: keep the ratio in its interval.
        let ratio = ss.div(tt);
        L::select(ratio.le(one), ratio, one).store32(&mut out.tangent_ratio);
    }
}

impl ContactRows {
    /// Writes the contact of a lane, without bodies, friction, compliance, offset and impulse.
    pub fn get(&self, lane: usize, contact: &mut LocalContact) {
        let three = |rows: &[Row32; 3]| [rows[0][lane], rows[1][lane], rows[2][lane]];
        contact.normal = three(&self.normal);
        contact.tangent = three(&self.tangent);
        contact.candidate_arms = each!(K in 3 => three(&self.candidate_arms[K]));
        contact.antagonist_arms = each!(K in 3 => three(&self.antagonist_arms[K]));
        contact.normal_mass = self.normal_mass[lane];
        contact.coupling = [self.coupling[0][lane], self.coupling[1][lane]];
        contact.tangent_mass = self.tangent_mass[lane];
        contact.tangent_ratio = self.tangent_ratio[lane];
    }
}

/// Expands to the entries of a symmetric matrix of the axes n, t, s: nn, tn, sn, tt, ts, ss.
macro_rules! each_entry {
    (($i:ident, $j:ident) => $value:expr) => {
        [
            each_entry!($i = 0, $j = 0 => $value),
            each_entry!($i = 1, $j = 0 => $value),
            each_entry!($i = 2, $j = 0 => $value),
            each_entry!($i = 1, $j = 1 => $value),
            each_entry!($i = 1, $j = 2 => $value),
            each_entry!($i = 2, $j = 2 => $value),
        ]
    };
    ($i:ident = $a:literal, $j:ident = $b:literal => $value:expr) => {{
        const $i: usize = $a;
        const $j: usize = $b;
        $value
    }};
}
use each_entry;

/// Lanes of eight bodies.
struct BodyLanes<L> {
    lever: [L; 3],
    inverse_mass: L,
    whitening: [L; 9],
    shift: Option<(L, [L; 9])>,
}

impl<L: Lanes> BodyLanes<L> {
    #[inline(always)]
    fn load(sides: &BodyRows) -> Self {
        let shift = if sides.shifted.iter().any(|&x| x != 0.0) {
            Some((L::load(&sides.shifted), load9(&sides.shift)))
        } else {
            None
        };
        Self {
            lever: load3(&sides.lever),
            inverse_mass: L::load(&sides.inverse_mass),
            whitening: load9(&sides.whitening),
            shift,
        }
    }

    /// Returns the arm `Bᵀ (ℓ × axis)`, including the shift.
    #[inline(always)]
    fn arm(&self, axis: &[L; 3]) -> [L; 3] {
        let turning = transposed_times(&self.whitening, &cross(&self.lever, axis));
        match &self.shift {
            None => turning,
            Some((shifted, shift)) => {
                let shifted = L::splat(0.0).lt(*shifted);
                let more = transposed_times(shift, axis);
                each!(J in 3 => L::select(shifted, turning[J].add(more[J]), turning[J]))
            }
        }
    }

    /// Contribution of the body to the Delassus block.
    #[inline(always)]
    fn delassus(&self, axes: &[[L; 3]; 3]) -> [L; 6] {
        let arms = each!(K in 3 => self.arm(&axes[K]));
        each_entry!((I, J) => {
            self.inverse_mass.mul(dot(&axes[I], &axes[J])).add(dot(&arms[I], &arms[J]))
        })
    }
}

#[inline(always)]
fn load3<L: Lanes>(rows: &[Row64; 3]) -> [L; 3] {
    each!(J in 3 => L::load(&rows[J]))
}

#[inline(always)]
fn load9<L: Lanes>(rows: &[Row64; 9]) -> [L; 9] {
    each!(K in [0, 1, 2, 3, 4, 5, 6, 7, 8] => L::load(&rows[K]))
}

#[inline(always)]
fn load32<L: Lanes>(rows: &[Row32; 3]) -> [L; 3] {
    each!(J in 3 => L::load32(&rows[J]))
}

#[inline(always)]
fn dot<L: Lanes>(a: &[L; 3], b: &[L; 3]) -> L {
    a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
}

#[inline(always)]
fn cross<L: Lanes>(a: &[L; 3], b: &[L; 3]) -> [L; 3] {
    [
        a[1].mul(b[2]).sub(a[2].mul(b[1])),
        a[2].mul(b[0]).sub(a[0].mul(b[2])),
        a[0].mul(b[1]).sub(a[1].mul(b[0])),
    ]
}

/// Returns `Mᵀ x` for M given by columns.
#[inline(always)]
fn transposed_times<L: Lanes>(m: &[L; 9], x: &[L; 3]) -> [L; 3] {
    each!(J in 3 => dot(&[m[3 * J], m[3 * J + 1], m[3 * J + 2]], x))
}

/// Returns `S = W_TT - W_Tn W_nT / W_nn` as (tt, ts, ss).
#[inline(always)]
fn tangential_schur<L: Lanes>(&[nn, tn, sn, tt, ts, ss]: &[L; 6]) -> [L; 3] {
    [tt.sub(tn.mul(tn).div(nn)), ts.sub(tn.mul(sn).div(nn)), ss.sub(sn.mul(sn).div(nn))]
}

/// Cosine and sine of the rotation that makes `[tt, ts, ss]` diagonal, larger entry first.
///
/// Half-angle formulas: square roots and divisions give the same bits on every machine, library trigonometry does not.
#[inline(always)]
fn principal_rotation<L: Lanes>(&[tt, ts, ss]: &[L; 3]) -> (L, L) {
    let (zero, half, one) = (L::splat(0.0), L::splat(0.5), L::splat(1.0));
    let (x, y) = (half.mul(tt.sub(ss)), ts);
    let length = x.mul(x).add(y.mul(y)).sqrt();
    let large = half.mul(one.add(x.abs().div(length))).sqrt();
    let small = half.mul(y).div(length.mul(large));
    let (forward, turned) = (zero.le(x), zero.lt(length));
    let cos = L::select(turned, L::select(forward, large, small), one);
    let sin = L::select(turned, L::select(forward, small, large), zero);
    (cos, sin)
}

#[inline(always)]
fn put<const N: usize>(rows: &mut [Row64; N], lane: usize, values: &[f64]) {
    for (row, value) in rows.iter_mut().zip(values) {
        row[lane] = *value;
    }
}

/// Builds one contact.
#[cfg(test)]
pub fn build_one(
    normal: &Vec3,
    candidate: &ContactSide,
    antagonist: Option<&ContactSide>,
) -> LocalContact {
    let mut geometry = ContactGeometryRows::default();
    geometry.set(3, normal, candidate, antagonist, &[0.0; 2]);
    let (mut built, mut contact) = (ContactRows::default(), LocalContact::default());
    geometry.build::<crate::lanes::Portable>(&mut built);
    built.get(3, &mut contact);
    contact
}
