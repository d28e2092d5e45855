//! Figures of single phases of the cycle: forces on a body, work of the contacts.

use crate::quantities::Quantity as Q;
use crate::record::{Column, StepRow};
use crate::statistics::{MovingMean, Statistics, norm};
use ballast::track::TampingPhase;
use serde_json::{Value, json};
use std::iter::Sum;

/// Energies of the contacts over some steps, J.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ContactWork {
    /// Complementarity gap (T-44).
    pub gap: f64,
    /// Infeasible part beside the gap (T-44).
    pub infeasible: f64,
    /// Dissipated energy (T-14).
    pub dissipated: f64,
}

impl ContactWork {
    /// Adds a step that has dissipated `dissipated` (J).
    pub(crate) fn take(&mut self, row: &StepRow, dissipated: f64) {
        self.gap += row.get(Column::ComplementarityGap);
        self.infeasible += row.get(Column::InfeasibleWork);
        self.dissipated += dissipated;
    }

    /// Returns gap and infeasible part over the dissipated energy (T-44); `None` if nothing was dissipated.
    pub fn error(&self) -> Option<f64> {
        (self.dissipated > 0.0).then(|| (self.gap + self.infeasible) / self.dissipated)
    }
}

impl Sum for ContactWork {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        parts.fold(Self::default(), |sum, part| Self {
            gap: sum.gap + part.gap,
            infeasible: sum.infeasible + part.infeasible,
            dissipated: sum.dissipated + part.dissipated,
        })
    }
}

/// Force in one phase of the cycle, N.
#[derive(Debug, Clone)]
pub struct PhaseForce {
    phase: TampingPhase,
    /// Force magnitudes of single steps, N.
    pub single: Statistics,
    sum: [f64; 3],
    /// Largest force averaged over a vibration period within the phase, N.
    pub period_peak: Option<f64>,
    recent: MovingMean,
}

impl PhaseForce {
    pub(crate) fn of(phase: TampingPhase, period: usize) -> Self {
        let recent = MovingMean::new(period);
        Self { phase, single: Statistics::default(), sum: [0.0; 3], period_peak: None, recent }
    }

    pub(crate) fn take(&mut self, phase: TampingPhase, force: [f64; 3]) {
        if phase != self.phase {
            // Periods end with the phase.
            return self.recent.clear();
        }
        self.single.take(norm(force));
        self.sum = std::array::from_fn(|k| self.sum[k] + force[k]);
        if let Some(mean) = self.recent.take(force) {
            self.period_peak = larger(self.period_peak, norm(mean));
        }
    }

    /// Returns the mean of the force magnitudes, N; `None` before the phase.
    pub fn mean_magnitude(&self) -> Option<f64> {
        (!self.single.is_empty()).then(|| self.single.mean())
    }

    /// Returns the magnitude of the mean force vector, N; `None` before the phase.
    fn mean_vector_norm(&self) -> Option<f64> {
        (!self.single.is_empty()).then(|| norm(self.sum) / self.single.count() as f64)
    }

    pub(crate) fn json(&self) -> Value {
        json!({
            (Q::MeanForceMagnitude.key()): self.mean_magnitude(),
            (Q::MeanForceVectorNorm.key()): self.mean_vector_norm(),
            (Q::PeakForce.key()): (!self.single.is_empty()).then(|| self.single.max()),
            (Q::PeakPeriodAveragedForce.key()): self.period_peak,
        })
    }
}

/// Returns the larger of `most` and `value`: `value` where there is no `most`.
pub(crate) fn larger(most: Option<f64>, value: f64) -> Option<f64> {
    Some(most.map_or(value, |most| most.max(value)))
}
