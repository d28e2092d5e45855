//! The motion of bodies from the poses in any MCAP file.
//!
//! Reads: `geometry_msgs/PoseStamped`, `TwistStamped` and `tf2_msgs/TFMessage` in CDR, poses in JSON.
//! Contract (rules of resampling): a knot per pose message, at its time; with a twist of the same time
//! for every pose of a body the motion is cubic, otherwise linear; nothing is extrapolated, so a motion
//! covers the stretch of time that the messages of all mapped bodies have in common.

mod assign;
mod frames;
mod json_pose;
mod knots;
mod stretch;

pub use assign::Map;

use crate::chunk::LARGEST;
use crate::error::{Error, Result};
use crate::messages::{Lost, Message, Messages};
use assign::{Assignment, Source};
use ballast::component::MotionInput;
use ballast_protocol::messages::{PoseStamped, TFMessage, Twist, TwistStamped};
use ballast_protocol::{MessageError, from_cdr, messages};
use knots::Track;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Which of a message's times counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TimeOf {
    /// The stamp in the message: when the pose was true.
    #[default]
    Stamp,
    /// When the message was recorded.
    Log,
}

/// The motion of some bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// One per mapped body, in the order of the bodies' names.
    pub inputs: Vec<MotionInput>,
    /// The stretch of time that all inputs cover, ns of the run.
    pub start_ns: u64,
    pub end_ns: u64,
    /// What the person should know: interpolation of each body, topics.
    pub notes: Vec<String>,
    /// What is more likely a slip than meant.
    pub warnings: Vec<String>,
    pub lost: Option<Lost>,
}

/// Reads the motion of `bodies`.
///
/// Without `maps`, the topic `/<body>/pose` and the transform to the frame `<body>` belong to a body; with
/// them, only what they name. The stretch that the bodies have in common is shifted to begin at
/// `begin_ns` of the run.
///
/// # Errors
/// The system refuses; no MCAP file; a map to no body, or of a topic that the file lacks or that holds no
/// poses; messages that cannot be read, out of order, or with nothing in common.
pub fn read(
    path: &Path,
    bodies: &[String],
    maps: &[Map],
    time: TimeOf,
    begin_ns: u64,
) -> Result<Motion> {
    let assignment = Assignment::new(path, bodies, maps)?;
    let mut messages = Messages::open(path)?;
    let mut found = Found::default();
    while let Some(message) = messages.next()? {
        let place = |e| Error::message(path, &message.channel.topic, message.log_time, e);
        found.take(&assignment, &message, time).map_err(place)?;
    }
    assignment.all_used(path, &found.topics, &found.frames)?;
    let topics = std::mem::take(&mut found.topics);
    let placed = std::mem::take(&mut found.frames);
    let lost = messages.lost().cloned();
    let tracks = found.tracks();
    if tracks.is_empty() {
        let mut found = few(&topics);
        if !placed.is_empty() {
            found += &format!(" with the frames {}", few(&placed));
        }
        let expected = format!(
            "poses of one of {bodies:?}; name them with --map TOPIC=BODY, transforms with --map TOPIC:FRAME=BODY"
        );
        // What is damaged may have held them.
        let lost = lost.map_or(String::new(), |lost| format!("; {lost}"));
        return Err(Error::unsuitable(path, "topics", expected, format!("{found}{lost}")));
    }
    frames::expect_still(path, &tracks, &placed)?;
    join(path, tracks, begin_ns, lost)
}

/// Names for a message: the first ones, and how many more there are.
fn few(names: &BTreeSet<String>) -> String {
    const MOST: usize = 40;
    let told = format!("{:?}", names.iter().take(MOST).collect::<Vec<_>>());
    match names.len().saturating_sub(MOST) {
        0 => told,
        more => format!("{told} and {more} more"),
    }
}

/// A stamp as ns; one with a second and more beside its seconds is none.
fn whole(stamp: messages::Time) -> std::result::Result<i64, MessageError> {
    let rest = stamp.nanosec;
    let wrong = || MessageError::new("header.stamp.nanosec", "less than a second", rest);
    (rest < 1_000_000_000).then(|| stamp.ns()).ok_or_else(wrong)
}

