//! The last steps of one set's impulses.

use super::{Products, WINDOW};

/// Numbers that are added side by side.
const ROW: usize = 8;

/// What a set remembers: of the iteration's change `f = D (g(r) - r)` and image `g(r)` the last
/// values and differences, numbers of all its impulses end to end `[n]`.
#[derive(Debug, Default)]
pub struct History {
    /// D: what makes changes of impulses comparable.
    weight: Vec<f64>,
    change: Vec<f64>,
    image: Vec<f64>,
    changes: [Vec<f64>; WINDOW],
    images: [Vec<f64>; WINDOW],
}

impl History {
    /// Forgets everything, and takes the weights `[n]` from now on.
    pub fn begin(&mut self, weight: impl IntoIterator<Item = f64>) {
        self.weight.clear();
        self.weight.extend(weight);
    }

    /// Takes in that the iteration went from `before` to `image`, and puts the difference to the last
    /// time into `slot`; the first `remembered` slots are in use then.
    pub fn observe(
        &mut self,
        slot: Option<usize>,
        remembered: usize,
        before: &[f64],
        image: &[f64],
    ) -> Products {
        let change = || image.iter().zip(before).zip(&self.weight).map(|((g, r), w)| (g - r) * w);
        if let Some(slot) = slot {
            set(&mut self.changes[slot], change().zip(&self.change).map(|(new, old)| new - old));
            set(&mut self.images[slot], image.iter().zip(&self.image).map(|(new, old)| new - old));
        }
        set(&mut self.change, change());
        set(&mut self.image, image.iter().copied());
        let mut products =
            Products { change_squared: dot(&self.change, &self.change), ..Products::default() };
        for k in 0..remembered {
            products.present[k] = dot(&self.changes[k], &self.change);
            products.newest[k] =
                slot.map_or(0.0, |slot| dot(&self.changes[k], &self.changes[slot]));
        }
        products
    }

    /// The last image less the given shares of the differences: the point to go on from, in `point` `[n]`.
    pub fn combine(&self, shares: &[f64; WINDOW], point: &mut Vec<f64>) {
        set(point, self.image.iter().copied());
        for (share, past) in shares.iter().zip(&self.images).filter(|(share, _)| **share != 0.0) {
            for (p, d) in point.iter_mut().zip(past) {
                *p -= d * share;
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
