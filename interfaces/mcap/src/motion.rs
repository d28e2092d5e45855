//! Motion of bodies from the poses in any MCAP file.
//!
//! Reads: `geometry_msgs/PoseStamped`, `TwistStamped` and `tf2_msgs/TFMessage` in CDR, poses in JSON.
//! Contract (rules of resampling): a knot per pose message, at its time. The motion of a body is cubic if every pose has a
//! twist of the same time, otherwise linear. Nothing is extrapolated: a motion covers the time that the messages of all
//! mapped bodies have in common. A single pose and a static transform hold for all times.

mod assignment;
mod coverage;
mod frames;
mod json_pose;
mod series;
mod track;
mod values;

pub use assignment::TopicMap;

use crate::chunk::MAX_CHUNK_BYTES;
use crate::error::{Error, Result};
use crate::messages::{McapMessage, MessageReader, Truncation};
use crate::other_format::describe_message;
use assignment::{Assignment, ChannelUse, list_names};
use ballast::component::MotionInput;
use ballast_protocol::messages::{PoseStamped, TFMessage, TransformStamped, TwistStamped, Vector3};
use ballast_protocol::{MessageError, from_cdr, messages};
use series::StampedValue;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use track::{PoseTrack, TrackMotion};

/// Source of the time of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TimeSource {
    /// Stamp in the message, the time of the pose.
    #[default]
    Stamp,
    /// Time of the recording.
    Log,
}

/// Motion of some bodies, read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedMotion {
    /// Inputs of the mapped bodies, in the order of their names.
    pub inputs: Vec<MotionInput>,
    /// Start of the time that all inputs cover, ns of the run.
    pub start_ns: u64,
    /// End of the time that all inputs cover, ns of the run.
    pub end_ns: u64,
    /// Notes for the user: interpolation of each body, topics.
    pub notes: Vec<String>,
    /// Warnings of probable mistakes.
    pub warnings: Vec<String>,
    /// Early end of the file, if there is one.
    pub truncation: Option<Truncation>,
}

/// Reads the motion of `bodies`.
///
/// Without `maps`, the topic `/<body>/pose` and the transform to the frame `<body>` move a body; with
/// `maps`, only their topics and frames do. The common time of the bodies is shifted to start at
/// `begin_ns` of the run.
///
/// # Errors
/// A file that cannot be read, or is no MCAP file; a map to an unknown body, or of a topic that the file does not have or
/// that has no poses; messages that are invalid, out of order, or without a common time.
pub fn read(
    path: &Path,
    bodies: &[String],
    maps: &[TopicMap],
    time: TimeSource,
    begin_ns: u64,
) -> Result<RecordedMotion> {
    let assignment = Assignment::new(path, bodies, maps)?;
    let mut messages = MessageReader::open(path)?;
    let mut found = PoseCollector::default();
    while let Some(message) = messages.next()? {
        let place = |e| Error::message(path, &message.channel.topic, message.log_time, e);
        found.take(&assignment, &message, time).map_err(place)?;
    }
    assignment.check_all_used(path, &found.topics, &found.frames)?;
    let topics = std::mem::take(&mut found.topics);
    let placed = std::mem::take(&mut found.frames);
    let lost = messages.truncation().cloned();
    let tracks = found.tracks();
    if tracks.is_empty() {
        let mut found = list_names(&topics);
        if !placed.is_empty() {
            found += &format!(" with the frames {}", list_names(&placed));
        }
        let expected = format!(
            "poses of one of {bodies:?}; name them with --map TOPIC=BODY, transforms with --map TOPIC:FRAME=BODY"
        );
        // The unreadable part may have had them.
        let lost = lost.map_or(String::new(), |lost| format!("; {lost}"));
        return Err(Error::unsuitable(path, "topics", expected, format!("{found}{lost}")));
    }
    frames::check_fixed(path, &tracks, &placed)?;
    join(path, tracks, begin_ns, lost)
}

/// Converts a stamp to ns; its nanoseconds must be less than a second.
fn stamp_ns(stamp: messages::Time) -> std::result::Result<i64, MessageError> {
    let rest = stamp.nanosec;
    let error = || MessageError::new("header.stamp.nanosec", "less than a second", rest);
    (rest < 1_000_000_000).then(|| stamp.ns()).ok_or_else(error)
}

