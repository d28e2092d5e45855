//! Squeeze measurements of each tine pair: onset of contact, peak force, closing, compaction energy and
//! force-displacement loop.
//!
//! Reads: states, and the steps' reactions of the tines. Writes: its own records. Cost: O(tines) per step.
//! Contract: measuring changes nothing; results depend on the steps alone, not on the source of the tines' motion
//! or the window lengths. Signs: a force is positive when the ballast resists closing.
//!
//! A squeeze is detected from the motion of the tines, averaged over a vibration period. It begins at the widest
//! position before a pair closes by more than [`MIN_CLOSING`], and ends when the pair has opened by as much from its
//! narrowest position. Tines bend by some millimetres during insertion, so closing by ballast forces does not count
//! before a squeeze has begun.
//!
//! Loops and energies are those of published squeeze tests, which distinguish worn from good ballast.

use crate::error::{Error, Result};
use crate::model::Model;
use crate::state::State;
use crate::step::StepReport;
pub use crate::window_memory::SqueezeRecord;
use crate::window_memory::{MAX_LOOP_POINTS, PeriodSums, SqueezeTrack};
use std::sync::Arc;

/// Tines of a pair: index among the driven bodies, and closing direction along x, +1 or -1.
pub type PairTines = Vec<(usize, f64)>;

/// Minimum change of a side's period-averaged position that counts as closing or opening, m.
///
/// More than the remainder of a vibration of another frequency, and small against strokes of 20 to 100 mm.
pub const MIN_CLOSING: f64 = 2e-3;
/// Minimum period-averaged force of a side that counts as contact with the ballast, N.
///
/// A force of this size in closing direction pushes the pair together.
pub const MIN_CONTACT_FORCE: f64 = 100.0;
/// Pair of tines, or groups of tines, that close towards each other.
#[derive(Debug, Clone, PartialEq)]
pub struct SqueezePair {
    /// Name of the pair.
    pub name: String,
    /// Tines of the pair.
    pub tines: PairTines,
}

/// Tine pairs to measure, and the averaging period of their motion and forces.
#[derive(Debug, Clone, PartialEq)]
pub struct SqueezeRule {
    pairs: Vec<SqueezePair>,
    /// Number of steps of a vibration period.
    period: u32,
}

impl Default for SqueezeRule {
    /// Returns a rule without pairs.
    fn default() -> Self {
        Self { pairs: Vec::new(), period: 1 }
    }
}

impl SqueezeRule {
    /// Creates a rule for the given pairs and steps of a vibration period.
    ///
    /// # Errors
    /// [`Error::Input`] for a pair without tines, a direction that is not ±1, or a period of no steps.
    pub fn new(pairs: Vec<SqueezePair>, period: u32) -> Result<Self> {
        let refused = |place: String, expected: &str, found: String| {
            Err(Error::Input { place, expected: expected.into(), found })
        };
        if period == 0 {
            return refused("period of the squeeze".into(), "at least one step", "0".into());
        }
        for SqueezePair { name, tines } in &pairs {
            if tines.is_empty() || tines.iter().any(|t| t.1.abs() != 1.0) {
                let found = format!("{tines:?}");
                return refused(
                    format!("tine pair {name:?}"),
                    "tines of direction +1 or -1",
                    found,
                );
            }
        }
        Ok(Self { pairs, period })
    }
}

/// Squeeze in progress during a window.
#[derive(Debug, Clone, PartialEq)]
pub struct SqueezeOutcome {
    /// Name of the pair.
    pub name: String,
    /// True if the pair has opened again.
    pub is_finished: bool,
    /// Measurements of the squeeze.
    pub record: SqueezeRecord,
}

/// Meter that follows the pairs of a rule from step to step.
#[derive(Debug, Clone, PartialEq)]
pub struct SqueezeMeter {
    rule: Arc<SqueezeRule>,
    /// Progress of each pair.
    tracks: Vec<SqueezeTrack>,
    /// Squeezes that ended since the last [`SqueezeMeter::take_outcomes`].
    finished: Vec<SqueezeOutcome>,
}

/// Motion and load of a tine in a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TineStep {
    /// Position of the reference point at the end of the step, along x, m.
    pub position: f64,
    /// Impulse of the ballast on the tine, along x, N s.
    pub impulse: f64,
    /// Work of the tine on the ballast, J.
    pub work: f64,
}

impl SqueezeMeter {
    /// Creates a meter without measurements.
    pub fn new(rule: Arc<SqueezeRule>) -> Self {
        let tracks = vec![SqueezeTrack::default(); rule.pairs.len()];
        Self { rule, tracks, finished: Vec::new() }
    }

    /// Records the step that has led to `state`.
    pub fn record(&mut self, model: &Model, state: &State, report: &StepReport) {
        let ng = model.grains.len();
        self.record_step(state.time_ns, model.stepping.h(), |d| TineStep {
            position: state.position[ng + d].x,
            impulse: report.reactions[d].impulse.x,
            work: report.reactions[d].work,
        });
    }

    /// Records a step of length `h` (s) that ended at `time_ns`; `tine` returns the motion and load of a tine.
    pub fn record_step(&mut self, time_ns: u64, h: f64, tine: impl Fn(usize) -> TineStep) {
        for (pair, track) in self.rule.pairs.iter().zip(&mut self.tracks) {
            let tines = &pair.tines;
            let place = mean_closing(tines, |d| tine(d).position);
            let work = tines.iter().map(|t| tine(t.0).work).sum::<f64>();
            let force = side_force(tines, |d| tine(d).impulse, h);
            track.period.take(force, place, work);
            if track.period.steps < self.rule.period {
                continue;
            }
            if let Some(record) = track.end_period(sides(tines), time_ns) {
                self.finished.push(SqueezeOutcome {
                    name: pair.name.clone(),
                    is_finished: true,
                    record,
                });
            }
        }
    }

