//! What each tine pair does in a squeeze: onset of contact, peak force, closing, compaction energy,
//! force-displacement loop.
//!
//! Reads: the steps' reactions of the tines. Writes: its own records. Cost: O(tines) per step.
//! Contract: measuring changes nothing. Signs: a force is positive when the ballast resists closing.
//!
//! Loops and energies tell worn ballast from good: both are those of published squeeze tests.

use crate::error::{Error, Result};
use crate::step::StepReport;

/// The tines of a pair: index among the driven bodies, and closing direction along x, +1 or -1.
pub type PairTines = Vec<(usize, f64)>;

/// What is known of the squeeze of one pair.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SqueezeRecord {
    /// Time since the meter began at which the ballast first resisted above the threshold, s.
    pub onset: Option<f64>,
    /// Closing of a side at the onset, m.
    pub onset_closing: f64,
    /// Largest mean force over a window, N, and the closing at which it occurred, m.
    pub peak_force: f64,
    pub peak_closing: f64,
    /// Largest force of a single step, N: peaks of the vibration included.
    pub peak_step_force: f64,
    /// Closing of a side at the last step, m.
    pub closing: f64,
    /// Work of the pair's tines on the ballast, all directions, J.
    pub work: f64,
    /// Work of the mean force along the closing, J: the area under the loop, both sides.
    pub compaction_energy: f64,
    /// The loop: closing of a side (m) and mean force of a side (N), one point per window.
    pub loop_points: Vec<[f64; 2]>,
}

/// Accumulates the squeeze of every pair of a machine.
#[derive(Debug, Clone, PartialEq)]
pub struct SqueezeMeter {
    pairs: Vec<PairTines>,
    /// Steps in a window: a vibration period.
    window: u32,
    /// Force above which the ballast counts as touched, N.
    threshold: f64,
    time: f64,
    /// Force summed over the steps of the current window `[np]`, N.
    sum: Vec<f64>,
    /// Closing and mean force at the end of the last window `[np]`.
    last: Vec<Option<[f64; 2]>>,
    in_window: u32,
    records: Vec<SqueezeRecord>,
}

impl SqueezeMeter {
    /// A meter for the given pairs; forces are averaged over `window` steps, a vibration period.
    ///
    /// # Errors
    /// A pair without tines, a direction that is not ±1, or a window of no steps.
    pub fn new(pairs: Vec<PairTines>, window: u32, threshold: f64) -> Result<Self> {
        let refused = |place: String, expected: &str, found: String| {
            Err(Error::Input { place, expected: expected.into(), found })
        };
        if window == 0 {
            return refused("window of the squeeze".into(), "at least one step", "0".into());
        }
        for (p, pair) in pairs.iter().enumerate() {
            if pair.is_empty() || pair.iter().any(|t| t.1.abs() != 1.0) {
                let found = format!("{pair:?}");
                return refused(format!("tine pair {p}"), "tines of direction +1 or -1", found);
            }
        }
        let n = pairs.len();
        Ok(Self {
            pairs,
            window,
            threshold,
            time: 0.0,
            sum: vec![0.0; n],
            last: vec![None; n],
            in_window: 0,
            records: vec![SqueezeRecord::default(); n],
        })
    }

    /// Takes one step of `h` seconds, at whose end each side of pair `p` has closed by
    /// `closing[p]` (m).
    ///
    /// # Errors
    /// Closings or reactions that do not fit the pairs.
    pub fn record(&mut self, report: &StepReport, closing: &[f64], h: f64) -> Result<()> {
        let bodies = self.pairs.iter().flatten().map(|t| t.0 + 1).max().unwrap_or(0);
        if closing.len() != self.pairs.len() || report.reactions.len() < bodies {
            return Err(Error::Input {
                place: "squeeze".into(),
                expected: format!("{} closings, {bodies} reactions", self.pairs.len()),
                found: format!("{} and {}", closing.len(), report.reactions.len()),
            });
        }
        self.time += h;
        self.in_window += 1;
        let window_ends = self.in_window == self.window;
        for p in 0..self.pairs.len() {
            let force = side_force(&self.pairs[p], report, h);
            self.sum[p] += force;
            let record = &mut self.records[p];
            if record.onset.is_none() && force > self.threshold {
                record.onset = Some(self.time);
                record.onset_closing = closing[p];
            }
            record.peak_step_force = record.peak_step_force.max(force);
            record.work += self.pairs[p].iter().map(|t| report.reactions[t.0].work).sum::<f64>();
            record.closing = closing[p];
            if window_ends {
                self.end_window(p, closing[p]);
            }
        }
        if window_ends {
            self.in_window = 0;
        }
        Ok(())
    }

