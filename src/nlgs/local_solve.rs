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
mod tests {
    use super::*;
    use crate::lanes::Portable;
    use crate::math::{Mat3, Vec3};
    use crate::nlgs::contact_law;
    use rand::{RngExt, SeedableRng};
    use rand_pcg::Pcg64;

    /// Eight problems as rows of the kernel, with velocities and impulses at the visit.
    struct Problems {
        rows: LawRows,
        u: [[f64; 8]; 3],
        r: [[f64; 8]; 3],
    }

    impl Problems {
        fn random(rng: &mut Pcg64) -> Self {
            let mut problems = Self { rows: LawRows::EMPTY, u: [[0.0; 8]; 3], r: [[0.0; 8]; 3] };
            let power =
                |rng: &mut Pcg64, low: f64, high: f64| 10_f64.powf(rng.random_range(low..high));
            for i in 0..8 {
                let mass = power(rng, -4.0, 2.0);
                let rows = &mut problems.rows;
                rows.normal_mass[i] = mass as f32;
                let strong = power(rng, -3.0, 1.0);
                rows.coupling[0][i] = (strong * rng.random_range(-1.0..1.0)) as f32;
                rows.coupling[1][i] = (strong * rng.random_range(-1.0..1.0)) as f32;
                rows.tangent_mass[i] = (mass * power(rng, -2.0, 2.0)) as f32;
                rows.tangent_ratio[i] = power(rng, -4.0, 0.0) as f32;
                rows.friction[i] =
                    if rng.random_range(0..20) == 0 { 0.0 } else { power(rng, -3.0, 1.0) as f32 };
                rows.slip[i] = if rng.random() { 1.0 } else { power(rng, -8.0, 0.0) as f32 };
                let (speed, load) = (power(rng, -8.0, 1.0), power(rng, -8.0, 1.0) * mass);
                for k in 0..3 {
                    problems.u[k][i] = speed * rng.random_range(-1.0..1.0);
                    problems.r[k][i] = load * rng.random_range(-1.0..1.0);
                }
            }
            problems
        }

        fn visit(&self) -> LocalSolve<Portable> {
            let law = LawLanes::load(&self.rows);
            let [u, r] = [self.u, self.r].map(|rows| rows.map(|x| Portable::load(&x)));
            LocalSolve::start(&law, approach(&law, &u, &r), &u, &r, &self.rows.slip)
        }

        fn end(&mut self, visit: LocalSolve<Portable>) -> [Vec3; 8] {
            let law = LawLanes::load(&self.rows);
            let rows = visit.finish(&law, &mut self.rows.slip).map(|lanes| {
                let mut row = [0.0; 8];
                lanes.store(&mut row);
                row
            });
            std::array::from_fn(|i| Vec3::new(rows[0][i], rows[1][i], rows[2][i]))
        }

        fn solve(&mut self) -> [Vec3; 8] {
            let mut visits = [self.visit()];
            solve_slip(&mut visits);
            let [visit] = visits;
            self.end(visit)
        }

        /// Returns `W_αα`, `u`, `r` and μ of a lane.
        fn lane(&self, i: usize) -> (Mat3, Vec3, Vec3, f64) {
            let rows = &self.rows;
            let f = |row: &[f32; 8]| row[i] as f64;
            let k = Vec3::new(1.0, f(&rows.coupling[0]), f(&rows.coupling[1]));
            let s = 1.0 / f(&rows.tangent_mass);
            let schur = Vec3::new(0.0, s / f(&rows.tangent_ratio), s);
            let w = k * k.transpose() / f(&rows.normal_mass) + Mat3::from_diagonal(&schur);
            let vector = |rows: &[[f64; 8]; 3]| Vec3::new(rows[0][i], rows[1][i], rows[2][i]);
            (w, vector(&self.u), vector(&self.r), f(&rows.friction))
        }
    }

    /// Returns the violation of Signorini-Coulomb by `r`, relative to the terms of its sums, and the status of the contact.
    fn violation(w: &Mat3, u: &Vec3, before: &Vec3, mu: f64, r: &Vec3) -> (f64, &'static str) {
        let delta = r - before;
        let after = u + w * delta;
        // Scale of rounding: impulses and velocities in the sums.
        let size = u.abs() + w.abs() * (before.abs() + r.abs());
        let speed = size.amax();
        if *r == Vec3::zeros() {
            return ((-after.x).max(0.0) / speed, "open");
        }
        let (tangential, bound) = (r.y.hypot(r.z), mu * r.x);
        let mut worst = after.x.abs() / speed;
        worst = worst.max((-r.x).max(0.0) / r.norm());
        if tangential < bound * (1.0 - 1e-12) {
            return (worst.max(after.y.hypot(after.z) / speed), "stick");
        }
        worst = worst.max((tangential - bound) / r.norm());
        // u_T = -λ r_T with λ >= 0.
        let sliding = after.y.hypot(after.z);
        let opposed = (after.y * r.y + after.z * r.z) + sliding * tangential;
        let parallel = after.y * r.z - after.z * r.y;
        if tangential > 0.0 {
            worst = worst.max(parallel.abs() / tangential / speed);
            worst = worst.max(opposed / tangential / speed);
        }
        (worst, "slip")
    }