/// Collector of poses and twists by body.
#[derive(Default)]
struct PoseCollector {
    topics: BTreeSet<String>,
    frames: BTreeSet<String>,
    poses: BTreeMap<String, PoseTrack>,
    transforms: BTreeMap<String, PoseTrack>,
    static_transforms: BTreeMap<String, PoseTrack>,
    /// Topic of the poses and of the twists of each body.
    sources: BTreeMap<(&'static str, String), String>,
    /// Memory of all these, bytes.
    bytes: u64,
}

impl PoseCollector {
    fn take(
        &mut self,
        assignment: &Assignment,
        message: &McapMessage,
        clock: TimeSource,
    ) -> std::result::Result<(), MessageError> {
        let at = |stamp: Option<i64>| match (clock, stamp) {
            (TimeSource::Stamp, Some(ns)) => u64::try_from(ns).map_err(|_| {
                let found = format!("{ns}; use the times of recording with --time log");
                MessageError::new("header.stamp", "a time from 0 ns on", found)
            }),
            _ => Ok(message.log_time),
        };
        let topic = &message.channel.topic;
        let log_ns = message.log_time;
        let mut more = series::insert_name(&mut self.topics, topic);
        let channel_use = assignment.source(&message.channel)?;
        if let Some(found) = describe_message(&message.data).filter(|_| channel_use.has_motion()) {
            return Err(MessageError::new("message", "one without compression", found));
        }
        match channel_use {
            ChannelUse::Other => {}
            ChannelUse::Pose(body) => {
                self.check_single_source(assignment, "poses", body, topic)?;
                let stamped: PoseStamped = from_cdr(&message.data)?;
                let time_ns = at(Some(stamp_ns(stamped.header.stamp)?))?;
                values::check_pose(["pose.position", "pose.orientation"], &stamped.pose)?;
                let pose = StampedValue { time_ns, log_ns, value: stamped.pose };
                more += self.track(body).poses.push(topic, &stamped.header.frame_id, pose);
            }
            ChannelUse::Twist(body) => {
                self.check_single_source(assignment, "twists", body, topic)?;
                let stamped: TwistStamped = from_cdr(&message.data)?;
                let time_ns = at(Some(stamp_ns(stamped.header.stamp)?))?;
                values::check_twist(&stamped.twist)?;
                let twist = StampedValue { time_ns, log_ns, value: stamped.twist };
                more += self.track(body).twists.push(topic, &stamped.header.frame_id, twist);
            }
            ChannelUse::Json(body) => {
                self.check_single_source(assignment, "poses", body, topic)?;
                let read = json_pose::read(&message.data)?;
                let time_ns = at(read.stamp_ns)?;
                values::check_pose(["position", "orientation"], &read.pose)?;
                let pose = StampedValue { time_ns, log_ns, value: read.pose };
                more += self.track(body).poses.push(topic, &read.frame, pose);
                if let Some(value) = read.twist {
                    values::check_twist(&value)?;
                    let twist = StampedValue { time_ns, log_ns, value };
                    more += self.track(body).twists.push(topic, &read.frame, twist);
                }
            }
            ChannelUse::Transforms => {
                let tf: TFMessage = from_cdr(&message.data)?;
                for transform in tf.transforms {
                    let frame = &transform.child_frame_id;
                    let source = format!("{topic}:{frame}");
                    if let Some(body) = assignment.body_of_frame(topic, frame) {
                        self.check_single_source(assignment, "poses", body, &source)?;
                        let time = || at(Some(stamp_ns(transform.header.stamp)?));
                        more += self.take_transform(body, &source, &transform, log_ns, time)?;
                    }
                    more += series::insert_name(&mut self.frames, &source);
                }
            }
            ChannelUse::Frames => {
                // These transforms move nothing, so an invalid one does no harm.
                let tf = from_cdr::<TFMessage>(&message.data).unwrap_or_default();
                for transform in tf.transforms {
                    let frame = format!("{topic}:{}", transform.child_frame_id);
                    more += series::insert_name(&mut self.frames, &frame);
                }
            }
        }
        self.hold(more)
    }

    /// Adds a transform from `source` to the motion of a body; returns the additional memory in bytes. The stamp of a static
    /// transform has no meaning.
    fn take_transform(
        &mut self,
        body: &str,
        source: &str,
        transform: &TransformStamped,
        log_ns: u64,
        time: impl Fn() -> std::result::Result<u64, MessageError>,
    ) -> std::result::Result<usize, MessageError> {
        let Vector3 { x, y, z } = transform.transform.translation;
        let orientation = transform.transform.rotation;
        let value = messages::Pose { position: messages::Point { x, y, z }, orientation };
        let fault = |e: MessageError| {
            let place = format!("transform of {:?}, {}", transform.child_frame_id, e.place);
            MessageError { place, ..e }
        };
        values::check_pose(["translation", "rotation"], &value).map_err(fault)?;
        let is_static = assignment::is_static(source);
        let (tracks, time_ns, log_ns) = match is_static {
            true => (&mut self.static_transforms, 0, 0),
            false => (&mut self.transforms, time()?, log_ns),
        };
        let poses = &mut tracks.entry(body.into()).or_default().poses;
        if is_static && poses.samples.first().is_some_and(|first| first.value != value) {
            let found = "two that differ; leave one out";
            return Err(fault(MessageError::new("pose", "one for all times", found)));
        }
        Ok(poses.push(source, &transform.header.frame_id, StampedValue { time_ns, log_ns, value }))
    }

