//! Local solve: a visit of eight independent contacts, solved exactly with all others fixed (T-17 to T-19).
//!
//! With `ũ_T = u_T - k u_n` (the value of `u_T` at `u_n = 0`) and diagonal tangential
//! masses `S⁻¹`, a sticking contact has
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
//! `h(0) = -μβ > 0 > h(1)`: there is a root, and it stays bracketed while Halley's method runs on a
//! polynomial form of `h`. With strong coupling `k` there may be several roots; each is a solution of
//! the contact law, and the initial guess from the previous solve of the contact selects one.

use super::block::LawRows;
use crate::lanes::{Lanes, each};

/// Relative Halley step that leaves an error below rounding, as convergence is cubic.
const SMALL_STEP: f64 = 1e-6;
/// Maximum number of steps, after which bisection alone reaches rounding.
const MAX_STEPS: usize = 64;

/// Contact laws of eight contacts.
pub struct LawLanes<L> {
    /// Normal mass `1/W_nn`, kg.
    pub normal_mass: L,
    /// Coupling `W_Tn / W_nn`.
    pub coupling: [L; 2],
    /// Tangential mass `1/S_ss`, kg.
    pub tangent_mass: L,
    /// Ratio `S_ss / S_tt`.
    pub tangent_ratio: L,
    /// Friction coefficient μ.
    pub friction: L,
}

impl<L: Lanes> LawLanes<L> {
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

/// Returns `β` of eight contacts with relative velocities `u` and impulses `r`, and the mask of those that close.
#[inline(always)]
pub fn approach<L: Lanes>(law: &LawLanes<L>, u: &[L; 3], r: &[L; 3]) -> (L, L::Mask) {
    let [k1, k2] = law.coupling;
    let carried = k2.mul_add(r[2], k1.mul_add(r[1], r[0]));
    let beta = u[0].mul_sub(law.normal_mass, carried);
    (beta, beta.lt(L::splat(0.0)))
}

/// Local solve of eight contacts in progress: sticking trial, then a bracketed Halley iteration for the slip of the rest.
#[derive(Clone, Copy)]
pub struct LocalSolve<L: Lanes> {
    beta: L,
    /// Lanes whose contact is closed at the end of the step.
    closed: L::Mask,
    /// Tangential impulses of the sticking trial, N s.
    stick_impulse: [L; 2],
    /// Lanes outside the friction cone, which slip.
    slips: L::Mask,
    secular: SecularEquation<L>,
    /// Lower and upper bound of the root.
    bracket: [L; 2],
    /// Initial guess: the root of the previous solve.
    guess: L,
    /// Current iterate.
    y: L,
    /// Lanes that have not converged yet.
    active: L::Mask,
}

impl<L: Lanes> LocalSolve<L> {
    /// Starts from the result of [`approach`]; `slip` is the initial guess of the slip solve.
    #[inline(always)]
    pub fn start(
        law: &LawLanes<L>,
        (beta, closed): (L, L::Mask),
        u: &[L; 3],
        r: &[L; 3],
        slip: &[f32; 8],
    ) -> Self {
        let (zero, one) = (L::splat(0.0), L::splat(1.0));
        let [k1, k2] = law.coupling;
        let slide1 = k1.neg_mul_add(u[0], u[1]);
        let slide2 = k2.neg_mul_add(u[0], u[2]);
        let z1 = law.tangent_mass.mul(law.tangent_ratio).neg_mul_add(slide1, r[1]);
        let z2 = law.tangent_mass.neg_mul_add(slide2, r[2]);
        let normal = normal_impulse(law, beta, z1, z2);
        let bound = law.friction.mul(normal);
        let inside = L::and(zero.le(normal), z2.mul_add(z2, z1.mul(z1)).le(bound.mul(bound)));
        let slips = L::and_not(closed, inside);
        let secular = SecularEquation::new(law, beta, [z1, z2]);
        let high = L::select(zero.lt(law.friction), one, zero);
        let guess = L::load32(slip);
        let y = L::select(high.lt(guess), high, guess);
        Self {
            beta,
            closed,
            stick_impulse: [z1, z2],
            slips,
            secular,
            bracket: [zero, high],
            guess,
            y,
            active: slips,
        }
    }

