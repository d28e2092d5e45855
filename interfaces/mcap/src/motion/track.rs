//! Conversion of poses and twists at times to a waveform.

use ballast::component::{Interpolation, Knot, Waveform};
use ballast::math::Quat;
use ballast_protocol::MessageError;
use ballast_protocol::messages::{Pose, Quaternion, Twist};
use std::collections::{BTreeMap, BTreeSet};

/// Maximum deviation of the norm of a recorded quaternion from 1; the quaternion is then normalised.
const MAX_NORM_ERROR: f64 = 1e-3;
/// Maximum deviation from 1 at which a quaternion is not normalised, so that exact recordings stay exact.
const EXACT_NORM_ERROR: f64 = 1e-9;

/// Maximum ratio of the difference between twists and poses to the displacement. Twists of a vibration that is sampled
/// three times a period reach 0.45, those in another unit or frame 1 and more.
const MAX_CONTRADICTION: f64 = 0.6;
/// Minimum displacement for a comparison with twists, m.
const MIN_DISPLACEMENT: f64 = 1e-3;

/// Poses and twists of one body, in the order of the file. Adding returns the additional memory in bytes.
#[derive(Debug, Clone, Default)]
pub(super) struct PoseTrack {
    poses: Vec<(u64, Pose)>,
    twists: BTreeMap<u64, Twist>,
    /// A time with two different twists.
    two_twists_at: Option<u64>,
    /// Frames of the poses.
    pub pose_frames: BTreeSet<String>,
    /// Frames of the twists.
    pub twist_frames: BTreeSet<String>,
}

impl PoseTrack {
    pub fn pose(&mut self, time_ns: u64, pose: Pose, frame: &str) -> usize {
        let more = insert_name(&mut self.pose_frames, frame);
        // Repetitions are skipped: a small file may have any number of them.
        if self.poses.last() == Some(&(time_ns, pose)) {
            return more;
        }
        self.poses.push((time_ns, pose));
        more + size_of::<(u64, Pose)>()
    }

    pub fn twist(&mut self, time_ns: u64, twist: Twist, frame: &str) -> usize {
        let more = insert_name(&mut self.twist_frames, frame);
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

    pub fn take_twists(&mut self, other: &mut PoseTrack) {
        self.twists.append(&mut other.twists);
        self.twist_frames.append(&mut other.twist_frames);
        self.two_twists_at = self.two_twists_at.or(other.two_twists_at);
    }

    /// Returns the waveform with the times of the file, and a note about its interpolation.
    pub fn waveform(mut self) -> Result<(Waveform, String), MessageError> {
        // Files may hold messages in the order of their arrival.
        self.poses.sort_by_key(|(time, _)| *time);
        self.poses.dedup();
        if let Some(pair) = self.poses.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            let (place, expected) = (format!("{} ns", pair[0].0), "one pose at a time");
            let found = "two; use --time log if the stamps are not the time";
            return Err(MessageError::new(place, expected, found));
        }
        if let Some(time) = self.two_twists_at {
            return Err(MessageError::new(format!("{time} ns"), "one twist at a time", "two"));
        }
        let cubic = self.poses.iter().all(|(time, _)| self.twists.contains_key(time));
        let knot = |(time, pose): &(u64, Pose)| {
            let twist = self.twists.get(time).filter(|_| cubic).copied().unwrap_or_default();
            Ok(Knot {
                time_ns: *time,
                pose: ballast::math::Pose {
                    position: pose.position.into(),
                    orientation: unit(*time, pose.orientation)?,
                },
                velocity: twist.linear.into(),
                angular_velocity: twist.angular.into(),
            })
        };
        let knots = self.poses.iter().map(knot).collect::<Result<Vec<Knot>, MessageError>>()?;
        let (interpolation, reason) = match (cubic, self.twists.is_empty()) {
            (true, _) => (Interpolation::Hermite, "cubic, by poses and twists"),
            (false, true) => (Interpolation::Linear, "linear, there are no twists"),
            (false, false) => {
                (Interpolation::Linear, "linear, some poses have no twist of the same time")
            }
        };
        let note = format!("{} poses, {reason}", knots.len());
        Ok((Waveform { interpolation, knots }, note))
    }
}

