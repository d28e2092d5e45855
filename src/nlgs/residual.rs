//! Residuals of a contact problem: LMGC90's norms, the natural map and the complementarity gap.
//!
//! NormSums over a set of contacts are added up, in a fixed order, over the sets of a problem, then turned
//! into norms.

use std::ops::AddAssign;

/// Relative size of the velocity changes that rounding alone keeps alive: a visit adds up two dozen
/// products, and coupled axes stretch their errors.
const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Ratio of the norms of a part to the limits of the convergence test below which the part has converged.
const PART_LIMIT: f64 = 0.5;

/// Residuals of a step, compared with [`crate::model::Solver::tolerance`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Residuals {
    /// Quadratic norm of LMGC90, not divided by a tolerance: rms of the visits' velocity change over rms of
    /// `W_αα r_α` on active contacts (T-11).
    pub quad: f64,
    /// Maximum norm of LMGC90: largest velocity change over 16.666 times rms of `W_αα r_α`.
    pub max16: f64,
    /// Larger of the two impulse-weighted means of the change (T-11).
    pub weighted: f64,
    /// Unit-free natural map (T-10).
    pub natural_map: f64,
}

impl Residuals {
    /// Largest of LMGC90's norms.
    pub fn qm16(&self) -> f64 {
        self.quad.max(self.max16).max(self.weighted)
    }
}

/// NormSums over the visits of a sweep (T-11).
///
/// `Δv = W_αα Δr` is the velocity that a visit changes at its own contact, or would change if it were not
/// relaxed, `W_αα r` the velocity that the contact's whole impulse accounts for. Visits count that end
/// with `r_n > 0` or would change the impulse. After `prep_check` and `comp_check` of LMGC90's `nlgs_3D`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct VisitNorms {
    /// Number of visits that count.
    pub active: f64,
    /// Sum `Σ ‖Δv‖²`, (m/s)².
    pub dv_squared: f64,
    /// Sum `Σ ‖W_αα r‖²`, (m/s)².
    pub wr_squared: f64,
    /// Sum `Σ r·W_αα r`, J.
    pub r_wr: f64,
    /// Sum `Σ r·Δv`, J.
    pub r_dv: f64,
    /// Sum `Σ ‖r‖² ‖Δv‖²`, J².
    pub r_squared_dv_squared: f64,
    /// Maximum `max ‖Δv‖²`, (m/s)².
    pub max_dv_squared: f64,
    /// Largest square of a body's speed, including the rotation of a grain, (m/s)²: the scale of rounding.
    pub speed_squared: f64,
}

impl AddAssign for VisitNorms {
    fn add_assign(&mut self, other: Self) {
        self.active += other.active;
        self.dv_squared += other.dv_squared;
        self.wr_squared += other.wr_squared;
        self.r_wr += other.r_wr;
        self.r_dv += other.r_dv;
        self.r_squared_dv_squared += other.r_squared_dv_squared;
        self.max_dv_squared = self.max_dv_squared.max(other.max_dv_squared);
        self.speed_squared = self.speed_squared.max(other.speed_squared);
    }
}

impl VisitNorms {
    /// Computes LMGC90's norms (T-11), not divided by the tolerance; the natural map stays zero.
    ///
    /// With rms over the active visits: `quad = rms ‖Δv‖ / rms ‖W r‖` (its QuadDV),
    /// `max16 = max ‖Δv‖ / (16.666 rms ‖W r‖)` (MaxDV), `weighted` the larger of
    /// `|Σ r·Δv| / Σ r·W r` (MeanDVoR) and `rms(‖r‖ ‖Δv‖) / mean(r·W r)` (QuadDVoR).
    /// All zero without active contacts, or if only rounding changes the impulses: the problem is solved. Where the
    /// impulses fade away, the norms would not show it, because they are relative to them.
    pub fn residuals(&self) -> Residuals {
        if self.is_rounding_noise() {
            return Residuals::default();
        }
        if self.active == 0.0 || self.wr_squared <= 0.0 || self.r_wr <= 0.0 {
            // Only openings happen: they are exact, unless something still changes.
            let unsolved = if self.dv_squared > 0.0 { f64::INFINITY } else { 0.0 };
            return Residuals { quad: unsolved, max16: unsolved, ..Residuals::default() };
        }
        let wr = (self.wr_squared / self.active).sqrt();
        let mean = self.r_dv.abs() / self.r_wr;
        let quad = (self.r_squared_dv_squared / self.active).sqrt() / (self.r_wr / self.active);
        Residuals {
            quad: (self.dv_squared / self.active).sqrt() / wr,
            max16: self.max_dv_squared.sqrt() / (16.666 * wr),
            weighted: mean.max(quad),
            natural_map: 0.0,
        }
    }

    /// Returns true if these norms of some contacts, beside those of `all`, are below half of the limits of the
    /// convergence test (T-11): sweeps over these contacts alone gain little until others change.
    pub fn is_part_converged(&self, all: &Self, tolerance: f64, gravity_dv: f64) -> bool {
        let limit = PART_LIMIT * tolerance;
        let wr_squared = all.wr_squared / all.active;
        let r_wr = all.r_wr / all.active;
        let max_dv = (16.666 * limit * wr_squared.sqrt()).min(PART_LIMIT * gravity_dv);
        self.dv_squared <= self.active * limit * limit * wr_squared
            && self.r_squared_dv_squared <= self.active * (limit * r_wr).powi(2)
            && self.max_dv_squared <= max_dv * max_dv
    }

    /// Returns true if only rounding changes the velocities (T-11).
    pub fn is_rounding_noise(&self) -> bool {
        self.dv_squared <= self.active * ROUNDING * ROUNDING * self.speed_squared
    }

    /// Largest velocity change over `gravity_dv`, the change by gravity in a step (m/s).
    ///
    /// Above one, a body is accelerated more than its weight explains (T-11).
    pub fn relative_dv(&self, gravity_dv: f64) -> f64 {
        self.max_dv_squared.sqrt() / gravity_dv
    }
}

/// Energy by which the impulses of a solution miss the contact law, summed over the contacts (T-44).
///
/// Both parts are zero at a solution and never negative, so that they add up over steps.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ComplementarityGap {
    /// Impulses of contacts that open, times the speed at which they open, and the work of friction that is missing from
    /// Coulomb's law, J.
    pub gap: f64,
    /// Part in which impulses and velocities are not feasible, J: contacts that still close at the end of the step.
    pub infeasible: f64,
}

impl AddAssign for ComplementarityGap {
    fn add_assign(&mut self, other: Self) {
        self.gap += other.gap;
        self.infeasible += other.infeasible;
    }
}

/// Sums over the contacts of how far they are from the contact law, at impulses and velocities of the same moment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ContactLawSums {
    /// Sum `Σ ‖r - P_K(r - ρ (u + μ ‖u_T‖ n))‖²` with `ρ_c = 3 / tr W_cc` (T-10), (N s)².
    pub map_squared: f64,
    /// Sum `Σ ‖r‖²`, (N s)².
    pub r_squared: f64,
    /// Complementarity gap.
    pub complementarity: ComplementarityGap,
}

impl AddAssign for ContactLawSums {
    fn add_assign(&mut self, other: Self) {
        self.map_squared += other.map_squared;
        self.r_squared += other.r_squared;
        self.complementarity += other.complementarity;
    }
}

impl ContactLawSums {
    /// Unit-free natural map (T-10): norm of the map over norm of the impulses.
    pub fn natural_map(&self) -> f64 {
        if self.map_squared == 0.0 { 0.0 } else { (self.map_squared / self.r_squared).sqrt() }
    }
}