    /// Makes one Halley or bisection step.
    #[inline(always)]
    fn step(&mut self) {
        let y = self.y;
        let (halley, holds, real) = self.secular.step(y);
        let [low, high] = self.bracket;
        let (low, high) = (L::select(holds, y, low), L::select(holds, high, y));
        let bracketed = L::and(real, L::and(low.le(halley), halley.le(high)));
        let next = L::select(bracketed, halley, L::splat(0.5).mul(low.add(high)));
        let change = next.sub(y).abs();
        self.bracket = [low, high];
        // A converged lane stays: its result must not depend on its neighbours.
        self.y = L::select(self.active, next, y);
        self.active = L::and_not(self.active, change.le(L::splat(SMALL_STEP).mul(next)));
    }

    /// Returns the new impulses after [`solve_slip`]; `slip` is updated where a contact slips.
    #[inline(always)]
    pub fn finish(self, law: &LawLanes<L>, slip: &mut [f32; 8]) -> [L; 3] {
        let Self { beta, stick_impulse: z, slips, y, .. } = self;
        L::select(slips, y, self.guess).store32(slip);
        let slid = [z[0].mul(y).div(self.secular.denominator(y)), z[1].mul(y)];
        let [r1, r2] = each!(K in 2 => L::select(slips, slid[K], z[K]));
        let solved = [normal_impulse(law, beta, r1, r2), r1, r2];
        each!(K in 3 => L::select(self.closed, solved[K], L::splat(0.0)))
    }
}

/// Solves the slip of all contacts of `N` visits.
///
/// Each step is a chain of dependent operations; interleaving visits hides its latency.
#[inline(always)]
pub fn solve_slip<L: Lanes, const N: usize>(visits: &mut [LocalSolve<L>; N]) {
    for _ in 0..MAX_STEPS {
        let mut any_active = false;
        for visit in &*visits {
            any_active |= L::any(visit.active);
        }
        if !any_active {
            break;
        }
        for visit in &mut *visits {
            visit.step();
        }
    }
}

/// Returns the `r_n` that makes `u_n` zero.
#[inline(always)]
fn normal_impulse<L: Lanes>(law: &LawLanes<L>, beta: L, r1: L, r2: L) -> L {
    let [k1, k2] = law.coupling;
    k2.neg_mul_add(r2, k1.neg_mul_add(r1, L::splat(0.0).sub(beta)))
}

/// Secular equation of slip without roots and fractions.
///
/// With `e = ρ + (1-ρ) y = 1/D`, `P = e μ r_n` is a quadratic in y, `G = z_t² + e² z_s²` too, and
/// `h = 0` is `Q = P² - y² G = 0` with `P >= 0`. The roots of Q with `P < 0` are about `2/(μ ‖k‖)`
/// away, so steps count as small enough while μ is below some hundreds.
#[derive(Clone, Copy)]
struct SecularEquation<L> {
    ratio: L,
    rest: L,
    /// Coefficients of P.
    p: [L; 3],
    /// Halves of the last two coefficients.
    half: [L; 2],
    z_squared: [L; 2],
    /// Quarter of the last square.
    quarter: L,
}

impl<L: Lanes> SecularEquation<L> {
    #[inline(always)]
    fn new(law: &LawLanes<L>, beta: L, z: [L; 2]) -> Self {
        let ratio = law.tangent_ratio;
        let rest = L::splat(1.0).sub(ratio);
        let load = L::splat(0.0).sub(law.friction.mul(beta));
        let by1 = law.friction.mul(law.coupling[0].mul(z[0]));
        let by2 = law.friction.mul(law.coupling[1].mul(z[1]));
        let linear = by2.neg_mul_add(ratio, rest.mul_sub(load, by1));
        let square = L::splat(0.0).sub(by2.mul(rest));
        let z_squared = [z[0].mul(z[0]), z[1].mul(z[1])];
        Self {
            ratio,
            rest,
            p: [load.mul(ratio), linear, square],
            half: [L::splat(0.5).mul(linear), L::splat(0.5).mul(square)],
            z_squared,
            quarter: L::splat(0.25).mul(z_squared[1]),
        }
    }

    /// Returns `e`.
    #[inline(always)]
    fn denominator(&self, y: L) -> L {
        self.rest.mul_add(y, self.ratio)
    }

