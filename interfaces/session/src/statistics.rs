//! Means, extremes and quartiles of series of values.

use serde_json::{Value, json};

/// Number, mean and largest value of a series.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Statistics {
    count: u64,
    sum: f64,
    max: Option<f64>,
}

impl Statistics {
    /// Adds a value.
    pub fn take(&mut self, value: f64) {
        self.count += 1;
        self.sum += value;
        self.max = Some(self.max.map_or(value, |max| max.max(value)));
    }

    /// Number of values.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Mean; 0 without values.
    pub fn mean(&self) -> f64 {
        if self.count == 0 { 0.0 } else { self.sum / self.count as f64 }
    }

    /// Largest value; 0 without values.
    pub fn max(&self) -> f64 {
        self.max.unwrap_or(0.0)
    }

    /// Returns true if there are no values.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Returns mean and maximum as JSON; null without values.
    pub fn json(&self) -> Value {
        let mean = (!self.is_empty()).then(|| self.mean());
        json!({ "mean": mean, "max": self.max })
    }
}

/// Median and quartiles.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Quartiles {
    /// Lower quartile.
    pub low: f64,
    /// Median.
    pub median: f64,
    /// Upper quartile.
    pub high: f64,
}

impl Quartiles {
    /// Returns the quartiles of values in any order, interpolated linearly; zeros without values.
    pub fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let Some(last) = sorted.len().checked_sub(1) else { return Self::default() };
        let at = |fraction: f64| {
            let position = fraction * last as f64;
            let below = sorted[position as usize];
            let above = sorted[position.ceil() as usize];
            below + (above - below) * position.fract()
        };
        Self { low: at(0.25), median: at(0.5), high: at(0.75) }
    }
}

/// Moving mean of vectors, for peaks that are not single impacts.
#[derive(Debug, Clone)]
pub struct MovingMean {
    window: Vec<[f64; 3]>,
    next: usize,
    filled: usize,
}

impl MovingMean {
    /// Creates a mean over `length` values, at least one.
    pub fn new(length: usize) -> Self {
        Self { window: vec![[0.0; 3]; length.max(1)], next: 0, filled: 0 }
    }

    /// Removes all values.
    pub fn clear(&mut self) {
        self.next = 0;
        self.filled = 0;
    }

    /// Adds a value and returns the mean, `None` until the window is full.
    pub fn take(&mut self, value: [f64; 3]) -> Option<[f64; 3]> {
        self.window[self.next] = value;
        self.next = (self.next + 1) % self.window.len();
        self.filled = (self.filled + 1).min(self.window.len());
        // A running sum would keep the rounding errors of earlier values.
        (self.filled == self.window.len()).then(|| {
            let sum =
                self.window.iter().fold([0.0; 3], |s, v| [s[0] + v[0], s[1] + v[1], s[2] + v[2]]);
            sum.map(|s| s / self.window.len() as f64)
        })
    }
}

/// Euclidean norm of `v`.
pub fn norm(v: [f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_of_negative_values() {
        let mut s = Statistics::default();
        assert_eq!((s.mean(), s.max()), (0.0, 0.0));
        s.take(-4.0);
        s.take(-2.0);
        assert_eq!((s.mean(), s.max()), (-3.0, -2.0));
    }

    #[test]
    fn quartiles_are_interpolated() {
        let of = |values: &[f64]| {
            let q = Quartiles::of(values);
            [q.low, q.median, q.high]
        };
        assert_eq!(of(&[4.0, 1.0, 3.0, 2.0]), [1.75, 2.5, 3.25]);
        assert_eq!(of(&[7.0]), [7.0; 3]);
        assert_eq!(of(&[]), [0.0; 3]);
    }

    #[test]
    fn moving_mean_needs_a_full_window() {
        let mut mean = MovingMean::new(2);
        assert_eq!(mean.take([1.0, 0.0, 0.0]), None);
        assert_eq!(mean.take([3.0, 0.0, 2.0]), Some([2.0, 0.0, 1.0]));
        assert_eq!(mean.take([5.0, 0.0, 0.0]), Some([4.0, 0.0, 1.0]));
    }
}
