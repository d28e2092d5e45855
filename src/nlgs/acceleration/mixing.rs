//! How the last images are combined: `γ = argmin ‖f - Σ γ_k Δf_k‖`.

use super::WINDOW;
use nalgebra::{Cholesky, SMatrix, SVector};
use std::ops::AddAssign;

/// Keeps the normal equations solvable when steps repeat each other.
const RIDGE: f64 = 1e-10;
/// Most of the shares together: no point lies further than so many steps ahead. Where steps go on for ever alike, as between
/// bodies that are driven into each other, the differences are rounding, and shares of them any number.
const FURTHEST: f64 = 1e4;

/// Scalar products of a history, to be summed over the sets.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Products {
    /// Of the newest difference with those remembered.
    pub newest: [f64; WINDOW],
    /// Of the present change with the differences remembered.
    pub present: [f64; WINDOW],
    /// Of the present change with itself.
    pub change_squared: f64,
}

impl AddAssign for Products {
    fn add_assign(&mut self, other: Self) {
        for k in 0..WINDOW {
            self.newest[k] += other.newest[k];
            self.present[k] += other.present[k];
        }
        self.change_squared += other.change_squared;
    }
}

/// What the sets' histories have in common.
#[derive(Debug, Default)]
pub struct Mixing {
    /// Of the differences remembered, in the order of their slots.
    gram: SMatrix<f64, WINDOW, WINDOW>,
    /// Images seen since the last time all was forgotten.
    seen: usize,
}

impl Mixing {
    pub fn forget(&mut self) {
        self.seen = 0;
    }

    /// Where the next difference goes: the newest takes the oldest's place. The first image makes none.
    pub fn slot(&self) -> Option<usize> {
        self.seen.checked_sub(1).map(|k| k % WINDOW)
    }

    /// Differences remembered after the next image.
    pub fn remembered(&self) -> usize {
        self.seen.min(WINDOW)
    }

    /// The shares of the differences, from the products of an image with them; zero where none are
    /// remembered or the differences say nothing.
    pub fn shares(&mut self, products: &Products) -> [f64; WINDOW] {
        let (slot, remembered) = (self.slot(), self.remembered());
        self.seen += 1;
        if let Some(slot) = slot {
            for k in 0..remembered {
                self.gram[(k, slot)] = products.newest[k];
                self.gram[(slot, k)] = products.newest[k];
            }
        }
        let mut gram = SMatrix::<f64, WINDOW, WINDOW>::identity();
        let mut right = SVector::<f64, WINDOW>::zeros();
        for k in 0..remembered {
            right[k] = products.present[k];
            for l in 0..remembered {
                gram[(k, l)] = self.gram[(k, l)];
            }
            gram[(k, k)] *= 1.0 + RIDGE;
        }
        let shares = Cholesky::new(gram).map(|factor| factor.solve(&right));
        // Impulses that are not finite would stay so.
        shares.filter(|shares| shares.iter().all(|x| x.is_finite())).map_or(
            [0.0; WINDOW],
            |shares| {
                let most = shares.lp_norm(1).max(FURTHEST);
                (shares * (FURTHEST / most)).into()
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::History;
    use super::*;

    /// `r → r - A r + b` of a small linear problem, whose sweeps alone grow without end.
    fn image(r: &[f64]) -> Vec<f64> {
        let turn = [[0.2, 3.0, 0.0], [-3.0, 0.2, 0.5], [0.1, 0.0, 1.5]];
        (0..3).map(|i| r[i] - (0..3).map(|j| turn[i][j] * r[j]).sum::<f64>() + 1.0).collect()
    }

    #[test]
    fn linear_iterations_end_after_as_many_points_as_unknowns_however_they_are_split() {
        for cut in [0, 1, 3] {
            let mut sets = [History::default(), History::default()];
            let mut mixing = Mixing::default();
            sets[0].begin(vec![1.0; cut]);
            sets[1].begin(vec![1.0; 3 - cut]);
            let mut r = vec![0.0; 3];
            let mut change = f64::INFINITY;
            for _ in 0..6 {
                let g = image(&r);
                let (slot, remembered) = (mixing.slot(), mixing.remembered());
                let mut products = sets[0].observe(slot, remembered, &r[..cut], &g[..cut]);
                products += sets[1].observe(slot, remembered, &r[cut..], &g[cut..]);
                change = products.change_squared.sqrt();
                let shares = mixing.shares(&products);
                let mut parts = [vec![], vec![]];
                sets.iter().zip(&mut parts).for_each(|(set, part)| set.combine(&shares, part));
                r = parts.concat();
            }
            assert!(change < 1e-6, "cut {cut}: {change}");
        }
    }

    #[test]
    fn steps_that_go_on_for_ever_alike_lead_no_further_than_so_many_of_them() {
        let (mut set, mut mixing) = (History::default(), Mixing::default());
        set.begin(vec![1.0; 2]);
        let (mut r, mut point, mut furthest) = (vec![0.0; 2], vec![], 0.0_f64);
        for k in 0..12 {
            // Grows by one each time, but for rounding.
            let rounding = 1e-16 * f64::from((7 * k) % 5);
            let g = [r[0] + 1.0 + rounding, r[1] + 1.0 - rounding];
            let products = set.observe(mixing.slot(), mixing.remembered(), &r, &g);
            let shares = mixing.shares(&products);
            let sum: f64 = shares.iter().map(|x| x.abs()).sum();
            assert!(sum <= 1.000_001 * FURTHEST, "{shares:?}");
            furthest = furthest.max(sum);
            set.combine(&shares, &mut point);
            r.clone_from(&g.to_vec());
        }
        assert!(furthest > 0.99 * FURTHEST, "without a bound they would be any number: {furthest}");
    }

    #[test]
    fn what_is_not_finite_is_not_mixed_in() {
        let mut mixing = Mixing::default();
        let none = Products::default();
        assert_eq!(mixing.shares(&none), [0.0; WINDOW]);
        let infinite = Products { newest: [1.0; WINDOW], present: [f64::NAN; WINDOW], ..none };
        assert_eq!(mixing.shares(&infinite), [0.0; WINDOW]);
        assert_eq!((mixing.slot(), mixing.remembered()), (Some(1), 2));
        mixing.forget();
        assert_eq!((mixing.slot(), mixing.remembered()), (None, 0));
    }
}
