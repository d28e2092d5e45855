//! From poses and twists at times to a waveform.

use super::no_twist;
use ballast::component::{Interpolation, Knot, Waveform};
use ballast::math::{Quat, Vec3};
use ballast_protocol::Malformed;
use ballast_protocol::messages::{Pose, Quaternion, Twist};
use std::collections::{BTreeMap, BTreeSet};

/// How far the norm of a recorded quaternion may be from 1; it is normalised.
const NEARLY_UNIT: f64 = 1e-3;
/// Norms nearer to 1 than this are left as they are, so that exact recordings stay exact.
const UNIT: f64 = 1e-9;

/// Share of the way by which twists and poses may differ without a word: twists of a vibration that is sampled three
/// times a period come to 0.45, those in another unit or of another frame to 1 and more.
const CONTRADICTION: f64 = 0.6;
/// What moves less than this says nothing of its twists, m.
const STILL: f64 = 1e-3;

/// Poses and twists of one body, as they come. Each tells how many bytes more it keeps.
#[derive(Debug, Clone, Default)]
pub(super) struct Track {
    poses: Vec<(u64, Pose)>,
    twists: BTreeMap<u64, Twist>,
    /// A time at which two were told.
    two_twists_at: Option<u64>,
    /// In which poses are told, and twists.
    pub pose_frames: BTreeSet<String>,
    pub twist_frames: BTreeSet<String>,
}

impl Track {
    pub fn pose(&mut self, time_ns: u64, pose: Pose, frame: &str) -> usize {
        let more = note(&mut self.pose_frames, frame);
        // The same again says nothing, and a file may hold any number of them in next to no bytes.
        if self.poses.last() == Some(&(time_ns, pose)) {
            return more;
        }
        self.poses.push((time_ns, pose));
        more + size_of::<(u64, Pose)>()
    }

    pub fn twist(&mut self, time_ns: u64, twist: Twist, frame: &str) -> usize {
        let more = note(&mut self.twist_frames, frame);
        match self.twists.insert(time_ns, twist) {
            None => return more + size_of::<(u64, Twist)>(),
            Some(other) if other != twist => {
                self.two_twists_at.get_or_insert(time_ns);
            }
            Some(_) => {}
        }
        more
    }

    pub fn has_poses(&self) -> bool {
        !self.poses.is_empty()
    }

    pub fn take_twists(&mut self, other: &mut Track) {
        self.twists.append(&mut other.twists);
        self.twist_frames.append(&mut other.twist_frames);
        self.two_twists_at = self.two_twists_at.or(other.two_twists_at);
    }

    /// The waveform, and how it came about. Times are those of the file.
    pub fn waveform(mut self) -> Result<(Waveform, String), Malformed> {
        // Files may hold messages in the order of their arrival.
        self.poses.sort_by_key(|(time, _)| *time);
        self.poses.dedup();
        if let Some(pair) = self.poses.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            let (place, expected) = (format!("{} ns", pair[0].0), "one pose at a time");
            let found = "two; do the stamps tell the time? (--time log takes the recorded one)";
            return Err(Malformed::new(place, expected, found));
        }
        if let Some(time) = self.two_twists_at {
            return Err(Malformed::new(format!("{time} ns"), "one twist at a time", "two"));
        }
        let cubic = self.poses.iter().all(|(time, _)| self.twists.contains_key(time));
        let knot = |(time, pose): &(u64, Pose)| {
            let twist = self.twists.get(time).filter(|_| cubic).copied().unwrap_or(no_twist());
            Ok(Knot {
                time_ns: *time,
                pose: ballast::math::Pose {
                    position: pose.position.into(),
                    orientation: unit(*time, pose.orientation)?,
                },
                velocity: twist.linear.into(),
                spin: twist.angular.into(),
            })
        };
        let knots = self.poses.iter().map(knot).collect::<Result<Vec<Knot>, Malformed>>()?;
        let (interpolation, how) = match (cubic, self.twists.is_empty()) {
            (true, _) => (Interpolation::Hermite, "cubic, by poses and twists"),
            (false, true) => (Interpolation::Linear, "linear, there are no twists"),
            (false, false) => {
                (Interpolation::Linear, "linear, some poses have no twist of the same time")
            }
        };
        let note = format!("{} poses, {how}", knots.len());
        Ok((Waveform { interpolation, knots }, note))
    }
}