    /// Counts `more` bytes of memory, which is limited to that of a chunk.
    fn hold(&mut self, more: usize) -> std::result::Result<(), MessageError> {
        self.bytes += more as u64;
        if self.bytes > MAX_CHUNK_BYTES {
            let expected =
                format!("at most {MAX_CHUNK_BYTES} bytes of poses, twists and names up to here");
            return Err(MessageError::new("motion", expected, "more"));
        }
        Ok(())
    }

    /// Refuses a second source of a body's poses or twists. Without maps, a body's own topic takes precedence over
    /// transforms.
    fn check_single_source(
        &mut self,
        assignment: &Assignment,
        what: &'static str,
        body: &str,
        source: &str,
    ) -> std::result::Result<(), MessageError> {
        if assignment.is_default() {
            return Ok(());
        }
        let first = self.sources.entry((what, body.into())).or_insert_with(|| source.into());
        if first == source {
            return Ok(());
        }
        let expected = format!("one source of the {what} of {body:?}");
        Err(MessageError::new("map", expected, format!("{first} and {source}")))
    }

    fn track(&mut self, body: &str) -> &mut PoseTrack {
        self.poses.entry(body.into()).or_default()
    }

    /// Returns one track per body; its own topic takes precedence over transforms, and these over static ones.
    fn tracks(self) -> BTreeMap<String, PoseTrack> {
        let mut tracks = self.static_transforms;
        tracks.extend(self.transforms);
        for (body, track) in self.poses {
            if !track.poses.samples.is_empty() {
                tracks.insert(body, track);
            } else if let Some(transforms) = tracks.get_mut(&body) {
                transforms.twists = track.twists;
            }
        }
        tracks
    }
}

/// Joins the tracks over their common time.
fn join(
    path: &Path,
    tracks: BTreeMap<String, PoseTrack>,
    begin_ns: u64,
    lost: Option<Truncation>,
) -> Result<RecordedMotion> {
    let (mut waveforms, mut still) = (Vec::new(), Vec::new());
    let (mut notes, mut warnings) = (frames::notes(&tracks), Vec::new());
    let (mut contradicted, mut worst) = (Vec::new(), 0.0_f64);
    for (body, track) in tracks {
        let motion = track.motion(&body);
        let motion = motion.map_err(|e| Error::damaged(path, e.place, e.expected, e.found))?;
        let TrackMotion { waveform, notes: more, warnings: doubts } = motion;
        notes.extend(more);
        warnings.extend(doubts);
        if let Some(share) = track::contradiction(&waveform) {
            contradicted.push(body.clone());
            worst = share.max(worst);
        }
        match waveform.knots.len() {
            1 => still.push((body, waveform)),
            _ => waveforms.push((body, waveform)),
        }
    }
    let [start, end] = coverage::common_time(path, &waveforms)?;
    coverage::check_gaps(path, &waveforms, [start, end])?;
    if !contradicted.is_empty() {
        warnings.push(format!(
            "twists of {}: expected velocities (m/s, in the axes of the bed) that lead from pose to pose, found some \
             that miss up to {:.0} % of the displacement; they are used nevertheless. In a file without twists, motions \
             between poses are linear",
            contradicted.join(", "),
            100.0 * worst
        ));
    }
    notes.extend(coverage::notes(&waveforms, [start, end]));
    still.iter_mut().for_each(|(_, waveform)| track::hold(waveform, [start, end]));
    waveforms.append(&mut still);
    waveforms.sort_by(|(a, _), (b, _)| a.cmp(b));
    let inputs = waveforms.into_iter().map(|(body, waveform)| MotionInput {
        body,
        waveform: track::cut(waveform, start, begin_ns),
        allow_jump: false,
    });
    let end_ns = begin_ns.saturating_add(end - start);
    Ok(RecordedMotion {
        inputs: inputs.collect(),
        start_ns: begin_ns,
        end_ns,
        notes,
        warnings,
        truncation: lost,
    })
}

#[cfg(test)]
mod tests;