    /// Returns the Halley iterate after `y`, and the masks of `h(y) > 0` and of `r_n > 0`.
    ///
    /// Without `r_n > 0`, Q may have a root that h does not have.
    #[inline(always)]
    fn step(&self, y: L) -> (L, L::Mask, L::Mask) {
        let zero = L::splat(0.0);
        let [p0, p1, p2] = self.p;
        let e = self.denominator(y);
        let p = p2.mul_add(y, p1).mul_add(y, p0);
        // P'/2.
        let half_slope = p2.mul_add(y, self.half[0]);
        // With ' for d/dy: G' = 2 rest m, and `b` is y G'/2.
        let m = self.z_squared[1].mul(e);
        let g = m.mul_add(e, self.z_squared[0]);
        let shift = self.rest.mul(y);
        let b = m.mul(shift);
        // Q, Q'/2, Q''/8.
        let q = y.mul(y).neg_mul_add(g, p.mul(p));
        let q1 = y.neg_mul_add(g.add(b), p.mul(half_slope.add(half_slope)));
        let bend = self.quarter.mul(shift).mul_add(shift, L::splat(0.25).mul_add(g, b));
        let q2 = self.half[1].mul_add(p, half_slope.mul_sub(half_slope, bend));
        let below = q.neg_mul_add(q2, q1.mul(q1));
        let halley = y.sub(L::splat(0.5).mul(q).mul(q1).div(below));
        let real = zero.lt(p);
        (halley, L::and(real, zero.lt(q)), real)
    }
}

/// Returns `W_αα x` where `mask` is set, else zero.
#[inline(always)]
pub fn delassus_times<L: Lanes>(law: &LawLanes<L>, x: &[L; 3], mask: L::Mask) -> [L; 3] {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let [k1, k2] = law.coupling;
    // Padding has no masses to divide by.
    let w_nn = one.div(L::select(mask, law.normal_mass, one));
    let s2 = one.div(L::select(mask, law.tangent_mass, one));
    let normal = w_nn.mul(k2.mul_add(x[2], k1.mul_add(x[1], x[0])));
    let s1 = s2.div(law.tangent_ratio);
    let w = [normal, k1.mul_add(normal, s1.mul(x[1])), k2.mul_add(normal, s2.mul(x[2]))];
    each!(K in 3 => L::select(mask, w[K], zero))
}

/// Returns the natural map `r - P_K(r - ρ (u + μ ‖u_T‖ n))` with `ρ = 3 / tr W_αα` (T-10); zero for padding.
#[inline(always)]
pub fn natural_map<L: Lanes>(law: &LawLanes<L>, u: &[L; 3], r: &[L; 3]) -> [L; 3] {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let [k1, k2] = law.coupling;
    let contact = zero.lt(law.normal_mass);
    let w_nn = one.div(L::select(contact, law.normal_mass, one));
    let s2 = one.div(L::select(contact, law.tangent_mass, one));
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
    each!(K in 3 => L::select(contact, r[K].sub(projected[K]), zero))
}

/// Returns the complementarity gap and its infeasible part (T-44), J; zero for padding.
#[inline(always)]
pub fn complementarity<L: Lanes>(law: &LawLanes<L>, u: &[L; 3], r: &[L; 3]) -> [L; 2] {
    let zero = L::splat(0.0);
    let positive = |x: L| L::select(zero.lt(x), x, zero);
    let closing = positive(zero.sub(u[0]));
    let normal = r[0].mul(u[0]);
    let sliding = u[2].mul_add(u[2], u[1].mul(u[1])).sqrt();
    let friction = law.friction.mul(r[0]);
    let tangential = friction.mul_add(sliding, r[2].mul_add(u[2], r[1].mul(u[1])));
    let missing = L::splat(0.5).mul(law.normal_mass).mul(closing).mul(closing);
    let infeasible = positive(zero.sub(normal)).add(positive(zero.sub(tangential)));
    [positive(normal).add(positive(tangential)), infeasible.add(missing)]
}

/// Projects eight impulses on Coulomb's cones, as [`crate::math::cone::project`] does with one.
#[inline(always)]
pub fn project<L: Lanes>(mu: L, x: &[L; 3]) -> [L; 3] {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let tangential = x[2].mul_add(x[2], x[1].mul(x[1])).sqrt();
    let inside = tangential.le(mu.mul(x[0]));
    let polar = mu.mul(tangential).le(zero.sub(x[0]));
    let normal = mu.mul_add(tangential, x[0]).div(mu.mul_add(mu, one));
    let divisor = L::select(zero.lt(tangential), tangential, one);
    let scale = mu.mul(normal).div(divisor);
    let on_cone = [normal, scale.mul(x[1]), scale.mul(x[2])];
    each!(K in 3 => L::select(polar, zero, L::select(inside, x[K], on_cone[K])))
}

#[cfg(test)]
mod tests;
