//! A visit: eight independent contacts solved exactly, all others held (T-9).
//!
//! With `ũ_T = u_T - k u_n` (what `u_T` becomes once `u_n` is brought to zero) and the tangential
//! masses `S⁻¹` diagonal, the contact that sticks would have
//!
//! ```text
//! z = r_T - S⁻¹ ũ_T ,   r_n = -β - k·z ,   β = u_n/W_nn - (r_n + k·r_T)
//! ```
//!
//! It opens when `β >= 0`, sticks when `‖z‖ <= μ r_n`, and slips otherwise. Slip means
//! `u_T = -λ r_T` with λ > 0, so `r_T = (1 + λ S⁻¹)⁻¹ z`. Instead of λ, which is unbounded, we solve
//! for `y = 1/(1 + λ/S_ss)` in [0, 1], 1 being stick and 0 no friction:
//!
//! ```text
//! r_s = y z_s ,   r_t = y D z_t ,   D = 1/(ρ + (1-ρ) y) ,   ρ = S_ss/S_tt
//! h(y) = μ r_n - ‖r_T‖ = μ (-β - k·r_T) - y sqrt(D² z_t² + z_s²) = 0
//! ```
//!
//! `h(0) = -μβ > 0 > h(1)`: there is a root, and it stays bracketed. For ρ = 1, `h` is linear, and
//! Newton's method needs one iteration. With strong coupling `k` there may be several roots; each is
//! a solution of the contact law, and which one is found depends on the warm start alone.

use super::block::LawRows;
use super::kernel::Lanes;

/// Newton steps that are relatively smaller than this leave an error below rounding: convergence is
/// quadratic.
const SMALL_STEP: f64 = 1e-9;
/// Bisection alone would be at rounding after this many.
const MAX_STEPS: usize = 64;

/// Law data of eight contacts.
pub struct Law<L> {
    pub normal_mass: L,
    pub coupling: [L; 2],
    pub tangent_mass: L,
    pub tangent_ratio: L,
    pub friction: L,
}

impl<L: Lanes> Law<L> {
    #[inline(always)]
    pub fn load(rows: &LawRows) -> Self {
        Self {
            normal_mass: L::load32(&rows.normal_mass),
            coupling: [L::load32(&rows.coupling[0]), L::load32(&rows.coupling[1])],
            tangent_mass: L::load32(&rows.tangent_mass),
            tangent_ratio: L::load32(&rows.tangent_ratio),
            friction: L::load32(&rows.friction),
        }
    }
}

/// New impulses of eight contacts with relative velocities `u` and impulses `r`; `slip` is where
/// the slip solve starts and is overwritten where a contact slips.
#[inline(always)]
pub fn solve<L: Lanes>(law: &Law<L>, u: &[L; 3], r: &[L; 3], slip: &mut [f32; 8]) -> [L; 3] {
    let zero = L::splat(0.0);
    let [k1, k2] = law.coupling;
    let held = k2.mul_add(r[2], k1.mul_add(r[1], r[0]));
    let beta = u[0].mul_sub(law.normal_mass, held);
    let closed = beta.lt(zero);
    let slide1 = k1.neg_mul_add(u[0], u[1]);
    let slide2 = k2.neg_mul_add(u[0], u[2]);
    let z1 = law.tangent_mass.mul(law.tangent_ratio).neg_mul_add(slide1, r[1]);
    let z2 = law.tangent_mass.neg_mul_add(slide2, r[2]);
    let normal = normal_impulse(law, beta, z1, z2);
    let bound = law.friction.mul(normal);
    let inside = L::and(zero.le(normal), z2.mul_add(z2, z1.mul(z1)).le(bound.mul(bound)));
    let slips = L::and_not(closed, inside);
    let mut tangential = [z1, z2];
    if L::any(slips) {
        tangential = solve_slip(law, beta, [z1, z2], slips, slip);
    }
    let normal = normal_impulse(law, beta, tangential[0], tangential[1]);
    [normal, tangential[0], tangential[1]].map(|x| L::select(closed, x, zero))
}

/// `r_n` that makes `u_n` zero.
#[inline(always)]
fn normal_impulse<L: Lanes>(law: &Law<L>, beta: L, r1: L, r2: L) -> L {
    let [k1, k2] = law.coupling;
    k2.neg_mul_add(r2, k1.neg_mul_add(r1, L::splat(0.0).sub(beta)))
}

