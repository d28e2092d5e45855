//! Memory of the component between windows: what the next window starts from besides the bodies.
//!
//! Contract: part of [`State`](crate::state::State), so that redo, fork, restore and checkpoints include it. It
//! decides no motion, and is not part of the state's hash.

use crate::error::{Error, Result};
use crate::math::Vec3;
use std::collections::VecDeque;

/// Version of the encoding of [`SqueezeTrack`]s as numbers.
pub const SQUEEZE_TRACK_VERSION: u32 = 1;
/// Maximum number of points of a force-closing loop: a longer loop has fewer points per time, each a mean over several
/// periods.
pub const MAX_LOOP_POINTS: usize = 128;

/// Velocity of a body at an instant, world axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Twist {
    /// Velocity of the reference point, m/s.
    pub velocity: Vec3,
    /// Angular velocity, rad/s.
    pub angular_velocity: Vec3,
}

impl Twist {
    /// Returns both vectors as text for messages.
    pub(crate) fn text(&self) -> String {
        let [v, w] = [self.velocity, self.angular_velocity];
        format!(
            "({:.3e}, {:.3e}, {:.3e}) m/s, ({:.3e}, {:.3e}, {:.3e}) rad/s",
            v.x, v.y, v.z, w.x, w.y, w.z
        )
    }
}

/// Memory that a window leaves for the next one.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WindowMemory {
    /// Twist of each driven body, or of its mount, at the end of the last window `[nd]`; `None` where it is unknown.
    ///
    /// Empty before the first window.
    pub twists: Vec<Option<Twist>>,
    /// Reactions of the driven bodies in the last steps.
    pub reactions: ReactionHistory,
    /// Progress of the tine pairs `[pairs]`.
    pub squeezes: Vec<SqueezeTrack>,
}

impl WindowMemory {
    /// Checks that the memory fits `bodies` driven bodies and that every number is finite.
    pub(crate) fn check(&self, bodies: usize) -> Result<()> {
        let finite = |v: &Vec3| v.iter().all(|x| x.is_finite());
        let twists = self.twists.iter().flatten();
        let found = if ![0, bodies].contains(&self.twists.len()) {
            Some(format!("{} twists", self.twists.len()))
        } else if !self.reactions.impulses.is_empty() && self.reactions.bodies != bodies {
            Some(format!("reactions of {} bodies", self.reactions.bodies))
        } else if !twists.flat_map(|t| [t.velocity, t.angular_velocity]).all(|v| finite(&v))
            || !self.reactions.impulses.iter().flatten().all(finite)
            || !SqueezeTrack::encode(&self.squeezes).iter().all(|x| x.is_finite())
        {
            Some("a number that is not finite".into())
        } else {
            None
        };
        found.map_or(Ok(()), |found| {
            Err(Error::State {
                place: "window memory".into(),
                expected: format!("finite twists and reactions of {bodies} driven bodies"),
                found,
            })
        })
    }
}

/// Reactions of the ballast on the driven bodies in the last steps, for moving averages.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReactionHistory {
    /// Number of driven bodies.
    bodies: usize,
    /// Impulse (N s) and angular impulse (N m s) of each body, oldest step first `[steps * nd]`.
    impulses: VecDeque<[Vec3; 2]>,
}

impl ReactionHistory {
    /// Builds the history of `bodies` driven bodies from its rows, oldest step first `[steps * nd]`.
    ///
    /// # Errors
    /// [`Error::State`] for rows that are not whole steps.
    pub fn from_rows(bodies: usize, rows: Vec<[Vec3; 2]>) -> Result<Self> {
        if rows.len().checked_rem(bodies).unwrap_or(rows.len()) != 0 {
            return Err(Error::State {
                place: "reaction history".into(),
                expected: format!("rows of whole steps of {bodies} driven bodies"),
                found: format!("{} rows", rows.len()),
            });
        }
        Ok(Self { bodies, impulses: rows.into() })
    }

    /// Returns impulse (N s) and angular impulse (N m s) of each body, oldest step first `[steps * nd]`.
    pub fn rows(&self) -> impl Iterator<Item = &[Vec3; 2]> {
        self.impulses.iter()
    }

    /// Appends a step's impulses `[nd]`, and drops steps beyond the last `max_steps`.
    pub fn push(&mut self, impulses: impl ExactSizeIterator<Item = [Vec3; 2]>, max_steps: usize) {
        if self.bodies != impulses.len() {
            self.impulses.clear();
            self.bodies = impulses.len();
        }
        let excess = (self.impulses.len() + self.bodies).saturating_sub(max_steps * self.bodies);
        self.impulses.drain(..excess);
        self.impulses.extend(impulses);
    }

    /// Returns the mean force (N) and torque (N m) on body `d` over the recorded steps of `h` seconds; zero without any.
    pub fn mean_wrench(&self, d: usize, h: f64) -> [Vec3; 2] {
        let steps = self.impulses.len().checked_div(self.bodies).unwrap_or(0);
        let of_body = (0..steps).map(|step| self.impulses[step * self.bodies + d]);
        let sum = of_body.fold([Vec3::zeros(); 2], |[force, torque], [impulse, angular]| {
            [force + impulse, torque + angular]
        });
        sum.map(|s| s / (h * steps.max(1) as f64))
    }
}

