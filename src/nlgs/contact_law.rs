//! Signorini-Coulomb at one contact, for any Delassus block: plain, scalar, the oracle of
//! the kernel's visit.

use crate::math::{Mat3, Vec3};

/// Newton steps relatively below this change nothing any more.
const SMALL_STEP: f64 = 1e-15;
const MAX_STEPS: usize = 100;

/// Impulse `r` (n, t, s) with `0 <= u_n ⊥ r_n >= 0` and Coulomb's law of slope `mu` for
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
    let reduced = Reduced::new(w, b, mu);
    let stick = reduced.at(1.0);
    if stick.excess >= 0.0 {
        return stick.impulse;
    }
    reduced.slip(stick)
}

/// What a relaxed visit changes of an impulse whose law is solved by `solved`: what opens loses all of it (T-17).
pub fn relaxed(impulse: &Vec3, solved: &Vec3, relaxation: f64) -> Vec3 {
    let opens = *solved == Vec3::zeros();
    (solved - impulse) * if opens { 1.0 } else { relaxation }
}

/// The problem with `u_n = 0` eliminated.
struct Reduced {
    /// `r_n` for `r_T = 0`.
    normal: f64,
    /// `W_nT / W_nn`.
    coupling: [f64; 2],
    schur: [[f64; 2]; 2],
    sigma: f64,
    /// `b_T - W_Tn b_n / W_nn`.
    slide: [f64; 2],
    mu: f64,
}

/// One value of y: impulse, `h(y)` and its derivative.
struct Trial {
    impulse: Vec3,
    excess: f64,
    slope: f64,
}

impl Reduced {
    fn new(w: &Mat3, b: &Vec3, mu: f64) -> Self {
        let coupling = [w.m12 / w.m11, w.m13 / w.m11];
        let schur = [
            [w.m22 - w.m21 * coupling[0], w.m23 - w.m21 * coupling[1]],
            [w.m32 - w.m31 * coupling[0], w.m33 - w.m31 * coupling[1]],
        ];
        let normal = -b.x / w.m11;
        Self {
            normal,
            coupling,
            schur,
            sigma: 0.5 * (schur[0][0] + schur[1][1]),
            slide: [b.y + w.m21 * normal, b.z + w.m31 * normal],
            mu,
        }
    }

    fn at(&self, y: f64) -> Trial {
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
        Trial {
            impulse: Vec3::new(normal, tangential[0], tangential[1]),
            excess: self.mu * normal - y * length,
            slope: -self.mu * dot(self.coupling, slope) - along,
        }
    }

    /// Newton's method, kept between a value that holds (`h >= 0`) and one that does not.
    fn slip(&self, stick: Trial) -> Vec3 {
        let (mut low, mut high) = (0.0, 1.0);
        let mut trial = stick;
        let mut y: f64 = 1.0;
        for _ in 0..MAX_STEPS {
            let newton = y - trial.excess / trial.slope;
            let next = if newton >= low && newton <= high { newton } else { 0.5 * (low + high) };
            let step = (next - y).abs();
            y = next;
            trial = self.at(y);
            if step <= SMALL_STEP * y || trial.excess == 0.0 {
                break;
            }
            *(if trial.excess > 0.0 { &mut low } else { &mut high }) = y;
        }
        trial.impulse
    }
}
