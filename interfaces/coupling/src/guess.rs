//! Guesses of the motion from the iterations of a window.

use crate::settings::CouplingAcceleration;
use nalgebra::{DMatrix, DVector};

/// Number of windows whose differences IQN-ILS uses besides those of the current one.
const REUSED_WINDOWS: usize = 3;
/// Fraction of a column of differences that must be independent of the newer columns.
const MIN_INDEPENDENT: f64 = 0.01;
/// Maximum number of differences of a window: then IQN-ILS starts again from a relaxed guess, because contact forces jump and
/// older differences mislead it.
const MAX_DIFFERENCES: usize = 15;

/// Difference between two iterations.
#[derive(Clone)]
struct IterationDifference {
    residual: DVector<f64>,
    answer: DVector<f64>,
}

/// Guesses of the motion, as vectors in m.
pub(crate) struct MotionGuess {
    acceleration: CouplingAcceleration,
    relaxation: f64,
    factor: f64,
    /// Differences of the last windows, newest first.
    reused: Vec<Vec<IterationDifference>>,
    /// Differences of the current window, newest first.
    differences: Vec<IterationDifference>,
    last: Option<IterationDifference>,
}

impl MotionGuess {
    pub fn new(acceleration: CouplingAcceleration, relaxation: f64) -> Self {
        Self {
            acceleration,
            relaxation,
            factor: relaxation,
            reused: vec![],
            differences: vec![],
            last: None,
        }
    }

    pub fn begin_window(&mut self) {
        if !self.differences.is_empty() {
            self.reused.insert(0, std::mem::take(&mut self.differences));
            self.reused.truncate(REUSED_WINDOWS);
        }
        self.last = None;
    }

    /// Forgets the differences, which have led too far.
    pub fn forget(&mut self) {
        self.reused.clear();
        self.differences.clear();
    }

    /// Returns the next guess after the ballast followed one motion and the partner answered with another.
    pub fn next(&mut self, followed: &DVector<f64>, answer: &DVector<f64>) -> DVector<f64> {
        let residual = answer - followed;
        let here = IterationDifference { residual: residual.clone(), answer: answer.clone() };
        let before = self.last.replace(here);
        if let Some(before) = &before {
            let difference = IterationDifference {
                residual: &residual - &before.residual,
                answer: answer - &before.answer,
            };
            self.differences.insert(0, difference);
        }
        match (self.acceleration, before) {
            (CouplingAcceleration::IqnIls, _) if self.differences.len() > MAX_DIFFERENCES => {
                self.forget();
                self.factor = self.relaxation;
            }
            (CouplingAcceleration::IqnIls, _) => {
                if let Some(change) = self.quasi_newton_change(&residual) {
                    return answer + change;
                }
                self.factor = self.relaxation;
            }
            (CouplingAcceleration::Aitken, Some(before)) => {
                let change = &residual - &before.residual;
                self.factor *= -before.residual.dot(&change) / change.norm_squared().max(1e-300);
                self.factor = self.factor.abs().min(1.0).copysign(self.factor);
            }
            _ => self.factor = self.relaxation,
        }
        followed + self.factor * residual
    }

    /// Returns the change of the answer at which the residual is smallest; `None` without differences.
    fn quasi_newton_change(&self, residual: &DVector<f64>) -> Option<DVector<f64>> {
        let columns =
            select_independent(self.differences.iter().chain(self.reused.iter().flatten()));
        if columns.is_empty() {
            return None;
        }
        let matrix = |part: fn(&IterationDifference) -> &DVector<f64>| {
            DMatrix::from_columns(&columns.iter().map(|c| part(c).clone()).collect::<Vec<_>>())
        };
        let svd = matrix(|c| &c.residual).svd(true, true);
        let size = residual.len().max(columns.len()) as f64;
        let zero = f64::EPSILON * size * svd.singular_values.max();
        let weights = svd.solve(&-residual, zero).ok()?;
        Some(matrix(|c| &c.answer) * weights)
    }
}

/// Returns the columns whose residuals are independent of those of the newer columns.
fn select_independent<'a>(
    columns: impl Iterator<Item = &'a IterationDifference>,
) -> Vec<&'a IterationDifference> {
    let mut kept = Vec::new();
    let mut basis: Vec<DVector<f64>> = Vec::new();
    for column in columns {
        let mut rest = column.residual.clone();
        for direction in &basis {
            let along = direction.dot(&rest);
            rest.axpy(-along, direction, 1.0);
        }
        let size = rest.norm();
        if size > MIN_INDEPENDENT * column.residual.norm() {
            basis.push(rest / size);
            kept.push(column);
        }
    }
    kept
}
