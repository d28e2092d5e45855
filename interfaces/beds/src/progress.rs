//! Progress of a bed preparation as a fraction.

use ballast::track::{DepositProgress, DepositStage};
use std::cmp::Ordering;

/// Stages, and the fraction of the whole that each usually takes.
const STAGES: [(DepositStage, f64); 4] = [
    (DepositStage::Pour, 0.35),
    (DepositStage::Fill, 0.45),
    (DepositStage::Trim, 0.1),
    (DepositStage::Rest, 0.1),
];
/// Stages with traffic over the bed, and their fractions.
const STAGES_WITH_TRAFFIC: [(DepositStage, f64); 6] = [
    (DepositStage::Pour, 0.1),
    (DepositStage::Fill, 0.15),
    (DepositStage::Trim, 0.05),
    (DepositStage::Traffic, 0.6),
    (DepositStage::Refill, 0.08),
    (DepositStage::Rest, 0.02),
];
/// Fraction of a stage that the fall of its grains counts for.
const FALL_FRACTION: f64 = 0.3;
/// Fraction of a stage's maximum steps that the fall usually takes.
const FALL_STEPS: f64 = 0.05;

/// Estimate of the progress of a bed preparation.
///
/// The duration of a stage is not known beforehand, only its maximum. Once the grains lie, their mean speed
/// decays about exponentially to the speed that counts as rest, so its logarithm estimates the progress of a stage. The
/// fractions of stages and of the fall are guesses from the beds of the examples.
#[derive(Debug, Default)]
pub struct PreparationProgress {
    stage: Option<DepositStage>,
    /// Maximum mean speed of this stage so far, m/s.
    max_speed: f64,
    /// Finished fraction of this stage.
    within: f64,
}

impl PreparationProgress {
    /// Takes a step of the preparation into account and returns the finished fraction (0 to 1), which never decreases.
    pub fn update(&mut self, done: &DepositProgress) -> f64 {
        if self.stage != Some(done.stage) {
            *self = Self { stage: Some(done.stage), ..Self::default() };
        }
        self.max_speed = self.max_speed.max(done.mean_speed);
        let steps = done.step as f64 / done.most_steps.max(1) as f64;
        let total_decay = (self.max_speed / done.rest_speed).ln();
        let decay = if total_decay > 0.0 {
            (self.max_speed / done.mean_speed).ln() / total_decay
        } else {
            1.0
        };
        // A stage that begins at rest has not ended: its grains may still have to fall.
        let confidence = (done.step as f64 / done.least_steps.max(1) as f64).min(1.0);
        let fallen = FALL_FRACTION * (steps / FALL_STEPS).min(1.0);
        let settled = (1.0 - FALL_FRACTION) * decay.clamp(0.0, 1.0) * confidence;
        let settled = if done.stage == DepositStage::Traffic { steps } else { fallen + settled };
        self.within = self.within.max(settled).max(steps).min(1.0);
        let finished = |(stage, fraction): (DepositStage, f64)| match stage.cmp(&done.stage) {
            Ordering::Less => fraction,
            Ordering::Equal => fraction * self.within,
            Ordering::Greater => 0.0,
        };
        let stages: &[_] = if done.has_traffic { &STAGES_WITH_TRAFFIC } else { &STAGES };
        stages.iter().copied().map(finished).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn progress_at(stage: DepositStage, step: u64, mean_speed: f64) -> DepositProgress {
        DepositProgress {
            stage,
            has_traffic: false,
            step,
            least_steps: 50,
            most_steps: 2000,
            grains: 1,
            contacts: 1,
            mean_speed,
            rest_speed: 5e-3,
            mean_penetration: 0.0,
            max_penetration: 0.0,
        }
    }

    /// Mean speed of grains that fall for a hundred steps and come to rest within three hundred more.
    fn speed(step: u64) -> f64 {
        if step <= 100 { 5e-3 * step as f64 } else { 0.5 * (-(step as f64 - 100.0) / 65.0).exp() }
    }

    #[test]
    fn progress_is_nearly_linear_in_the_steps() {
        let mut progress = PreparationProgress::default();
        let fractions: Vec<f64> = (1..=400)
            .map(|i| progress.update(&progress_at(DepositStage::Pour, i, speed(i))))
            .collect();
        assert!(fractions.is_sorted());
        for (i, fraction) in fractions.iter().enumerate() {
            let linear = 0.35 * (i + 1) as f64 / 400.0;
            assert!(
                (fraction - linear).abs() < 0.05,
                "step {}: {fraction}, linear {linear}",
                i + 1
            );
        }
    }

    #[test]
    fn progress_never_decreases_and_ends_at_one() {
        let mut progress = PreparationProgress::default();
        let mut last = 0.0;
        for (stage, _) in STAGES {
            // A stage that begins at rest, one that stands still, one that does not come to rest in time.
            for (step, speed) in [(1, 1e-3), (2, 0.0), (500, 0.4), (501, 0.5), (2000, 0.1)] {
                let fraction = progress.update(&progress_at(stage, step, speed));
                assert!(fraction >= last && fraction <= 1.0 + 1e-12, "{fraction} after {last}");
                last = fraction;
            }
        }
        assert!((last - 1.0).abs() < 1e-12);
    }
}