/// Tangential impulses: `z` where a contact does not slip.
#[inline(always)]
fn solve_slip<L: Lanes>(
    law: &Law<L>,
    beta: L,
    z: [L; 2],
    slips: L::Mask,
    warm: &mut [f32; 8],
) -> [L; 2] {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let [k1, k2] = law.coupling;
    let (ratio, mu) = (law.tangent_ratio, law.friction);
    let rest = one.sub(ratio);
    let z2_squared = z[1].mul(z[1]);
    let mut low = zero;
    let mut high = L::select(zero.lt(mu), one, zero);
    let start = L::load32(warm);
    let mut y = L::select(high.lt(start), high, start);
    let mut tangential = z;
    let mut active = slips;
    for _ in 0..MAX_STEPS {
        let d = one.div(rest.mul_add(y, ratio));
        let zd = z[0].mul(d);
        let squared = zd.mul(zd);
        let length = squared.add(z2_squared).sqrt();
        let r1 = zd.mul(y);
        let r2 = z[1].mul(y);
        let h = y.neg_mul_add(length, mu.mul(normal_impulse(law, beta, r1, r2)));
        // Derivatives with respect to y; the one of h is multiplied by the length.
        let slope1 = zd.mul(d).mul(ratio);
        let slope2 = z[1];
        let turn = mu.mul(k2.mul_add(slope2, k1.mul(slope1)));
        let fall = turn.mul_add(length, squared.mul_add(ratio.mul(d), z2_squared));
        let newton = h.mul(length).div(fall).add(y);
        let above = zero.lt(h);
        low = L::select(above, y, low);
        high = L::select(above, high, y);
        let bracketed = L::and(low.le(newton), newton.le(high));
        let next = L::select(bracketed, newton, L::splat(0.5).mul(low.add(high)));
        let change = next.sub(y);
        y = L::select(active, next, y);
        // To first order in the last step, which is too small for the second to count.
        tangential[0] = L::select(active, slope1.mul_add(change, r1), tangential[0]);
        tangential[1] = L::select(active, slope2.mul(next), tangential[1]);
        active = L::and_not(active, change.abs().le(L::splat(SMALL_STEP).mul(next)));
        if !L::any(active) {
            break;
        }
    }
    L::select(slips, y, start).store32(warm);
    tangential
}

/// `W_αα x` where `mask` is set, else zero.
#[inline(always)]
pub fn delassus_times<L: Lanes>(law: &Law<L>, x: &[L; 3], mask: L::Mask) -> [L; 3] {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let [k1, k2] = law.coupling;
    // Padding has no masses to divide by.
    let inverse = |mass: L| one.div(L::select(mask, mass, one));
    let normal = inverse(law.normal_mass).mul(k2.mul_add(x[2], k1.mul_add(x[1], x[0])));
    let s2 = inverse(law.tangent_mass);
    let s1 = s2.div(law.tangent_ratio);
    let w = [normal, k1.mul_add(normal, s1.mul(x[1])), k2.mul_add(normal, s2.mul(x[2]))];
    w.map(|w| L::select(mask, w, zero))
}

/// `r - P_K(r - ρ (u + μ ‖u_T‖ n))` with `ρ = 3 / tr W_αα` (T-10); zero for padding.
#[inline(always)]
pub fn natural_map<L: Lanes>(law: &Law<L>, u: &[L; 3], r: &[L; 3]) -> [L; 3] {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let [k1, k2] = law.coupling;
    let contact = zero.lt(law.normal_mass);
    let inverse = |mass: L| one.div(L::select(contact, mass, one));
    let (w_nn, s2) = (inverse(law.normal_mass), inverse(law.tangent_mass));
    let coupled = k2.mul_add(k2, k1.mul_add(k1, one));
    let trace = coupled.mul_add(w_nn, s2.add(s2.div(law.tangent_ratio)));
    let rho = L::splat(3.0).div(trace);
    let sliding = u[2].mul_add(u[2], u[1].mul(u[1])).sqrt();
    let x = [
        rho.neg_mul_add(law.friction.mul_add(sliding, u[0]), r[0]),
        rho.neg_mul_add(u[1], r[1]),
        rho.neg_mul_add(u[2], r[2]),
    ];
    let projected = project(law.friction, &x);
    [0, 1, 2].map(|k| L::select(contact, r[k].sub(projected[k]), zero))
}

/// Projection on Coulomb's cone: [`crate::math::cone::project`] on eight lanes.
#[inline(always)]
fn project<L: Lanes>(mu: L, x: &[L; 3]) -> [L; 3] {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let tangential = x[2].mul_add(x[2], x[1].mul(x[1])).sqrt();
    let inside = tangential.le(mu.mul(x[0]));
    let polar = mu.mul(tangential).le(zero.sub(x[0]));
    let normal = mu.mul_add(tangential, x[0]).div(mu.mul_add(mu, one));
    let divisor = L::select(zero.lt(tangential), tangential, one);
    let scale = mu.mul(normal).div(divisor);
    let on_cone = [normal, scale.mul(x[1]), scale.mul(x[2])];
    [0, 1, 2].map(|k| L::select(inside, x[k], L::select(polar, zero, on_cone[k])))
}
