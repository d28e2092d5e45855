//! Motion of bodies from the poses in any MCAP file.
//!
//! Reads: `geometry_msgs/PoseStamped`, `TwistStamped` and `tf2_msgs/TFMessage` in CDR, poses in JSON.
//! Contract (rules of resampling): a knot per pose message, at its time. The motion of a body is cubic if every pose has a
//! twist of the same time, otherwise linear. Nothing is extrapolated: a motion covers the time that the messages of all
//! mapped bodies have in common.

mod assignment;
mod coverage;
mod frames;
mod json_pose;
mod track;

pub use assignment::TopicMap;

use crate::chunk::MAX_CHUNK_BYTES;
use crate::error::{Error, Result};
use crate::messages::{McapMessage, MessageReader, Truncation};
use assignment::{Assignment, ChannelUse, list_names};
use ballast::component::MotionInput;
use ballast_protocol::messages::{PoseStamped, TFMessage, TwistStamped};
use ballast_protocol::{MessageError, from_cdr, messages};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use track::PoseTrack;

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
            (TimeSource::Stamp, Some(ns)) => u64::try_from(ns)
                .map_err(|_| MessageError::new("header.stamp", "a time from 0 on", ns)),
            _ => Ok(message.log_time),
        };
        let mut more = track::insert_name(&mut self.topics, &message.channel.topic);
        match assignment.source(&message.channel)? {
            ChannelUse::Other => {}
            ChannelUse::Pose(body) => {
                self.check_single_source(assignment, "poses", body, &message.channel.topic)?;
                let stamped: PoseStamped = from_cdr(&message.data)?;
                let time = at(Some(stamp_ns(stamped.header.stamp)?))?;
                more += self.track(body).pose(time, stamped.pose, &stamped.header.frame_id);
            }
            ChannelUse::Twist(body) => {
                self.check_single_source(assignment, "twists", body, &message.channel.topic)?;
                let stamped: TwistStamped = from_cdr(&message.data)?;
                let time = at(Some(stamp_ns(stamped.header.stamp)?))?;
                more += self.track(body).twist(time, stamped.twist, &stamped.header.frame_id);
            }
            ChannelUse::Json(body) => {
                self.check_single_source(assignment, "poses", body, &message.channel.topic)?;
                let read = json_pose::read(&message.data)?;
                let time = at(read.stamp_ns)?;
                more += self.track(body).pose(time, read.pose, &read.frame);
                if let Some(twist) = read.twist {
                    more += self.track(body).twist(time, twist, &read.frame);
                }
            }
            ChannelUse::Transforms => {
                let tf: TFMessage = from_cdr(&message.data)?;
                for transform in tf.transforms {
                    let frame = transform.child_frame_id;
                    let topic = &message.channel.topic;
                    if let Some(body) = assignment.body_of_frame(topic, &frame) {
                        self.check_single_source(
                            assignment,
                            "poses",
                            body,
                            &format!("{topic}:{frame}"),
                        )?;
                        let time = at(Some(stamp_ns(transform.header.stamp)?))?;
                        let pose = messages::Pose {
                            position: messages::Point {
                                x: transform.transform.translation.x,
                                y: transform.transform.translation.y,
                                z: transform.transform.translation.z,
                            },
                            orientation: transform.transform.rotation,
                        };
                        let parent = &transform.header.frame_id;
                        let track = self.transforms.entry(body.into()).or_default();
                        more += track.pose(time, pose, parent);
                    }
                    more += track::insert_name(&mut self.frames, &format!("{topic}:{frame}"));
                }
            }
            ChannelUse::Frames => {
                // These transforms move nothing, so an invalid one does no harm.
                let tf = from_cdr::<TFMessage>(&message.data).unwrap_or_default();
                let topic = &message.channel.topic;
                for transform in tf.transforms {
                    let frame = format!("{topic}:{}", transform.child_frame_id);
                    more += track::insert_name(&mut self.frames, &frame);
                }
            }
        }
        self.hold(more)
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

    /// Returns one track per body; its own topic takes precedence over transforms.
    fn tracks(self) -> BTreeMap<String, PoseTrack> {
        let mut tracks = self.transforms;
        for (body, mut track) in self.poses {
            if track.has_poses() {
                tracks.insert(body, track);
            } else if let Some(transforms) = tracks.get_mut(&body) {
                transforms.take_twists(&mut track);
            }
        }
        tracks.retain(|_, track| track.has_poses());
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
    let mut waveforms = Vec::new();
    let mut notes = frames::notes(&tracks);
    let (mut contradicted, mut worst) = (Vec::new(), 0.0_f64);
    for (body, track) in tracks {
        let (waveform, note) = track.waveform().map_err(|e| {
            Error::damaged(path, format!("poses of {body:?}, {}", e.place), e.expected, e.found)
        })?;
        notes.push(format!("{body}: {note}"));
        if let Some(share) = track::contradiction(&waveform) {
            contradicted.push(body.clone());
            worst = share.max(worst);
        }
        waveforms.push((body, waveform));
    }
    let ends = |pick: fn(&ballast::component::Waveform) -> Option<u64>| {
        waveforms.iter().filter_map(move |(_, w)| pick(w))
    };
    let start = ends(|w| w.knots.first().map(|k| k.time_ns)).max().unwrap_or_default();
    let end = ends(|w| w.knots.last().map(|k| k.time_ns)).min().unwrap_or_default();
    if start > end {
        let expected = "a time with poses of all bodies";
        let found = format!("the last to begin at {start} ns, the first to end at {end} ns");
        return Err(Error::unsuitable(path, "times", expected, found));
    }
    let warnings = (!contradicted.is_empty()).then(|| {
        format!(
            "twists of {}: expected velocities (m/s, in the axes of the bed) that lead from pose to pose, found some \
             that miss up to {:.0} % of the displacement; they are used nevertheless. In a file without twists, motions \
             between poses are linear",
            contradicted.join(", "),
            100.0 * worst
        )
    });
    notes.extend(coverage::notes(&waveforms, [start, end]));
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
        warnings: Vec::from_iter(warnings),
        truncation: lost,
    })
}

#[cfg(test)]
mod tests;
