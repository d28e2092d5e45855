//! Anderson's acceleration of a sweep `r → g(r)` (T-32).

use crate::math::Vec3;
use nalgebra::{Cholesky, DMatrix, DVector};

/// Keeps the normal equations solvable when steps repeat each other.
const RIDGE: f64 = 1e-10;

/// The last steps of the iteration.
pub(super) struct Memory {
    window: usize,
    /// Root of each contact's own W `[nc]`: what makes changes of impulses comparable.
    weight: Vec<f64>,
    /// Differences of the weighted change `f = g(r) - r`, and of `g(r)`; the newest takes the oldest's place.
    changes: Vec<Vec<Vec3>>,
    images: Vec<Vec<Vec3>>,
    gram: DMatrix<f64>,
    newest: usize,
    last: Option<(Vec<Vec3>, Vec<Vec3>)>,
}

impl Memory {
    pub fn new(window: usize, weight: Vec<f64>) -> Self {
        let gram = DMatrix::zeros(window, window);
        Self { window, weight, changes: vec![], images: vec![], gram, newest: 0, last: None }
    }

    pub fn forget(&mut self) {
        self.changes.clear();
        self.images.clear();
        self.last = None;
    }

    /// The combination of the last images whose change would be least if all were linear, and the
    /// norm of the present change.
    pub fn next_point(&mut self, r: &[Vec3], image: &[Vec3]) -> (Vec<Vec3>, f64) {
        let change: Vec<Vec3> =
            image.iter().zip(r).zip(&self.weight).map(|((g, r), w)| (g - r) * *w).collect();
        let norm = dot(&change, &change).sqrt();
        if let Some((last_change, last_image)) = self.last.take() {
            self.remember(difference(&change, &last_change), difference(image, &last_image));
        }
        let m = self.changes.len();
        let mut point = image.to_vec();
        let mut gram = self.gram.view((0, 0), (m, m)).into_owned();
        for k in 0..m {
            gram[(k, k)] *= 1.0 + RIDGE;
        }
        let right = DVector::from_fn(m, |k, _| dot(&self.changes[k], &change));
        if let Some(factor) = Cholesky::new(gram).filter(|_| m > 0) {
            for (share, past) in factor.solve(&right).iter().zip(&self.images) {
                for (p, d) in point.iter_mut().zip(past) {
                    *p -= d * *share;
                }
            }
        }
        self.last = Some((change, image.to_vec()));
        // Impulses that are not finite would stay so.
        let usable = point.iter().all(|p| p.iter().all(|x| x.is_finite()));
        (if usable { point } else { image.to_vec() }, norm)
    }

    fn remember(&mut self, change: Vec<Vec3>, image: Vec<Vec3>) {
        if self.changes.len() < self.window {
            self.newest = self.changes.len();
            self.changes.push(change);
            self.images.push(image);
        } else {
            self.newest = (self.newest + 1) % self.window;
            self.changes[self.newest] = change;
            self.images[self.newest] = image;
        }
        for k in 0..self.changes.len() {
            let product = dot(&self.changes[k], &self.changes[self.newest]);
            self.gram[(k, self.newest)] = product;
            self.gram[(self.newest, k)] = product;
        }
    }
}

fn dot(a: &[Vec3], b: &[Vec3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

fn difference(a: &[Vec3], b: &[Vec3]) -> Vec<Vec3> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}
