//! The motion of a body through a window: knots, and what lies between them (T-29).
//!
//! Contract: at a knot the pose is that knot's, to the bit; between two knots it depends on these two
//! alone. So a stretch of time may be cut at any knot without changing a pose. Nothing is extrapolated.

use super::refusal::Refusal;
use crate::math::{Pose, Vec3, is_unit, rotation};
pub use crate::window_memory::Twist;

/// Maximum rotation between two knots, rad: beyond half a turn its direction is ambiguous.
pub const MAX_KNOT_ROTATION: f64 = 2.0;

/// Pose and twist of a body at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Knot {
    /// Time since the start of the run, ns.
    pub time_ns: u64,
    /// Pose of the body frame in the world, m.
    pub pose: Pose,
    /// Velocity of the reference point, world axes, m/s; read by [`Interpolation::Hermite`] only.
    pub velocity: Vec3,
    /// Angular velocity, world axes, rad/s; read by [`Interpolation::Hermite`] only.
    pub angular_velocity: Vec3,
}

/// Interpolation between knots.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Interpolation {
    /// Pose of the last knot: poses jump within a step. For slow switches, not for vibration.
    Hold,
    /// Constant velocity and angular velocity.
    Linear,
    /// Cubic, with the knots' velocities and angular velocities at its ends.
    #[default]
    Hermite,
}

/// Motion of a body as a function of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Waveform {
    /// Interpolation between the knots.
    pub interpolation: Interpolation,
    /// Knots in order of time.
    pub knots: Vec<Knot>,
}

impl Waveform {
    /// Returns the pose at a time that the knots cover.
    pub fn pose(&self, time_ns: u64) -> Pose {
        let after = self.knots.partition_point(|k| k.time_ns <= time_ns);
        let Some(a) = after.checked_sub(1).map(|k| &self.knots[k]) else {
            return self.knots.first().map_or_else(Pose::identity, |k| k.pose);
        };
        match self.knots.get(after) {
            Some(b) if a.time_ns < time_ns => match self.interpolation {
                Interpolation::Hold => a.pose,
                Interpolation::Linear => linear(a, b, time_ns),
                Interpolation::Hermite => hermite(a, b, time_ns),
            },
            _ => a.pose,
        }
    }

    /// Refuses a waveform that does not define a motion through the whole window.
    pub(super) fn check(&self, body: &str, t0_ns: u64, t1_ns: u64) -> Result<(), Refusal> {
        let (Some(first), Some(last)) = (self.knots.first(), self.knots.last()) else {
            return Err(Refusal::input(body, "at least one knot", "none"));
        };
        for (i, knot) in self.knots.iter().enumerate() {
            let finite = |v: &Vec3| v.iter().all(|x| x.is_finite());
            if !(finite(&knot.pose.position)
                && finite(&knot.velocity)
                && finite(&knot.angular_velocity))
            {
                return Err(Refusal::input(body, "finite numbers", format!("{knot:?} (knot {i})")));
            }
            if !is_unit(&knot.pose.orientation) {
                let found = format!("a norm of {} (knot {i})", knot.pose.orientation.norm());
                return Err(Refusal::input(body, "unit quaternions", found));
            }
        }
        for (i, pair) in self.knots.windows(2).enumerate() {
            if pair[0].time_ns >= pair[1].time_ns {
                let found =
                    format!("{} ns before {} ns (knot {i})", pair[0].time_ns, pair[1].time_ns);
                return Err(Refusal::input(body, "knots in order of time", found));
            }
            let turn = between(&pair[0], &pair[1]).norm();
            if self.interpolation != Interpolation::Hold && turn > MAX_KNOT_ROTATION {
                let expected = format!("knots that turn by at most {MAX_KNOT_ROTATION} rad");
                return Err(Refusal::input(
                    body,
                    expected,
                    format!("{turn:.3} rad after knot {i}"),
                ));
            }
        }
        let ends = self.interpolation == Interpolation::Hold || last.time_ns >= t1_ns;
        if first.time_ns <= t0_ns && ends {
            return Ok(());
        }
        Err(Refusal::Gap {
            body: body.into(),
            expected: format!("knots from {t0_ns} to {t1_ns} ns"),
            found: format!("from {} to {} ns", first.time_ns, last.time_ns),
        })
    }

