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
use std::sync::Arc;

/// The tines of a pair: index among the driven bodies, and closing direction along x, +1 or -1.
pub type PairTines = Vec<(usize, f64)>;

/// By how much the mean way of a side over a period must change to be closing or opening, m: more than a
/// vibration of another frequency than the period's leaves in the mean, little against strokes of 20 to 100 mm.
pub const LEAST_CLOSING: f64 = 2e-3;
/// Mean force of a side over a period above which the ballast counts as touched, N; with as much in closing direction
/// it pushes the pair together.
pub const TOUCH: f64 = 100.0;
/// Most points of a loop: a longer one has fewer points per time, each a mean over several periods.
pub const MOST_POINTS: usize = 128;

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

/// What is known of a squeeze, up to the last whole period.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SqueezeRecord {
    /// Of the pair, from 1 on.
    pub number: u32,
    /// When the pair was at its widest, ns; closings are counted from there.
    pub began_ns: u64,
    /// End of the period since which the ballast resists by more than [`TOUCH`], or did so last, ns, and the closing
    /// then, m.
    pub onset_ns: Option<u64>,
    pub onset_closing: f64,
    /// Largest mean force of a side over a period, N, and the closing at which it occurred, m.
    pub peak_force: f64,
    pub peak_closing: f64,
    /// Largest force of a single step, N: peaks of the vibration included.
    pub peak_step_force: f64,
    /// Of a side, mean over the last period, m.
    pub closing: f64,
    /// Work of the pair's tines on the ballast since it had closed by [`LEAST_CLOSING`], all directions, vibration
    /// included, J.
    pub work: f64,
    /// Work of the mean force along the closing as far as it came, J: the area under the loop, both sides; opening
    /// takes nothing back (T-24).
    pub compaction_energy: f64,
    /// The loop: closing of a side (m) and mean force of a side (N).
    pub loop_points: Vec<[f64; 2]>,
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
    courses: Vec<Course>,
    /// Over since they were last told.
    over: Vec<SqueezeOutcome>,
}

/// How far a pair is.
#[derive(Debug, Clone, Default, PartialEq)]
struct Course {
    period: Period,
    is_squeezing: bool,
    /// Squeezes so far.
    count: u32,
    /// Mean place of the sides along their closing where [`Course::record`] began, m; none before the first
    /// period is over.
    widest: Option<f64>,
    /// Farthest closing since then, m.
    farthest: f64,
    /// Mean force of the last period, N.
    last_force: f64,
    /// Periods per point of the loop, and those that wait for the next point: how many, sums of closing and force.
    per_point: u32,
    waiting: u32,
    waiting_sum: [f64; 2],
    record: SqueezeRecord,
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

/// Sums over the steps of the period under way.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Period {
    steps: u32,
    force: f64,
    place: f64,
    work: f64,
    peak_step_force: f64,
}

impl SqueezeMeter {
    /// A meter that has seen nothing yet.
    pub fn new(rule: Arc<SqueezeRule>) -> Self {
        let courses = vec![Course::default(); rule.pairs.len()];
        Self { rule, courses, over: Vec::new() }
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
        for (pair, course) in self.rule.pairs.iter().zip(&mut self.courses) {
            let tines = &pair.tines;
            let place = mean_closing(tines, |d| tine(d).place);
            let work = tines.iter().map(|t| tine(t.0).work).sum::<f64>();
            let force = side_force(tines, |d| tine(d).impulse, h);
            course.period.take(force, place, work);
            if course.period.steps < self.rule.period {
                continue;
            }
            if let Some(record) = course.end_period(sides(tines), time_ns) {
                self.over.push(SqueezeOutcome { name: pair.name.clone(), is_over: true, record });
            }
        }
    }

    /// What is to be told: the squeezes that have ended since it was last asked, and those in progress.
    pub fn tell(&mut self) -> Vec<SqueezeOutcome> {
        let mut told = std::mem::take(&mut self.over);
        let courses = self.rule.pairs.iter().zip(&self.courses).filter(|(_, c)| c.is_squeezing);
        told.extend(courses.map(|(pair, course)| SqueezeOutcome {
            name: pair.name.clone(),
            is_over: false,
            record: course.record.clone(),
        }));
        told
    }

    /// Takes up what [`SqueezeMeter::write`] has left for this rule; nothing where it cannot be that.
    pub(crate) fn read(rule: Arc<SqueezeRule>, numbers: &[f64]) -> Option<Self> {
        let mut rest = numbers;
        let courses = rule.pairs.iter().map(|_| Course::read(&mut rest)).collect::<Option<_>>()?;
        rest.is_empty().then_some(Self { rule, courses, over: Vec::new() })
    }