/// Returns the ratio of the difference between twists and poses of a cubic motion to its displacement, if it is too large.
pub(super) fn contradiction(waveform: &Waveform) -> Option<f64> {
    if waveform.interpolation != Interpolation::Hermite {
        return None;
    }
    let knots = &waveform.knots;
    let first = knots.first()?.pose.position;
    let moves = knots.iter().any(|k| (k.pose.position - first).norm() > MIN_DISPLACEMENT);
    let (mut missed, mut distance) = (0.0, 0.0);
    for [a, b] in knots.windows(2).map(|pair| [&pair[0], &pair[1]]) {
        let h = (b.time_ns - a.time_ns) as f64 * 1e-9;
        let moved = b.pose.position - a.pose.position;
        missed += (moved - 0.5 * h * (a.velocity + b.velocity)).norm();
        distance += moved.norm();
    }
    (moves && missed > MAX_CONTRADICTION * distance).then(|| missed / distance)
}

/// Inserts a name; returns the additional memory in bytes.
pub(super) fn insert_name(names: &mut BTreeSet<String>, name: &str) -> usize {
    if names.contains(name) {
        return 0;
    }
    names.insert(name.into());
    size_of::<String>() + name.len()
}

fn unit(time_ns: u64, q: Quaternion) -> Result<Quat, MessageError> {
    let plain = nalgebra::Quaternion::new(q.w, q.x, q.y, q.z);
    let off = (plain.norm() - 1.0).abs();
    if off <= EXACT_NORM_ERROR {
        return Ok(Quat::new_unchecked(plain));
    }
    if off <= MAX_NORM_ERROR {
        return Ok(Quat::new_normalize(plain));
    }
    let place = format!("orientation at {time_ns} ns");
    Err(MessageError::new(place, "a unit quaternion (x, y, z, w)", format!("{q:?}")))
}

/// Returns the waveform from `start` on, shifted so that `start` becomes `begin`.
///
/// A waveform that begins earlier gets a knot at `start`, with the pose and twist of its curve there. The rest of the curve
/// is unchanged; rotations about changing axes are so to the order of the cubic.
pub(super) fn cut(mut waveform: Waveform, start: u64, begin: u64) -> Waveform {
    let (pose, twist) = (waveform.pose(start), waveform.twist(start).unwrap_or_default());
    let earlier = waveform.knots.partition_point(|k| k.time_ns <= start);
    if let Some(last) = earlier.checked_sub(1) {
        waveform.knots.drain(..last);
        let first = &mut waveform.knots[0];
        if first.time_ns < start {
            *first = Knot {
                time_ns: start,
                pose,
                velocity: twist.velocity,
                angular_velocity: twist.angular_velocity,
            };
        }
    }
    for knot in &mut waveform.knots {
        knot.time_ns = (knot.time_ns - start).saturating_add(begin);
    }
    waveform
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_different_twists_at_a_time_are_refused() {
        let track = |speeds: [f64; 2]| {
            let mut track = PoseTrack::default();
            for speed in speeds {
                let mut twist = Twist::default();
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

    #[test]
    fn a_cut_keeps_the_curve() {
        let vec = ballast::math::Vec3::new;
        let knot = |time_ns, x, speed, angle, angular_velocity| Knot {
            time_ns,
            pose: ballast::math::Pose {
                position: vec(x, 2.0, 0.1),
                orientation: Quat::from_axis_angle(&nalgebra::Vector3::y_axis(), angle),
            },
            velocity: vec(speed, 0.0, -0.3),
            angular_velocity: vec(0.0, angular_velocity, 0.0),
        };
        let ms = 1_000_000;
        let knots = vec![knot(0, 0.0, 2.0, 0.0, 9.0), knot(10 * ms, 0.01, -1.0, 0.2, -4.0)];
        let whole = Waveform { interpolation: Interpolation::Hermite, knots };
        let (start, begin) = (3 * ms, 70 * ms);
        let rest = cut(whole.clone(), start, begin);
        assert_eq!((rest.knots.len(), rest.knots[0].time_ns), (2, begin));
        for after in (0..=7).map(|k| k * ms) {
            let [pose, was] = [rest.pose(begin + after), whole.pose(start + after)];
            assert!((pose.position - was.position).norm() < 1e-15, "{after}");
            assert!(pose.orientation.angle_to(&was.orientation) < 1e-7, "{after}");
            let [twist, was] = [rest.twist(begin + after), whole.twist(start + after)];
            let [twist, was] = [twist, was].map(Option::unwrap);
            assert!((twist.velocity - was.velocity).norm() < 1e-12, "{after}");
            assert!((twist.angular_velocity - was.angular_velocity).norm() < 1e-12, "{after}");
        }
        // A cut at a knot is exact.
        assert_eq!(cut(whole.clone(), 0, 0), whole);
        let last = cut(whole.clone(), 10 * ms, 5).knots;
        assert_eq!(last, [Knot { time_ns: 5, ..whole.knots[1] }]);
    }
}