    #[test]
    fn the_contact_law_holds_on_a_hundred_thousand_random_problems() {
        let mut rng = Pcg64::seed_from_u64(17);
        let mut counts = std::collections::BTreeMap::new();
        let mut worst = 0.0_f64;
        for _ in 0..12_500 {
            let mut problems = Problems::random(&mut rng);
            let solved = problems.solve();
            for (i, r) in solved.iter().enumerate() {
                let (w, u, before, mu) = problems.lane(i);
                assert!(r.iter().all(|x| x.is_finite()), "{w} {u} {before} {mu}: {r}");
                assert!(problems.rows.slip[i] >= 0.0 && problems.rows.slip[i] <= 1.0);
                let (violation, kind) = violation(&w, &u, &before, mu, r);
                *counts.entry(kind).or_insert(0) += 1;
                assert!(violation < 1e-12, "{kind} {violation:e}: {w} {u} {before} {mu}: {r}");
                worst = worst.max(violation);
            }
        }
        println!("{counts:?}, worst {worst:e}");
        assert!(counts.len() == 3 && counts.values().all(|&n| n > 5_000), "{counts:?}");
    }

    #[test]
    fn two_visits_at_once_end_as_each_alone() {
        let mut rng = Pcg64::seed_from_u64(31);
        for _ in 0..2_000 {
            let mut two = [Problems::random(&mut rng), Problems::random(&mut rng)];
            let mut visits = two.each_ref().map(Problems::visit);
            solve_slip(&mut visits);
            for (problems, visit) in two.iter_mut().zip(visits) {
                let slip = problems.rows.slip;
                let (at_once, ended) = (problems.end(visit), problems.rows.slip);
                problems.rows.slip = slip;
                assert_eq!((problems.solve(), problems.rows.slip), (at_once, ended));
            }
        }
    }

    #[test]
    fn the_scalar_law_finds_the_same_impulse_where_it_is_unique() {
        let mut rng = Pcg64::seed_from_u64(19);
        for _ in 0..5_000 {
            let mut problems = Problems::random(&mut rng);
            let rows = &mut problems.rows;
            for i in 0..8 {
                // Uniqueness: μ ‖k‖ below one, weakly stretched S.
                let limit = 0.5 / rows.friction[i].max(0.01);
                rows.coupling[0][i] = rows.coupling[0][i].clamp(-limit, limit);
                rows.coupling[1][i] = rows.coupling[1][i].clamp(-limit, limit);
                rows.tangent_ratio[i] = rows.tangent_ratio[i].max(0.2);
            }
            let solved = problems.solve();
            for (i, r) in solved.iter().enumerate() {
                let (w, u, before, mu) = problems.lane(i);
                let scalar = contact_law::solve(&w, &(u - w * before), mu);
                let inverse = w.try_inverse().unwrap();
                let size = before.norm() + scalar.norm() + (inverse * u).norm();
                let apart = (scalar - r).norm() / size;
                assert!(apart < 1e-10, "{apart:e}: {w} {u} {before} {mu}: {r} {scalar}");
            }
        }
    }

    #[test]
    fn eight_projections_are_those_of_one() {
        let mut rng = Pcg64::seed_from_u64(29);
        for _ in 0..2_000 {
            let values = [-2.0, -0.5, 0.0, 0.5, 2.0];
            let mut row = || [0; 8].map(|_| values[rng.random_range(0..5)]);
            let (mu, rows) = ([0.0, 0.0, 0.3, 0.3, 1.0, 1.0, 2.0, 1e3], [row(), row(), row()]);
            let lanes = project(Portable::load(&mu), &rows.map(|row| Portable::load(&row)));
            let lanes = lanes.map(|lane| {
                let mut row = [0.0; 8];
                lane.store(&mut row);
                row
            });
            for i in 0..8 {
                let [x, found] = [rows, lanes].map(|r| Vec3::new(r[0][i], r[1][i], r[2][i]));
                let apart = (found - crate::math::cone::project(&x, mu[i])).norm();
                assert!(apart < 1e-15 * (1.0 + x.norm()), "{} {x}: {found}", mu[i]);
            }
        }
    }

    #[test]
    fn extreme_values_give_finite_impulses() {
        let extremes = [0.0, 1e-300, 1e-40, 1e-12, 1.0, 1e12, -1e-300, -1e-12, -1.0, -1e12];
        let mut rng = Pcg64::seed_from_u64(23);
        for _ in 0..20_000 {
            let mut problems = Problems::random(&mut rng);
            for i in 0..8 {
                for k in 0..3 {
                    problems.u[k][i] = extremes[rng.random_range(0..extremes.len())];
                    problems.r[k][i] = extremes[rng.random_range(0..extremes.len())];
                }
                problems.rows.friction[i] = [0.0, 1e-6, 0.5, 1e2][rng.random_range(0..4)];
                problems.rows.slip[i] = [0.0, 1e-30, 0.5, 1.0][rng.random_range(0..4)];
            }
            for (i, r) in problems.solve().iter().enumerate() {
                let (w, u, before, _) = problems.lane(i);
                assert!(r.iter().all(|x| x.is_finite()), "{u:?} {before:?} {r:?}");
                let size = before.norm() + (w.try_inverse().unwrap() * u).norm();
                assert!(r.x >= -1e-12 * size, "{u:?} {before:?} {r:?}");
            }
        }
    }
}