    pub(crate) fn write(&self, numbers: &mut Vec<f64>) {
        self.courses.iter().for_each(|course| course.write(numbers));
    }
}

impl Period {
    fn take(&mut self, force: f64, place: f64, work: f64) {
        self.peak_step_force =
            if self.steps == 0 { force } else { self.peak_step_force.max(force) };
        self.steps += 1;
        self.force += force;
        self.place += place;
        self.work += work;
    }
}

impl Course {
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
    fn begin(&mut self, period: &Period, place: f64, now_ns: u64) {
        let count = self.count;
        *self = Self { count, widest: Some(place), per_point: 1, ..Self::default() };
        self.record.began_ns = now_ns;
        self.note(period, 0.0, period.force / f64::from(period.steps), now_ns);
    }

    /// Notes forces and the closing at the end of a period.
    fn note(&mut self, period: &Period, closing: f64, force: f64, now_ns: u64) {
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
        if points.len() == MOST_POINTS {
            let mean = |pair: &[[f64; 2]]| [0, 1].map(|k| 0.5 * (pair[0][k] + pair[1][k]));
            *points = points.chunks_exact(2).map(mean).collect();
            self.per_point = self.per_point.saturating_mul(2);
        }
    }
}

/// What is kept as numbers, and read back from them.
trait Kept: Sized {
    fn write(&self, numbers: &mut Vec<f64>);
    /// Takes the numbers off the front of `rest`; nothing where they cannot be these.
    fn read(rest: &mut &[f64]) -> Option<Self>;
}

/// Fields in the order in which they are kept.
macro_rules! kept {
    ($type:ident: $($field:ident),*) => {
        impl Kept for $type {
            fn write(&self, numbers: &mut Vec<f64>) {
                let Self { $($field),* } = self;
                $($field.write(numbers);)*
            }

            fn read(rest: &mut &[f64]) -> Option<Self> {
                $(let $field = Kept::read(rest)?;)*
                Some(Self { $($field),* })
            }
        }
    };
}

kept!(Course: period, is_squeezing, count, widest, farthest, last_force, per_point, waiting, waiting_sum, record);
kept!(Period: steps, force, place, work, peak_step_force);
kept!(SqueezeRecord: number, began_ns, onset_ns, onset_closing, peak_force, peak_closing, peak_step_force, closing, work,
    compaction_energy, loop_points);

/// What is one number: as which it is kept, and what is read from it.
macro_rules! one_number {
    ($($type:ty: $to:expr, $from:expr;)*) => {$(
        impl Kept for $type {
            fn write(&self, numbers: &mut Vec<f64>) {
                let to: fn(Self) -> f64 = $to;
                numbers.push(to(*self));
            }

            fn read(rest: &mut &[f64]) -> Option<Self> {
                rest.split_off_first().copied().map($from)
            }
        }
    )*};
}

one_number! {
    f64: |number| number, |number| number;
    u32: f64::from, |number| number as u32;
    bool: f64::from, |number| number == 1.0;
    // Times are exact as numbers for a hundred days.
    u64: |ns| ns as f64, |number| number as u64;
    Option<u64>: |ns| ns.map_or(-1.0, |ns| ns as f64), |number| (number >= 0.0).then_some(number as u64);
}

/// Whether there is one, and the number or 0.
impl Kept for Option<f64> {
    fn write(&self, numbers: &mut Vec<f64>) {
        self.is_some().write(numbers);
        self.unwrap_or_default().write(numbers);
    }

    fn read(rest: &mut &[f64]) -> Option<Self> {
        let (is_some, number) = (bool::read(rest)?, f64::read(rest)?);
        Some(is_some.then_some(number))
    }
}

impl Kept for [f64; 2] {
    fn write(&self, numbers: &mut Vec<f64>) {
        numbers.extend(self);
    }

    fn read(rest: &mut &[f64]) -> Option<Self> {
        Some([f64::read(rest)?, f64::read(rest)?])
    }
}

/// The points of a loop after their number.
impl Kept for Vec<[f64; 2]> {
    fn write(&self, numbers: &mut Vec<f64>) {
        numbers.push(self.len() as f64);
        numbers.extend(self.iter().flatten());
    }

    fn read(rest: &mut &[f64]) -> Option<Self> {
        let points = f64::read(rest)?;
        if !(0.0..=MOST_POINTS as f64).contains(&points) {
            return None;
        }
        (0..points as usize).map(|_| Kept::read(rest)).collect()
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
