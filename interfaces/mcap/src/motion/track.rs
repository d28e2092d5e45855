//! Conversion of poses and twists at times to a waveform.

use super::series::{Series, StampedValue};
use super::values;
use ballast::component::{Interpolation, Knot, Waveform};
use ballast::math::Vec3;
use ballast_protocol::MessageError;
use ballast_protocol::messages::{Pose, Twist};

/// Maximum ratio of the difference between twists and poses to the displacement. Twists of a vibration that is sampled
/// three times a period reach 0.45, those in another unit or frame 1 and more.
const MAX_CONTRADICTION: f64 = 0.6;
/// Minimum displacement for a comparison with twists, m.
const MIN_DISPLACEMENT: f64 = 1e-3;

/// Poses and twists of one body.
#[derive(Debug, Clone, Default)]
pub(super) struct PoseTrack {
    pub poses: Series<Pose>,
    pub twists: Series<Twist>,
}

/// Motion of one body, with messages for the user.
pub(super) struct TrackMotion {
    pub waveform: Waveform,
    pub notes: Vec<String>,
    pub warnings: Vec<String>,
}

impl PoseTrack {
    /// Returns the motion with the times of the file, and notes about its interpolation.
    pub fn motion(mut self, body: &str) -> Result<TrackMotion, MessageError> {
        let mut warnings = self.poses.sort()?;
        warnings.extend(self.twists.sort()?);
        let (poses, twists) = (&self.poses.samples, &self.twists.samples);
        let twist_at = |time: u64| twists.binary_search_by_key(&time, |twist| twist.time_ns).ok();
        let cubic = poses.iter().all(|pose| twist_at(pose.time_ns).is_some());
        let knot = |pose: &StampedValue<Pose>| {
            let twist = twist_at(pose.time_ns).filter(|_| cubic);
            let twist = twist.map(|i| twists[i].value).unwrap_or_default();
            Knot {
                time_ns: pose.time_ns,
                pose: ballast::math::Pose {
                    position: pose.value.position.into(),
                    orientation: values::unit(&pose.value.orientation),
                },
                velocity: twist.linear.into(),
                angular_velocity: twist.angular.into(),
            }
        };
        let knots: Vec<Knot> = poses.iter().map(knot).collect();
        let (interpolation, reason) = match (cubic, twists.is_empty()) {
            (true, _) => (Interpolation::Hermite, "cubic, by poses and twists"),
            (false, true) => (Interpolation::Linear, "linear, there are no twists"),
            (false, false) => {
                (Interpolation::Linear, "linear, some poses have no twist of the same time")
            }
        };
        let source = &self.poses.source;
        let mut notes = vec![match knots.len() {
            1 => format!("{body}: one pose ({source}), which holds for all times"),
            count => format!("{body}: {count} poses, {reason}"),
        }];
        let errors = poses.iter().map(|pose| values::length(&pose.value.orientation) - 1.0);
        let errors: Vec<f64> =
            errors.filter(|e| e.abs() > values::MIN_NOTED_LENGTH_ERROR).collect();
        if let Some(worst) = errors.iter().copied().max_by(|a, b| a.abs().total_cmp(&b.abs())) {
            notes.push(format!(
                "{body}: {} quaternions of {source} are normalised; their length differs from 1, at most as {:.6}",
                errors.len(),
                1.0 + worst
            ));
        }
        Ok(TrackMotion { waveform: Waveform { interpolation, knots }, notes, warnings })
    }
}

/// Makes the only pose of a waveform hold from `start` to `end`.
pub(super) fn hold(waveform: &mut Waveform, [start, end]: [u64; 2]) {
    let Some(pose) = waveform.knots.first().map(|knot| knot.pose) else { return };
    let still =
        |time_ns| Knot { time_ns, pose, velocity: Vec3::zeros(), angular_velocity: Vec3::zeros() };
    waveform.interpolation = Interpolation::Linear;
    waveform.knots = vec![still(start), still(end)];
    waveform.knots.dedup();
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
    use ballast::math::Quat;

    #[test]
    fn two_different_twists_at_a_time_are_refused() {
        let motion = |speeds: [f64; 2]| {
            let mut track = PoseTrack::default();
            for x in speeds {
                let mut value = Twist::default();
                value.linear.x = x;
                let pose = Pose::default();
                track.poses.push("/a", "", StampedValue { time_ns: 5, log_ns: 5, value: pose });
                track.twists.push("/b", "", StampedValue { time_ns: 5, log_ns: 5, value });
            }
            track.motion("a")
        };
        let refused = motion([1.0, 2.0]).err().unwrap().to_string();
        assert!(
            refused.starts_with("/b, 5 ns: expected one message at a time, found two"),
            "{refused}"
        );
        assert!(motion([1.0, 1.0]).is_ok_and(|motion| motion.waveform.knots.len() == 1));
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
