//! What each tine pair does in a squeeze: onset of contact, peak force, closing, compaction energy,
//! force-displacement loop.
//!
//! Reads: states, and the steps' reactions of the tines. Writes: its own records. Cost: O(tines) per step.
//! Contract: measuring changes nothing; what is told depends on the steps, not on who moves the tines nor on
//! how time is cut into windows. Signs: a force is positive when the ballast resists closing.
//!
//! Whoever moves the tines need not say when a squeeze begins: it is seen in their motion, averaged over a
//! vibration period, which takes the vibration out of it. A squeeze begins where a pair is at its widest before
//! it closes by more than [`LEAST_CLOSING`], and is over when it has opened again by as much from its narrowest.
//! Tines bend by some millimetres while they sink in: before a squeeze has begun, closing that the ballast pushes
//! the pair to does not count.
//!
//! Loops and energies tell worn ballast from good: both are those of published squeeze tests.

use crate::error::{Error, Result};
use crate::model::Model;
use crate::state::State;
use crate::step::StepReport;
pub use crate::window_memory::SqueezeRecord;
use crate::window_memory::{MAX_LOOP_POINTS, PeriodSums, SqueezeTrack};
use std::sync::Arc;

/// The tines of a pair: index among the driven bodies, and closing direction along x, +1 or -1.
pub type PairTines = Vec<(usize, f64)>;

/// By how much the mean way of a side over a period must change to be closing or opening, m: more than a
/// vibration of another frequency than the period's leaves in the mean, little against strokes of 20 to 100 mm.
pub const LEAST_CLOSING: f64 = 2e-3;
/// Mean force of a side over a period above which the ballast counts as touched, N; with as much in closing direction
/// it pushes the pair together.
pub const TOUCH: f64 = 100.0;
/// Tines that close together.
#[derive(Debug, Clone, PartialEq)]
pub struct SqueezePair {
    pub name: String,
    pub tines: PairTines,
}

/// Which pairs are looked at, and over how many steps their motion and forces are averaged.
#[derive(Debug, Clone, PartialEq)]
pub struct SqueezeRule {
    pairs: Vec<SqueezePair>,
    /// Steps of a vibration period.
    period: u32,
}

impl Default for SqueezeRule {
    /// Looks at nothing.
    fn default() -> Self {
        Self { pairs: Vec::new(), period: 1 }
    }
}

impl SqueezeRule {
    /// A rule for the given pairs and steps of a vibration period.
    ///
    /// # Errors
    /// A pair without tines, a direction that is not ±1, or a period of no steps.
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

/// A squeeze that was in progress during a window.
#[derive(Debug, Clone, PartialEq)]
pub struct SqueezeOutcome {
    /// Of the pair.
    pub name: String,
    /// The pair has opened again.
    pub is_over: bool,
    pub record: SqueezeRecord,
}

/// Follows the pairs of a rule from step to step.
#[derive(Debug, Clone, PartialEq)]
pub struct SqueezeMeter {
    rule: Arc<SqueezeRule>,
    /// `[pairs]`.
    tracks: Vec<SqueezeTrack>,
    /// Over since they were last told.
    over: Vec<SqueezeOutcome>,
}

/// A tine in a step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct TineStep {
    /// Of its reference point at the end, along x, m.
    pub place: f64,
    /// Of the ballast on it, along x, N s.
    pub impulse: f64,
    /// Of it on the ballast, J.
    pub work: f64,
}

impl SqueezeMeter {
    /// A meter that has seen nothing yet.
    pub fn new(rule: Arc<SqueezeRule>) -> Self {
        let tracks = vec![SqueezeTrack::default(); rule.pairs.len()];
        Self { rule, tracks, over: Vec::new() }
    }

    /// Takes the step that has led to `state`.
    pub fn take(&mut self, model: &Model, state: &State, report: &StepReport) {
        let ng = model.grains.len();
        self.follow(state.time_ns, model.stepping.h(), |d| TineStep {
            place: state.position[ng + d].x,
            impulse: report.reactions[d].impulse.x,
            work: report.reactions[d].work,
        });
    }