/// Measurements of a squeeze up to the last whole period.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SqueezeRecord {
    /// Number of the squeeze among those of its pair, from 1.
    pub number: u32,
    /// Time at which the pair was widest, ns; closings are counted from there.
    pub start_ns: u64,
    /// End of the period since which the ballast resists by more than the touch threshold, or did so last, ns.
    pub onset_ns: Option<u64>,
    /// Closing of a side at the onset, m.
    pub onset_closing: f64,
    /// Largest mean force of a side over a period, N.
    pub peak_force: f64,
    /// Closing of a side at the peak force, m.
    pub peak_closing: f64,
    /// Largest force of a single step, N: peaks of the vibration included.
    pub peak_step_force: f64,
    /// Closing of a side, mean over the last period, m.
    pub closing: f64,
    /// Work of the pair's tines on the ballast since the squeeze was detected, all directions, vibration
    /// included, J.
    pub work: f64,
    /// Work of the mean force along the largest closing so far, J: the area under the loop, both sides (T-24).
    pub compaction_energy: f64,
    /// The loop: closing of a side (m) and mean force of a side (N).
    pub loop_points: Vec<[f64; 2]>,
}

/// Progress of a tine pair through its squeezes.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SqueezeTrack {
    pub(crate) period: PeriodSums,
    pub(crate) is_squeezing: bool,
    /// Number of squeezes so far.
    pub(crate) count: u32,
    /// Mean position of the sides along their closing where [`SqueezeTrack::record`] began, m; `None` in the first
    /// period.
    pub(crate) widest: Option<f64>,
    /// Farthest closing since then, m.
    pub(crate) farthest: f64,
    /// Mean force of the last period, N.
    pub(crate) last_force: f64,
    /// Periods per point of the loop, number of periods summed for the next point, and their sums of closing and force.
    pub(crate) per_point: u32,
    pub(crate) waiting: u32,
    pub(crate) waiting_sum: [f64; 2],
    pub(crate) record: SqueezeRecord,
}

/// Sums over the steps of the current averaging period.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PeriodSums {
    pub(crate) steps: u32,
    pub(crate) force: f64,
    pub(crate) place: f64,
    pub(crate) work: f64,
    pub(crate) peak_step_force: f64,
}

impl SqueezeTrack {
    /// Returns the tracks as numbers; a time is exact for a hundred days.
    pub fn encode(tracks: &[Self]) -> Vec<f64> {
        let mut numbers = Vec::new();
        tracks.iter().for_each(|track| track.write(&mut numbers));
        numbers
    }

    /// Returns the tracks that [`SqueezeTrack::encode`] has written; `None` if the numbers do not fit.
    pub fn decode(mut numbers: &[f64]) -> Option<Vec<Self>> {
        let mut tracks = Vec::new();
        while !numbers.is_empty() {
            tracks.push(Self::read(&mut numbers)?);
        }
        Some(tracks)
    }
}

/// Encoding as numbers, in the order of the fields.
trait Persist: Sized {
    fn write(&self, numbers: &mut Vec<f64>);
    /// Takes the numbers off the front of `rest`; `None` if they do not fit.
    fn read(rest: &mut &[f64]) -> Option<Self>;
}

/// Implements [`Persist`] field by field, in the given order.
macro_rules! persist {
    ($type:ident: $($field:ident),*) => {
        impl Persist for $type {
            fn write(&self, numbers: &mut Vec<f64>) {
                let Self { $($field),* } = self;
                $($field.write(numbers);)*
            }

            fn read(rest: &mut &[f64]) -> Option<Self> {
                $(let $field = Persist::read(rest)?;)*
                Some(Self { $($field),* })
            }
        }
    };
}

persist!(SqueezeTrack: period, is_squeezing, count, widest, farthest, last_force, per_point, waiting, waiting_sum, record);
persist!(PeriodSums: steps, force, place, work, peak_step_force);
persist!(SqueezeRecord: number, start_ns, onset_ns, onset_closing, peak_force, peak_closing, peak_step_force, closing, work,
    compaction_energy, loop_points);

/// Implements [`Persist`] for types that are one number.
macro_rules! one_number {
    ($($type:ty: $to:expr, $from:expr;)*) => {$(
        impl Persist for $type {
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

/// Presence flag, then the number or 0.
impl Persist for Option<f64> {
    fn write(&self, numbers: &mut Vec<f64>) {
        self.is_some().write(numbers);
        self.unwrap_or_default().write(numbers);
    }

    fn read(rest: &mut &[f64]) -> Option<Self> {
        let (is_some, number) = (bool::read(rest)?, f64::read(rest)?);
        Some(is_some.then_some(number))
    }
}

impl Persist for [f64; 2] {
    fn write(&self, numbers: &mut Vec<f64>) {
        numbers.extend(self);
    }

    fn read(rest: &mut &[f64]) -> Option<Self> {
        Some([f64::read(rest)?, f64::read(rest)?])
    }
}

/// Number of points, then the points.
impl Persist for Vec<[f64; 2]> {
    fn write(&self, numbers: &mut Vec<f64>) {
        numbers.push(self.len() as f64);
        numbers.extend(self.iter().flatten());
    }

    fn read(rest: &mut &[f64]) -> Option<Self> {
        let points = f64::read(rest)?;
        if !(0.0..=MAX_LOOP_POINTS as f64).contains(&points) {
            return None;
        }
        (0..points as usize).map(|_| Persist::read(rest)).collect()
    }
}
