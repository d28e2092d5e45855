//! Path lengths of bodies: separated pairs are skipped until both bodies have travelled their distance.
//!
//! Reads: motion. Writes: [`TravelledDistance`]. Cost: two square roots per body and step. Contract: between two
//! updates, the length of a body grows by at least the displacement of any of its points; so does the difference of
//! two later lengths, whatever the rounding.

use crate::math::{Quat, Vec3};
use crate::motion::Motion;
use rayon::prelude::*;

/// Path length of each body, m `[nb]`.
#[derive(Debug, Default)]
pub(super) struct TravelledDistance {
    pub length: Vec<f64>,
    position: Vec<Vec3>,
    orientation: Vec<Quat>,
}

impl TravelledDistance {
    /// Resets the lengths; earlier values become meaningless.
    pub fn clear(&mut self) {
        self.length.clear();
    }

    /// Adds the displacement since the last configuration.
    ///
    /// `radius` is the largest distance of a point of each body from its origin `[nb]`, m.
    pub fn update(&mut self, motion: &Motion, radius: &[f64]) {
        let count = motion.position.len();
        if self.length.len() != count {
            self.length.clear();
            self.length.resize(count, 0.0);
            self.position.clone_from(&motion.position);
            self.orientation.clone_from(&motion.orientation);
            return;
        }
        let places = (&mut self.position, &mut self.orientation);
        (&mut self.length, places, &motion.position, &motion.orientation, radius)
            .into_par_iter()
            .with_min_len(1024)
            .for_each(|(length, (x0, q0), x, q, radius)| {
                let displacement = (x - *x0).norm() + radius * rotation_bound(q, q0);
                // Two roundings, and those of `displacement`.
                *length = (*length + displacement * (1.0 + 1e-12)) * (1.0 + 4.0 * f64::EPSILON);
                *x0 = *x;
                *q0 = *q;
            });
    }
}

/// Returns an upper bound of the displacement of a point at distance 1 by the rotation from `q0` to `q`.
///
/// A rotation by θ moves it by 2 sin(θ/2) <= 2 · 2 sin(θ/4) = 2 |Δq|.
pub(super) fn rotation_bound(q: &Quat, q0: &Quat) -> f64 {
    let (q, q0) = (q.coords, q0.coords);
    2.0 * (q - q0).norm_squared().min((q + q0).norm_squared()).sqrt()
}
