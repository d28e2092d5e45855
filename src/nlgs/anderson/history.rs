//! History of the impulses of one set.

use super::mixing::{DEPTH, HistoryProducts};

/// Independent partial sums of a scalar product.
const ROW: usize = 8;

/// Last values and differences of the change `f = D (g(r) - r)` and the image `g(r)` of an iteration.
///
/// Vectors hold the components of all impulses of the set `[n]`.
#[derive(Debug, Default)]
pub struct History {
    /// Diagonal of D, which makes changes of impulses comparable.
    weight: Vec<f64>,
    change: Vec<f64>,
    image: Vec<f64>,
    changes: [Vec<f64>; DEPTH],
    images: [Vec<f64>; DEPTH],
}

impl History {
    /// Clears the history and sets the weights `[n]`.
    pub fn reset(&mut self, weight: impl IntoIterator<Item = f64>) {
        self.weight.clear();
        self.weight.extend(weight);
    }

    /// Adds an iteration from `before` to `image`, and stores the difference from the previous one in `slot`.
    ///
    /// The first `stored` slots are then in use.
    pub fn observe(
        &mut self,
        slot: Option<usize>,
        stored: usize,
        before: &[f64],
        image: &[f64],
    ) -> HistoryProducts {
        let change = || image.iter().zip(before).zip(&self.weight).map(|((g, r), w)| (g - r) * w);
        if let Some(slot) = slot {
            set(&mut self.changes[slot], change().zip(&self.change).map(|(new, old)| new - old));
            set(&mut self.images[slot], image.iter().zip(&self.image).map(|(new, old)| new - old));
        }
        set(&mut self.change, change());
        set(&mut self.image, image.iter().copied());
        let mut products = HistoryProducts {
            change_squared: dot(&self.change, &self.change),
            ..HistoryProducts::default()
        };
        for k in 0..stored {
            products.current[k] = dot(&self.changes[k], &self.change);
            products.newest[k] =
                slot.map_or(0.0, |slot| dot(&self.changes[k], &self.changes[slot]));
        }
        products
    }

    /// Writes the last image minus the combination of its differences to `mixed` `[n]`.
    pub fn combine(&self, coefficients: &[f64; DEPTH], mixed: &mut Vec<f64>) {
        set(mixed, self.image.iter().copied());
        let used = coefficients.iter().zip(&self.images).filter(|(c, _)| **c != 0.0);
        for (coefficient, difference) in used {
            for (p, d) in mixed.iter_mut().zip(difference) {
                *p -= d * coefficient;
            }
        }
    }
}

fn set(to: &mut Vec<f64>, from: impl Iterator<Item = f64>) {
    to.clear();
    to.extend(from);
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((rows_a, rest_a), (rows_b, rest_b)) = (a.as_chunks::<ROW>(), b.as_chunks::<ROW>());
    let mut sums = [0.0; ROW];
    for (a, b) in rows_a.iter().zip(rows_b) {
        for k in 0..ROW {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f64 = rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}