    /// Takes a step of length `h` (s) that has ended at `time_ns`; `tine` tells what the tines did in it.
    pub fn follow(&mut self, time_ns: u64, h: f64, tine: impl Fn(usize) -> TineStep) {
        for (pair, track) in self.rule.pairs.iter().zip(&mut self.tracks) {
            let tines = &pair.tines;
            let place = mean_closing(tines, |d| tine(d).place);
            let work = tines.iter().map(|t| tine(t.0).work).sum::<f64>();
            let force = side_force(tines, |d| tine(d).impulse, h);
            track.period.take(force, place, work);
            if track.period.steps < self.rule.period {
                continue;
            }
            if let Some(record) = track.end_period(sides(tines), time_ns) {
                self.over.push(SqueezeOutcome { name: pair.name.clone(), is_over: true, record });
            }
        }
    }

    /// What is to be told: the squeezes that have ended since it was last asked, and those in progress.
    pub fn tell(&mut self) -> Vec<SqueezeOutcome> {
        let mut told = std::mem::take(&mut self.over);
        let tracks = self.rule.pairs.iter().zip(&self.tracks).filter(|(_, t)| t.is_squeezing);
        told.extend(tracks.map(|(pair, track)| SqueezeOutcome {
            name: pair.name.clone(),
            is_over: false,
            record: track.record.clone(),
        }));
        told
    }

    /// Returns a meter that continues from `tracks`; tracks of another number of pairs are dropped.
    pub fn resume(rule: Arc<SqueezeRule>, tracks: &[SqueezeTrack]) -> Self {
        if tracks.len() != rule.pairs.len() {
            return Self::new(rule);
        }
        Self { rule, tracks: tracks.to_vec(), over: Vec::new() }
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
    /// The squeeze that is over with this period, if one is.
    fn end_period(&mut self, sides: f64, now_ns: u64) -> Option<SqueezeRecord> {
        let period = std::mem::take(&mut self.period);
        let steps = f64::from(period.steps);
        let (place, force) = (period.place / steps, period.force / steps);
        let is_pushed = force < -TOUCH;
        let closing = match self.widest {
            Some(widest) if self.is_squeezing || (place > widest && !is_pushed) => place - widest,
            _ => {
                self.begin(&period, place, now_ns);
                return None;
            }
        };
        // As far as it comes: what the pair gets back in opening is elastic, and seen by a period or two alone.
        let further = (closing - self.farthest).max(0.0);
        self.record.compaction_energy += sides * 0.5 * (self.last_force + force) * further;
        self.farthest += further;
        self.note(&period, closing, force, now_ns);
        if !self.is_squeezing && closing > LEAST_CLOSING {
            self.is_squeezing = true;
            self.count += 1;
            self.record.number = self.count;
        }
        if self.is_squeezing {
            self.record.work += period.work;
        }
        if closing >= self.farthest - LEAST_CLOSING {
            return None;
        }
        let over = self.is_squeezing.then(|| std::mem::take(&mut self.record));
        self.begin(&period, place, now_ns);
        over
    }

    /// The pair is at its widest, for now.
    fn begin(&mut self, period: &PeriodSums, place: f64, now_ns: u64) {
        let count = self.count;
        *self = Self { count, widest: Some(place), per_point: 1, ..Self::default() };
        self.record.began_ns = now_ns;
        self.note(period, 0.0, period.force / f64::from(period.steps), now_ns);
    }

    /// Notes forces and the closing at the end of a period.
    fn note(&mut self, period: &PeriodSums, closing: f64, force: f64, now_ns: u64) {
        let record = &mut self.record;
        if force > TOUCH && self.last_force <= TOUCH {
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

/// How far the tines of a side have come in the mean, averaged over the sides, m.
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
