//! Signorini-Coulomb law of one contact for any Delassus block: the scalar reference of the kernel's visit.

use crate::math::{Mat3, Vec3};

/// Relative Newton step at which the iteration ends.
const SMALL_STEP: f64 = 1e-15;
/// Maximum number of Newton steps.
const MAX_STEPS: usize = 100;
/// Fraction of a block's trace below which its reduced trace is rounding.
const ROUNDING: f64 = 1e-14;

/// Returns the impulse `r` (n, t, s) with `0 <= u_n ⊥ r_n >= 0` and Coulomb's law of slope `mu` for
/// `u = W r + b` (T-8).
///
/// `w` need not be symmetric (published problems are not always), but needs `w.m11 > 0`. A contact
/// that slips has `u_T = -λ r_T`; with `S = W_TT - W_Tn W_nT/W_nn`, `σ = tr S / 2` and
/// `λ = σ (1/y - 1)` the unknown is y in [0, 1]:
/// `r_T = y q`, `q = -(y S + (1-y) σ)⁻¹ (b_T - W_Tn b_n/W_nn)`, `h(y) = μ r_n - ‖r_T‖ = 0`.
pub fn solve(w: &Mat3, b: &Vec3, mu: f64) -> Vec3 {
    if b.x >= 0.0 {
        return Vec3::zeros();
    }
    let reduced = ReducedLaw::new(w, b, mu);
    let stick = reduced.evaluate(1.0);
    if stick.excess >= 0.0 {
        return stick.impulse;
    }
    reduced.slip(stick)
}

/// Change of an impulse by a relaxed visit with the solution `solved`; an opening contact loses all of it (T-17).
pub fn relaxed_change(impulse: &Vec3, solved: &Vec3, relaxation: f64) -> Vec3 {
    let opens = *solved == Vec3::zeros();
    (solved - impulse) * if opens { 1.0 } else { relaxation }
}

/// Contact law with `u_n = 0` eliminated.
struct ReducedLaw {
    /// Normal impulse for `r_T = 0`.
    normal: f64,
    /// Coupling `W_nT / W_nn`.
    coupling: [f64; 2],
    schur: [[f64; 2]; 2],
    sigma: f64,
    /// Tangential velocity `b_T - W_Tn b_n / W_nn`.
    slide: [f64; 2],
    mu: f64,
}

/// Impulse, `h(y)` and its derivative at one y.
struct SlipTrial {
    impulse: Vec3,
    excess: f64,
    slope: f64,
}

impl ReducedLaw {
    fn new(w: &Mat3, b: &Vec3, mu: f64) -> Self {
        let coupling = [w.m12 / w.m11, w.m13 / w.m11];
        let mut schur = [
            [w.m22 - w.m21 * coupling[0], w.m23 - w.m21 * coupling[1]],
            [w.m32 - w.m31 * coupling[0], w.m33 - w.m31 * coupling[1]],
        ];
        let normal = -b.x / w.m11;
        let mut sigma = 0.5 * (schur[0][0] + schur[1][1]);
        // A body with one degree of freedom does not slide at `u_n = 0`: any small block above rounding expresses that.
        let least = ROUNDING * (w.m11 + w.m22.abs() + w.m33.abs());
        if sigma.abs() < least {
            (schur, sigma) = ([[least, 0.0], [0.0, least]], least);
        }
        Self {
            normal,
            coupling,
            schur,
            sigma,
            slide: [b.y + w.m21 * normal, b.z + w.m31 * normal],
            mu,
        }
    }

    fn evaluate(&self, y: f64) -> SlipTrial {
        let rest = (1.0 - y) * self.sigma;
        let [[s11, s12], [s21, s22]] = self.schur;
        let (a, b, c, d) = (y * s11 + rest, y * s12, y * s21, y * s22 + rest);
        let determinant = a * d - b * c;
        let apply = |x: [f64; 2]| {
            [(d * x[0] - b * x[1]) / determinant, (a * x[1] - c * x[0]) / determinant]
        };
        let q = apply(self.slide).map(|x| -x);
        let slope = apply(q).map(|x| self.sigma * x);
        let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
        let length = dot(q, q).sqrt();
        let tangential = q.map(|x| y * x);
        let normal = self.normal - dot(self.coupling, tangential);
        let along = if length > 0.0 { dot(q, slope) / length } else { 0.0 };
        SlipTrial {
            impulse: Vec3::new(normal, tangential[0], tangential[1]),
            excess: self.mu * normal - y * length,
            slope: -self.mu * dot(self.coupling, slope) - along,
        }
    }

    /// Solves the slip by Newton's method, bracketed between a value that holds (`h >= 0`) and one that does not.
    fn slip(&self, stick: SlipTrial) -> Vec3 {
        let (mut low, mut high) = (0.0, 1.0);
        let mut trial = stick;
        let mut y: f64 = 1.0;
        for _ in 0..MAX_STEPS {
            let newton = y - trial.excess / trial.slope;
            let next = if newton >= low && newton <= high { newton } else { 0.5 * (low + high) };
            let step = (next - y).abs();
            y = next;
            trial = self.evaluate(y);
            if step <= SMALL_STEP * y || trial.excess == 0.0 {
                break;
            }
            *(if trial.excess > 0.0 { &mut low } else { &mut high }) = y;
        }
        trial.impulse
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngExt;

    #[test]
    fn a_body_with_one_degree_of_freedom_is_stopped() {
        // Mass 1/s, free along `way` alone: at zero normal velocity it stands, with no friction in a central impact and
        // with as much as holds it otherwise.
        let mut rng = rand_pcg::Pcg64::new(7, 0);
        for _ in 0..2000 {
            let mut number = || rng.random_range(-1.0..1.0);
            let way = Vec3::new(0.1 + f64::abs(number()), number(), number());
            let (s, v) = (10f64.powf(3.0 * number()), 10f64.powf(3.0 * number()).abs());
            let (w, b) = (way * way.transpose() * s, -way * v);
            for mu in [0.0, 0.3, 0.5, 1.0] {
                let r = solve(&w, &b, mu);
                let u = w * r + b;
                assert!(
                    r.x > 0.0 && u.norm() < 1e-10 * b.norm(),
                    "{way:?} {s} {v} {mu}: {r:?} {u:?}"
                );
                assert!(r.yz().norm() <= (mu + 1e-9) * r.x, "{way:?} {s} {v} {mu}: {r:?}");
            }
        }
    }
}