    /// Returns the squeezes that ended since the last call, and those in progress.
    pub fn take_outcomes(&mut self) -> Vec<SqueezeOutcome> {
        let mut outcomes = std::mem::take(&mut self.finished);
        let active = self.rule.pairs.iter().zip(&self.tracks).filter(|(_, t)| t.is_squeezing);
        outcomes.extend(active.map(|(pair, track)| SqueezeOutcome {
            name: pair.name.clone(),
            is_finished: false,
            record: track.record.clone(),
        }));
        outcomes
    }

    /// Returns a meter that continues from `tracks`; tracks of another number of pairs are dropped.
    pub fn resume(rule: Arc<SqueezeRule>, tracks: &[SqueezeTrack]) -> Self {
        if tracks.len() != rule.pairs.len() {
            return Self::new(rule);
        }
        Self { rule, tracks: tracks.to_vec(), finished: Vec::new() }
    }

    /// Returns the progress of each pair `[pairs]`.
    pub fn into_tracks(self) -> Vec<SqueezeTrack> {
        self.tracks
    }
}

impl PeriodSums {
    fn take(&mut self, force: f64, place: f64, work: f64) {
        self.peak_step_force =
            if self.steps == 0 { force } else { self.peak_step_force.max(force) };
        self.steps += 1;
        self.force += force;
        self.place += place;
        self.work += work;
    }
}

impl SqueezeTrack {
    /// Ends a period; returns the record of a squeeze that ends with it.
    fn end_period(&mut self, sides: f64, now_ns: u64) -> Option<SqueezeRecord> {
        let period = std::mem::take(&mut self.period);
        let steps = f64::from(period.steps);
        let (place, force) = (period.place / steps, period.force / steps);
        let is_pushed = force < -MIN_CONTACT_FORCE;
        let closing = match self.widest {
            Some(widest) if self.is_squeezing || (place > widest && !is_pushed) => place - widest,
            _ => {
                self.begin(&period, place, now_ns);
                return None;
            }
        };
        // Without opening: the elastic return is seen in a period or two alone.
        let further = (closing - self.farthest).max(0.0);
        self.record.compaction_energy += sides * 0.5 * (self.last_force + force) * further;
        self.farthest += further;
        self.record_period(&period, closing, force, now_ns);
        if !self.is_squeezing && closing > MIN_CLOSING {
            self.is_squeezing = true;
            self.count += 1;
            self.record.number = self.count;
        }
        if self.is_squeezing {
            self.record.work += period.work;
        }
        if closing >= self.farthest - MIN_CLOSING {
            return None;
        }
        let over = self.is_squeezing.then(|| std::mem::take(&mut self.record));
        self.begin(&period, place, now_ns);
        over
    }

    /// Starts a new record at the current, widest position.
    fn begin(&mut self, period: &PeriodSums, place: f64, now_ns: u64) {
        let count = self.count;
        *self = Self { count, widest: Some(place), per_point: 1, ..Self::default() };
        self.record.start_ns = now_ns;
        self.record_period(period, 0.0, period.force / f64::from(period.steps), now_ns);
    }

    /// Records forces and closing at the end of a period.
    fn record_period(&mut self, period: &PeriodSums, closing: f64, force: f64, now_ns: u64) {
        let record = &mut self.record;
        if force > MIN_CONTACT_FORCE && self.last_force <= MIN_CONTACT_FORCE {
            (record.onset_ns, record.onset_closing) = (Some(now_ns), closing);
        }
        if force > record.peak_force {
            (record.peak_force, record.peak_closing) = (force, closing);
        }
        record.peak_step_force = record.peak_step_force.max(period.peak_step_force);
        record.closing = closing;
        self.last_force = force;
        self.waiting += 1;
        self.waiting_sum[0] += closing;
        self.waiting_sum[1] += force;
        if self.waiting < self.per_point {
            return;
        }
        let periods = f64::from(std::mem::take(&mut self.waiting));
        let points = &mut self.record.loop_points;
        points.push(std::mem::take(&mut self.waiting_sum).map(|sum| sum / periods));
        if points.len() == MAX_LOOP_POINTS {
            let mean = |pair: &[[f64; 2]]| [0, 1].map(|k| 0.5 * (pair[0][k] + pair[1][k]));
            *points = points.chunks_exact(2).map(mean).collect();
            self.per_point = self.per_point.saturating_mul(2);
        }
    }
}

/// Number of sides a pair closes from: one or two.
fn sides(pair: &PairTines) -> f64 {
    [1.0, -1.0].into_iter().filter(|d| pair.iter().any(|t| t.1 == *d)).count() as f64
}

/// Mean position of the tines of a side along its closing, averaged over the sides, m.
fn mean_closing(pair: &PairTines, place: impl Fn(usize) -> f64) -> f64 {
    let of_side = |side: f64| {
        let places = || pair.iter().filter(|t| t.1 == side).map(|t| side * place(t.0));
        places().sum::<f64>() / places().count().max(1) as f64
    };
    (of_side(1.0) + of_side(-1.0)) / sides(pair)
}

/// Resistance along the closing, N: summed over the tines of a side, averaged over the sides.
///
/// `impulse`: of the ballast on a tine in a step of length `h` (s), along x, N s.
pub(crate) fn side_force(pair: &PairTines, impulse: impl Fn(usize) -> f64, h: f64) -> f64 {
    let resistance: f64 = pair.iter().map(|t| -t.1 * impulse(t.0)).sum();
    resistance / (h * sides(pair))
}

#[cfg(test)]
#[path = "squeeze_tests.rs"]
mod tests;
