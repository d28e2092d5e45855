//! Mixing coefficients of Anderson acceleration: `γ = argmin ‖f - Σ γ_k Δf_k‖`.

use nalgebra::{Cholesky, SMatrix, SVector};
use std::ops::AddAssign;

/// Number of stored differences.
pub const DEPTH: usize = 10;
/// Relative regularisation of the normal equations, for steps that repeat each other.
const REGULARISATION: f64 = 1e-10;
/// Maximum sum of the coefficients' magnitudes, which bounds the extrapolation.
///
/// Where steps repeat for ever, as between bodies that are driven into each other, the differences are rounding and
/// their coefficients are arbitrary.
const MAX_COEFFICIENT_SUM: f64 = 1e4;

/// Scalar products of a history; add those of all sets.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct HistoryProducts {
    /// Products of the newest difference with the stored ones.
    pub newest: [f64; DEPTH],
    /// Products of the current change with the stored differences.
    pub current: [f64; DEPTH],
    /// Square of the current change.
    pub change_squared: f64,
}

impl AddAssign for HistoryProducts {
    fn add_assign(&mut self, other: Self) {
        for k in 0..DEPTH {
            self.newest[k] += other.newest[k];
            self.current[k] += other.current[k];
        }
        self.change_squared += other.change_squared;
    }
}

/// Normal equations of the mixing, common to all sets.
#[derive(Debug, Default)]
pub struct AndersonMixing {
    /// Gram matrix of the stored differences, in the order of their slots.
    gram: SMatrix<f64, DEPTH, DEPTH>,
    /// Number of images since the last reset.
    images: usize,
}

impl AndersonMixing {
    /// Clears the history.
    pub fn reset(&mut self) {
        self.images = 0;
    }

    /// Slot of the next difference, which replaces the oldest one. The first image has none.
    pub fn next_slot(&self) -> Option<usize> {
        self.images.checked_sub(1).map(|k| k % DEPTH)
    }

    /// Number of differences stored after the next image.
    pub fn stored(&self) -> usize {
        self.images.min(DEPTH)
    }

    /// Computes the coefficients of the differences from the products of an image with them.
    ///
    /// Zero if none are stored or the normal equations are singular.
    pub fn coefficients(&mut self, products: &HistoryProducts) -> [f64; DEPTH] {
        let (slot, stored) = (self.next_slot(), self.stored());
        self.images += 1;
        if let Some(slot) = slot {
            for k in 0..stored {
                self.gram[(k, slot)] = products.newest[k];
                self.gram[(slot, k)] = products.newest[k];
            }
        }
        let mut gram = SMatrix::<f64, DEPTH, DEPTH>::identity();
        let mut right = SVector::<f64, DEPTH>::zeros();
        for k in 0..stored {
            right[k] = products.current[k];
            for l in 0..stored {
                gram[(k, l)] = self.gram[(k, l)];
            }
            gram[(k, k)] *= 1.0 + REGULARISATION;
        }
        let coefficients = Cholesky::new(gram).map(|factor| factor.solve(&right));
        // Impulses that are not finite would stay so.
        coefficients.filter(|c| c.iter().all(|x| x.is_finite())).map_or([0.0; DEPTH], |c| {
            let sum = c.lp_norm(1).max(MAX_COEFFICIENT_SUM);
            (c * (MAX_COEFFICIENT_SUM / sum)).into()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::History;
    use super::*;

    /// `r → r - A r + b` of a small linear problem, whose plain iteration diverges.
    fn image(r: &[f64]) -> Vec<f64> {
        let turn = [[0.2, 3.0, 0.0], [-3.0, 0.2, 0.5], [0.1, 0.0, 1.5]];
        (0..3).map(|i| r[i] - (0..3).map(|j| turn[i][j] * r[j]).sum::<f64>() + 1.0).collect()
    }

    #[test]
    fn linear_iterations_converge_within_the_number_of_unknowns_however_they_are_split() {
        for cut in [0, 1, 3] {
            let mut sets = [History::default(), History::default()];
            let mut mixing = AndersonMixing::default();
            sets[0].reset(vec![1.0; cut]);
            sets[1].reset(vec![1.0; 3 - cut]);
            let mut r = vec![0.0; 3];
            let mut change = f64::INFINITY;
            for _ in 0..6 {
                let g = image(&r);
                let (slot, stored) = (mixing.next_slot(), mixing.stored());
                let mut products = sets[0].observe(slot, stored, &r[..cut], &g[..cut]);
                products += sets[1].observe(slot, stored, &r[cut..], &g[cut..]);
                change = products.change_squared.sqrt();
                let coefficients = mixing.coefficients(&products);
                let mut parts = [vec![], vec![]];
                sets.iter()
                    .zip(&mut parts)
                    .for_each(|(set, part)| set.combine(&coefficients, part));
                r = parts.concat();
            }
            assert!(change < 1e-6, "cut {cut}: {change}");
        }
    }

    #[test]
    fn repeated_steps_are_extrapolated_by_at_most_the_maximum_coefficient_sum() {
        let (mut set, mut mixing) = (History::default(), AndersonMixing::default());
        set.reset(vec![1.0; 2]);
        let (mut r, mut point, mut furthest) = (vec![0.0; 2], vec![], 0.0_f64);
        for k in 0..12 {
            // Grows by one each time, but for rounding.
            let rounding = 1e-16 * f64::from((7 * k) % 5);
            let g = [r[0] + 1.0 + rounding, r[1] + 1.0 - rounding];
            let products = set.observe(mixing.next_slot(), mixing.stored(), &r, &g);
            let coefficients = mixing.coefficients(&products);
            let sum: f64 = coefficients.iter().map(|x| x.abs()).sum();
            assert!(sum <= 1.000_001 * MAX_COEFFICIENT_SUM, "{coefficients:?}");
            furthest = furthest.max(sum);
            set.combine(&coefficients, &mut point);
            r.clone_from(&g.to_vec());
        }
        assert!(
            furthest > 0.99 * MAX_COEFFICIENT_SUM,
            "without a bound they would be any number: {furthest}"
        );
    }

    #[test]
    fn coefficients_of_values_that_are_not_finite_are_zero() {
        let mut mixing = AndersonMixing::default();
        let none = HistoryProducts::default();
        assert_eq!(mixing.coefficients(&none), [0.0; DEPTH]);
        let infinite = HistoryProducts { newest: [1.0; DEPTH], current: [f64::NAN; DEPTH], ..none };
        assert_eq!(mixing.coefficients(&infinite), [0.0; DEPTH]);
        assert_eq!((mixing.next_slot(), mixing.stored()), (Some(1), 2));
        mixing.reset();
        assert_eq!((mixing.next_slot(), mixing.stored()), (None, 0));
    }
}