/// Poses and twists by body.
#[derive(Default)]
struct Found {
    topics: BTreeSet<String>,
    frames: BTreeSet<String>,
    poses: BTreeMap<String, Track>,
    transforms: BTreeMap<String, Track>,
    /// What has moved each body so far, by what it tells.
    sources: BTreeMap<(&'static str, String), String>,
    /// Bytes of all these.
    held: u64,
}

impl Found {
    fn take(
        &mut self,
        assignment: &Assignment,
        message: &Message,
        clock: TimeOf,
    ) -> std::result::Result<(), MessageError> {
        let at = |stamp: Option<i64>| match (clock, stamp) {
            (TimeOf::Stamp, Some(ns)) => u64::try_from(ns)
                .map_err(|_| MessageError::new("header.stamp", "a time from 0 on", ns)),
            _ => Ok(message.log_time),
        };
        let mut more = knots::note(&mut self.topics, &message.channel.topic);
        match assignment.source(&message.channel)? {
            Source::Other => {}
            Source::Pose(body) => {
                self.only(assignment, "poses", body, &message.channel.topic)?;
                let stamped: PoseStamped = from_cdr(&message.data)?;
                let time = at(Some(whole(stamped.header.stamp)?))?;
                more += self.track(body).pose(time, stamped.pose, &stamped.header.frame_id);
            }
            Source::Twist(body) => {
                self.only(assignment, "twists", body, &message.channel.topic)?;
                let stamped: TwistStamped = from_cdr(&message.data)?;
                let time = at(Some(whole(stamped.header.stamp)?))?;
                more += self.track(body).twist(time, stamped.twist, &stamped.header.frame_id);
            }
            Source::Json(body) => {
                self.only(assignment, "poses", body, &message.channel.topic)?;
                let read = json_pose::read(&message.data)?;
                let time = at(read.stamp_ns)?;
                more += self.track(body).pose(time, read.pose, &read.frame);
                if let Some(twist) = read.twist {
                    more += self.track(body).twist(time, twist, &read.frame);
                }
            }
            Source::Transforms => {
                let tf: TFMessage = from_cdr(&message.data)?;
                for transform in tf.transforms {
                    let frame = transform.child_frame_id;
                    let topic = &message.channel.topic;
                    if let Some(body) = assignment.body_of_frame(topic, &frame) {
                        self.only(assignment, "poses", body, &format!("{topic}:{frame}"))?;
                        let time = at(Some(whole(transform.header.stamp)?))?;
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
                    more += knots::note(&mut self.frames, &format!("{topic}:{frame}"));
                }
            }
            Source::Frames => {
                // Nothing is moved by them: one that cannot be read spoils nothing.
                let tf = from_cdr::<TFMessage>(&message.data).unwrap_or_default();
                let topic = &message.channel.topic;
                for transform in tf.transforms {
                    let frame = format!("{topic}:{}", transform.child_frame_id);
                    more += knots::note(&mut self.frames, &frame);
                }
            }
        }
        self.hold(more)
    }

    /// Notes that so many bytes more are kept: at most those of a chunk.
    fn hold(&mut self, more: usize) -> std::result::Result<(), MessageError> {
        self.held += more as u64;
        if self.held > LARGEST {
            let expected = format!("at most {LARGEST} bytes of poses, twists and names up to here");
            return Err(MessageError::new("motion", expected, "more"));
        }
        Ok(())
    }

    /// Refuses a second source of a body's poses or twists: two motions are not one. By default, a topic of its own
    /// counts before transforms.
    fn only(
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

    fn track(&mut self, body: &str) -> &mut Track {
        self.poses.entry(body.into()).or_default()
    }

    /// One track per body: a topic of its own counts before transforms.
    fn tracks(self) -> BTreeMap<String, Track> {
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

/// The tracks over the time that they have in common.
fn join(
    path: &Path,
    tracks: BTreeMap<String, Track>,
    begin_ns: u64,
    lost: Option<Lost>,
) -> Result<Motion> {
    let mut waveforms = Vec::new();
    let mut notes = frames::notes(&tracks);
    let (mut contradicted, mut most) = (Vec::new(), 0.0_f64);
    for (body, track) in tracks {
        let (waveform, note) = track.waveform().map_err(|e| {
            Error::damaged(path, format!("poses of {body:?}, {}", e.place), e.expected, e.found)
        })?;
        notes.push(format!("{body}: {note}"));
        if let Some(share) = knots::contradiction(&waveform) {
            contradicted.push(body.clone());
            most = share.max(most);
        }
        waveforms.push((body, waveform));
    }
    let ends = |pick: fn(&ballast::component::Waveform) -> Option<u64>| {
        waveforms.iter().filter_map(move |(_, w)| pick(w))
    };
    let start = ends(|w| w.knots.first().map(|k| k.time_ns)).max().unwrap_or_default();
    let end = ends(|w| w.knots.last().map(|k| k.time_ns)).min().unwrap_or_default();
    if start > end {
        let expected = "a stretch of time with poses of all bodies";
        let found = format!("the last to begin at {start} ns, the first to end at {end} ns");
        return Err(Error::unsuitable(path, "times", expected, found));
    }
    let warnings = (!contradicted.is_empty()).then(|| {
        format!(
            "twists of {}: expected velocities (m/s, in the axes of the bed) that lead from pose to pose, found some \
             that miss up to {:.0} % of the way; they are used all the same: from a file without them, motions \
             between poses are linear",
            contradicted.join(", "),
            100.0 * most
        )
    });
    notes.extend(stretch::notes(&waveforms, [start, end]));
    let inputs = waveforms.into_iter().map(|(body, waveform)| MotionInput {
        body,
        waveform: knots::cut(waveform, start, begin_ns),
        allow_jump: false,
    });
    let end_ns = begin_ns.saturating_add(end - start);
    Ok(Motion {
        inputs: inputs.collect(),
        start_ns: begin_ns,
        end_ns,
        notes,
        warnings: Vec::from_iter(warnings),
        lost,
    })
}

/// A twist that says nothing.
fn no_twist() -> Twist {
    Twist::default()
}

#[cfg(test)]
mod tests;