    fn end_window(&mut self, p: usize, closing: f64) {
        let force = self.sum[p] / f64::from(self.window);
        self.sum[p] = 0.0;
        let record = &mut self.records[p];
        if force > record.peak_force {
            record.peak_force = force;
            record.peak_closing = closing;
        }
        if let Some([closed, before]) = self.last[p] {
            let sides = sides(&self.pairs[p]);
            record.compaction_energy += sides * 0.5 * (before + force) * (closing - closed);
        }
        self.last[p] = Some([closing, force]);
        record.loop_points.push([closing, force]);
    }

    /// The records of the pairs so far.
    pub fn records(&self) -> &[SqueezeRecord] {
        &self.records
    }
}

/// Number of sides a pair closes from: one or two.
fn sides(pair: &PairTines) -> f64 {
    [1.0, -1.0].into_iter().filter(|d| pair.iter().any(|t| t.1 == *d)).count() as f64
}

/// Resistance along the closing, N: summed over the tines of a side, averaged over the sides.
pub(crate) fn side_force(pair: &PairTines, report: &StepReport, h: f64) -> f64 {
    let resistance: f64 = pair.iter().map(|t| -t.1 * report.reactions[t.0].impulse.x).sum();
    resistance / (h * sides(pair))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::step::Reaction;

    const H: f64 = 1e-3;

    /// Both tines of a facing pair are resisted by `force` and do `work` each.
    fn report(force: f64, work: f64) -> StepReport {
        let reaction =
            |x: f64| Reaction { impulse: Vec3::new(x * H, 5.0, 7.0), work, ..Reaction::default() };
        let reactions = vec![Reaction::default(), reaction(-force), reaction(force)];
        StepReport { reactions, ..StepReport::default() }
    }

    fn meter(window: u32) -> SqueezeMeter {
        SqueezeMeter::new(vec![vec![(1, 1.0), (2, -1.0)]], window, 10.0).unwrap()
    }

    #[test]
    fn a_linear_spring_gives_its_own_loop_and_energy() {
        // 200 kN/m per side after 10 mm of free way; 0.05 mm per step; vibration of one window.
        let mut meter = meter(10);
        let stiffness = 2e5;
        for i in 1..=1000 {
            let closing = i as f64 * 5e-5;
            let vibration = 30.0 * (i as f64 * 0.1 * std::f64::consts::TAU).sin();
            let spring = stiffness * (closing - 0.01_f64).max(0.0);
            let felt = if spring > 0.0 { spring + vibration } else { 0.0 };
            meter.record(&report(felt, 0.25), &[closing], H).unwrap();
        }
        let record = &meter.records()[0];
        assert!((record.onset_closing - 0.01005).abs() < 1e-4, "{}", record.onset_closing);
        assert!((record.onset.unwrap() - 0.201).abs() < 2e-3);
        assert!((record.closing - 0.05).abs() < 1e-12);
        // The mean over the last window lags by half a window: 4.5 steps of 10 N.
        assert!((record.peak_force - (8000.0 - 45.0)).abs() < 1e-6, "{}", record.peak_force);
        assert!((record.peak_closing - 0.05).abs() < 1e-12);
        assert!((record.peak_step_force - 8000.0).abs() < 30.0);
        assert!((record.work - 500.0).abs() < 1e-9);
        // Two sides of k x²/2 = 160 J each; lag of half a window takes 45 N x 40 mm x 2 = 3.6 J.
        assert!((record.compaction_energy - 316.4).abs() < 0.2, "{}", record.compaction_energy);
        assert_eq!(record.loop_points.len(), 100);
    }

    #[test]
    fn an_unloading_closes_the_loop() {
        let mut meter = meter(1);
        let there = (0..=100).map(|i| (i as f64 * 1e-4, 1000.0));
        let back = (0..=100).rev().map(|i| (i as f64 * 1e-4, 400.0));
        for (closing, force) in there.chain(back) {
            meter.record(&report(force, 0.0), &[closing], H).unwrap();
        }
        // Width 600 N, length 10 mm, two sides; the fall from 1000 to 400 N is at constant closing.
        let found = meter.records()[0].compaction_energy;
        assert!((found - 12.0).abs() < 1e-9, "{found}");
    }

    #[test]
    fn tines_on_one_arm_add_up_and_what_does_not_fit_is_refused() {
        let mut arm = SqueezeMeter::new(vec![vec![(1, 1.0)], vec![(2, -1.0)]], 1, 0.0).unwrap();
        arm.record(&report(700.0, 0.0), &[0.0, 0.0], H).unwrap();
        assert!((arm.records()[0].peak_force - 700.0).abs() < 1e-9);
        assert!((arm.records()[1].peak_force - 700.0).abs() < 1e-9);
        assert!(arm.record(&report(1.0, 0.0), &[0.0], H).is_err());
        assert!(SqueezeMeter::new(vec![vec![]], 1, 0.0).is_err());
        assert!(SqueezeMeter::new(vec![vec![(1, 0.5)]], 1, 0.0).is_err());
        assert!(SqueezeMeter::new(vec![vec![(1, 1.0)]], 0, 0.0).is_err());
    }
}