    /// Returns the twist of a cubic motion at a time that its knots cover; `None` for other motions.
    pub fn twist(&self, time_ns: u64) -> Option<Twist> {
        if self.interpolation != Interpolation::Hermite {
            return None;
        }
        let after = self.knots.partition_point(|k| k.time_ns < time_ns);
        let b = self.knots.get(after)?;
        if b.time_ns == time_ns {
            return Some(Twist { velocity: b.velocity, angular_velocity: b.angular_velocity });
        }
        Some(hermite_twist(self.knots.get(after.checked_sub(1)?)?, b, time_ns))
    }
}

/// Returns the knots that the interval from `t0_ns` to `t1_ns` depends on; `time` returns the time of a knot.
pub(super) fn around<K>(knots: &[K], time: impl Fn(&K) -> u64, t0_ns: u64, t1_ns: u64) -> &[K] {
    let first = knots.partition_point(|k| time(k) <= t0_ns).saturating_sub(1);
    let last = knots.partition_point(|k| time(k) < t1_ns);
    &knots[first..(last + 1).min(knots.len()).max(first)]
}

/// Rotation vector from one knot to the next, world axes.
fn between(a: &Knot, b: &Knot) -> Vec3 {
    rotation::log(&(b.pose.orientation * a.pose.orientation.inverse()))
}

/// Returns the fraction of the time from `a` to `b`, and that time, s.
fn share(a: &Knot, b: &Knot, time_ns: u64) -> (f64, f64) {
    let whole = (b.time_ns - a.time_ns) as f64;
    ((time_ns - a.time_ns) as f64 / whole, whole * 1e-9)
}

fn linear(a: &Knot, b: &Knot, time_ns: u64) -> Pose {
    let (s, _) = share(a, b, time_ns);
    Pose {
        position: a.pose.position + (b.pose.position - a.pose.position) * s,
        orientation: rotation::advance(&a.pose.orientation, &(between(a, b) * s)),
    }
}

/// Cubic of the time between two knots, with a displacement and the rates at its ends.
struct Cubic {
    way: Vec3,
    rates: [Vec3; 2],
}

impl Cubic {
    /// Returns the cubic of the positions, as differences: those far from the origin lose no digits.
    fn of_positions(a: &Knot, b: &Knot) -> Self {
        Self { way: b.pose.position - a.pose.position, rates: [a.velocity, b.velocity] }
    }

    /// Returns the cubic of the rotation vector from `a`, whose rate at `b` is `J⁻¹(φ) ω`.
    fn of_turns(a: &Knot, b: &Knot) -> Self {
        let way = between(a, b);
        Self {
            way,
            rates: [a.angular_velocity, rotation::rotation_vector_rate(&way, &b.angular_velocity)],
        }
    }

    /// Returns the displacement at a fraction `s` of the time.
    fn at(&self, (s, seconds): (f64, f64)) -> Vec3 {
        let (s2, s3) = (s * s, s * s * s);
        let [rate_a, rate_b] = self.rates;
        self.way * (3.0 * s2 - 2.0 * s3)
            + (rate_a * (s3 - 2.0 * s2 + s) + rate_b * (s3 - s2)) * seconds
    }

    /// Returns the rate at a fraction of the time.
    fn rate(&self, (s, seconds): (f64, f64)) -> Vec3 {
        let s2 = s * s;
        let [rate_a, rate_b] = self.rates;
        self.way * (6.0 * (s - s2) / seconds)
            + (rate_a * (3.0 * s2 - 4.0 * s + 1.0) + rate_b * (3.0 * s2 - 2.0 * s))
    }
}

/// Cubic through both knots with their velocities and angular velocities (T-29).
fn hermite(a: &Knot, b: &Knot, time_ns: u64) -> Pose {
    let share = share(a, b, time_ns);
    Pose {
        position: a.pose.position + Cubic::of_positions(a, b).at(share),
        orientation: rotation::advance(&a.pose.orientation, &Cubic::of_turns(a, b).at(share)),
    }
}

/// Velocity and angular velocity of [`hermite`].
fn hermite_twist(a: &Knot, b: &Knot, time_ns: u64) -> Twist {
    let share = share(a, b, time_ns);
    let turns = Cubic::of_turns(a, b);
    Twist {
        velocity: Cubic::of_positions(a, b).rate(share),
        angular_velocity: rotation::angular_velocity_from_rate(
            &turns.at(share),
            &turns.rate(share),
        ),
    }
}
