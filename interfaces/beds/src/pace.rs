//! How far a preparation is.

use ballast::track::{DepositProgress, DepositStage};
use std::cmp::Ordering;

/// The stages, and what share of the whole each usually takes.
const STAGES: [(DepositStage, f64); 4] = [
    (DepositStage::Pour, 0.35),
    (DepositStage::Fill, 0.45),
    (DepositStage::Trim, 0.1),
    (DepositStage::Rest, 0.1),
];
/// Share of a stage until its grains have reached their greatest speed, and of its most steps that this usually takes.
const FALL: f64 = 0.3;
const FALL_STEPS: f64 = 0.05;

/// Follows a preparation and says what share of it is done.
///
/// How long a stage takes is not known beforehand, only how long it may take. Once the grains lie, their mean speed
/// decays about exponentially to the one that counts as rest, so its logarithm says where a stage is; shares of the
/// stages and of falling are guesses, from how the examples' beds came about.
#[derive(Debug, Default)]
pub struct Pace {
    stage: Option<DepositStage>,
    /// Of this stage: greatest mean speed, m/s, and the share that is done.
    fastest: f64,
    within: f64,
}

impl Pace {
    /// Share of the preparation that is done (0 to 1), which never falls.
    pub fn share(&mut self, done: &DepositProgress) -> f64 {
        if self.stage != Some(done.stage) {
            *self = Self { stage: Some(done.stage), ..Self::default() };
        }
        self.fastest = self.fastest.max(done.mean_speed);
        let steps = done.step as f64 / done.most_steps.max(1) as f64;
        let way = (self.fastest / done.rest_speed).ln();
        let decay = if way > 0.0 { (self.fastest / done.mean_speed).ln() / way } else { 1.0 };
        // One that begins at rest is not over: its grains may still have to fall.
        let sure = (done.step as f64 / done.least_steps.max(1) as f64).min(1.0);
        let fallen = FALL * (steps / FALL_STEPS).min(1.0);
        let rested = (1.0 - FALL) * decay.clamp(0.0, 1.0) * sure;
        self.within = self.within.max(fallen + rested).max(steps).min(1.0);
        let part = |(stage, share): (DepositStage, f64)| match stage.cmp(&done.stage) {
            Ordering::Less => share,
            Ordering::Equal => share * self.within,
            Ordering::Greater => 0.0,
        };
        STAGES.map(part).iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(stage: DepositStage, step: u64, mean_speed: f64) -> DepositProgress {
        DepositProgress {
            stage,
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

    /// Grains that fall for a hundred steps and come to rest within three hundred more.
    fn speed(step: u64) -> f64 {
        if step <= 100 { 5e-3 * step as f64 } else { 0.5 * (-(step as f64 - 100.0) / 65.0).exp() }
    }

    #[test]
    fn a_preparation_gets_on_at_an_even_pace() {
        let mut pace = Pace::default();
        let shares: Vec<f64> =
            (1..=400).map(|i| pace.share(&after(DepositStage::Pour, i, speed(i)))).collect();
        assert!(shares.is_sorted());
        for (i, share) in shares.iter().enumerate() {
            let even = 0.35 * (i + 1) as f64 / 400.0;
            assert!((share - even).abs() < 0.05, "step {}: {share}, evenly {even}", i + 1);
        }
    }

    #[test]
    fn the_share_never_falls_and_ends_at_one() {
        let mut pace = Pace::default();
        let mut last = 0.0;
        for (stage, _) in STAGES {
            // One that begins at rest, one that stands still, one that does not come to rest in time.
            for (step, speed) in [(1, 1e-3), (2, 0.0), (500, 0.4), (501, 0.5), (2000, 0.1)] {
                let share = pace.share(&after(stage, step, speed));
                assert!(share >= last && share <= 1.0 + 1e-12, "{share} after {last}");
                last = share;
            }
        }
        assert!((last - 1.0).abs() < 1e-12);
    }
}