/// The share of the way that the twists of a cubic motion miss from pose to pose, where it is out of proportion.
pub(super) fn contradiction(waveform: &Waveform) -> Option<f64> {
    if waveform.interpolation != Interpolation::Hermite {
        return None;
    }
    let knots = &waveform.knots;
    let first = knots.first()?.pose.position;
    let moves = knots.iter().any(|k| (k.pose.position - first).norm() > STILL);
    let (mut missed, mut way) = (0.0, 0.0);
    for [a, b] in knots.windows(2).map(|pair| [&pair[0], &pair[1]]) {
        let h = (b.time_ns - a.time_ns) as f64 * 1e-9;
        let moved = b.pose.position - a.pose.position;
        missed += (moved - 0.5 * h * (a.velocity + b.velocity)).norm();
        way += moved.norm();
    }
    (moves && missed > CONTRADICTION * way).then(|| missed / way)
}

/// Notes a name; how many bytes more that keeps.
pub(super) fn note(names: &mut BTreeSet<String>, name: &str) -> usize {
    if names.contains(name) {
        return 0;
    }
    names.insert(name.into());
    size_of::<String>() + name.len()
}

fn unit(time_ns: u64, q: Quaternion) -> Result<Quat, Malformed> {
    let plain = nalgebra::Quaternion::new(q.w, q.x, q.y, q.z);
    let off = (plain.norm() - 1.0).abs();
    if off <= UNIT {
        return Ok(Quat::new_unchecked(plain));
    }
    if off <= NEARLY_UNIT {
        return Ok(Quat::new_normalize(plain));
    }
    let place = format!("orientation at {time_ns} ns");
    Err(Malformed::new(place, "a unit quaternion (x, y, z, w)", format!("{q:?}")))
}

/// The waveform from `start` on, shifted so that `start` becomes `begin`.
///
/// A body whose messages begin earlier gets a knot at `start`: the pose lies on its curve, the twist
/// between those of its neighbours.
pub(super) fn cut(waveform: &Waveform, start: u64, begin: u64) -> Waveform {
    let shift =
        |knot: &Knot| Knot { time_ns: (knot.time_ns - start).saturating_add(begin), ..*knot };
    let later = waveform.knots.partition_point(|k| k.time_ns < start);
    let mut knots: Vec<Knot> = waveform.knots[later..].iter().map(shift).collect();
    let exact = waveform.knots.get(later).is_some_and(|k| k.time_ns == start);
    if let (false, Some(before)) = (exact, later.checked_sub(1).map(|i| &waveform.knots[i])) {
        let after = waveform.knots.get(later).unwrap_or(before);
        let span = (after.time_ns - before.time_ns).max(1) as f64;
        let share = (start - before.time_ns) as f64 / span;
        let between = |a: &Vec3, b: &Vec3| a + (b - a) * share;
        knots.insert(
            0,
            Knot {
                time_ns: begin,
                pose: waveform.pose(start),
                velocity: between(&before.velocity, &after.velocity),
                spin: between(&before.spin, &after.spin),
            },
        );
    }
    Waveform { interpolation: waveform.interpolation, knots }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_twists_at_a_time_are_refused_and_the_same_one_twice_is_not() {
        let track = |speeds: [f64; 2]| {
            let mut track = Track::default();
            for speed in speeds {
                let mut twist = no_twist();
                twist.linear.x = speed;
                track.pose(5, Pose::default(), "");
                track.twist(5, twist, "");
            }
            track.waveform()
        };
        let refused = track([1.0, 2.0]).unwrap_err().to_string();
        assert_eq!(refused, "5 ns: expected one twist at a time, found two");
        let same = track([1.0, 1.0]);
        assert!(same.is_ok_and(|(waveform, _)| waveform.knots.len() == 1));
    }
}
