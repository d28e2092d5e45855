//! Assignment of topics and frames to bodies.

use crate::error::{Error, Result};
use crate::messages::ChannelInfo;
use ballast_protocol::{MessageError, topic_part};
use std::collections::BTreeSet;
use std::path::Path;

/// Topic, or frame of a topic with transforms, that moves a body.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicMap {
    /// Name of the topic.
    pub topic: String,
    /// Child frame, for topics with transforms; by default the body's name.
    pub frame: Option<String>,
    /// Name of the body.
    pub body: String,
}

/// Parses `TOPIC=BODY` or `TOPIC:FRAME=BODY`.
impl std::str::FromStr for TopicMap {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let parts = text.rsplit_once('=').filter(|(t, b)| !t.is_empty() && !b.is_empty());
        let Some((source, body)) = parts else {
            return Err(format!("expected TOPIC=BODY or TOPIC:FRAME=BODY, found {text:?}"));
        };
        let (topic, frame) = match source.split_once(':') {
            Some((topic, frame)) => (topic, Some(frame.to_string())),
            None => (source, None),
        };
        Ok(Self { topic: topic.into(), frame, body: body.into() })
    }
}

/// Use of a channel for the motion of a body.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum ChannelUse<'a> {
    Other,
    Pose(&'a str),
    Twist(&'a str),
    Json(&'a str),
    Transforms,
    /// Transforms that move nothing, but define frames.
    Frames,
}

impl ChannelUse<'_> {
    /// True if messages of the channel move bodies.
    pub fn has_motion(&self) -> bool {
        !matches!(self, Self::Other | Self::Frames)
    }
}

/// True if a topic, or a frame of it, has static transforms.
pub(super) fn is_static(source: &str) -> bool {
    let topic = source.split(':').next().unwrap_or_default();
    topic.rsplit('/').next() == Some("tf_static")
}

pub(super) struct Assignment {
    maps: Vec<TopicMap>,
    /// True if the caller gave no maps.
    by_default: bool,
}

impl Assignment {
    pub fn new(path: &Path, bodies: &[String], maps: &[TopicMap]) -> Result<Self> {
        if let Some(wrong) = maps.iter().find(|m| !bodies.contains(&m.body)) {
            let (place, expected) =
                (format!("map of {}", wrong.topic), format!("one of {bodies:?}"));
            return Err(Error::unsuitable(path, place, expected, format!("{:?}", wrong.body)));
        }
        if !maps.is_empty() {
            return Ok(Self { maps: maps.to_vec(), by_default: false });
        }
        let default = |body: &String| {
            let topic = format!("/{}/pose", topic_part(body));
            let map = |topic: String, frame| TopicMap { topic, frame, body: body.clone() };
            let frame = |topic: &str| map(topic.into(), Some(body.clone()));
            [map(topic, None), frame("/tf"), frame("/tf_static")]
        };
        Ok(Self { maps: bodies.iter().flat_map(default).collect(), by_default: true })
    }

    /// True if the caller gave no maps.
    pub fn is_default(&self) -> bool {
        self.by_default
    }

    pub fn source(
        &self,
        channel: &ChannelInfo,
    ) -> std::result::Result<ChannelUse<'_>, MessageError> {
        let topic = &channel.topic;
        let (encoding, kind) = (&channel.encoding[..], channel.schema.replacen("/msg/", "/", 1));
        let is = |name: &str| encoding == "cdr" && kind == name;
        let mut maps = self.maps.iter().filter(|m| m.topic == *topic);
        if let Some(map) = maps.next() {
            let source = match encoding {
                "json" => ChannelUse::Json(&map.body),
                _ if is("geometry_msgs/PoseStamped") => ChannelUse::Pose(&map.body),
                _ if is("geometry_msgs/TwistStamped") => ChannelUse::Twist(&map.body),
                _ if is("tf2_msgs/TFMessage") => ChannelUse::Transforms,
                _ => {
                    let expected = "geometry_msgs/PoseStamped, TwistStamped or tf2_msgs/TFMessage in \
                                    CDR, or JSON";
                    let found =
                        format!("{:?} in {encoding:?}; convert it to one of these", channel.schema);
                    return Err(MessageError::new("type", expected, found));
                }
            };
            return match (&source, maps.next()) {
                (ChannelUse::Transforms, _) | (_, None) => Ok(source),
                (_, Some(other)) => {
                    let expected = "one body for a topic of one body";
                    let found = format!("{:?} and {:?}", map.body, other.body);
                    Err(MessageError::new("map", expected, found))
                }
            };
        }
        // The twist topic of a pose topic has the same stem.
        let has_same_stem = |m: &&TopicMap| {
            let stem = m.topic.strip_suffix("/pose");
            stem.is_some() && topic.strip_suffix("/twist") == stem
        };
        match self.maps.iter().find(has_same_stem) {
            Some(map) if is("geometry_msgs/TwistStamped") => Ok(ChannelUse::Twist(&map.body)),
            _ if is("tf2_msgs/TFMessage") => Ok(ChannelUse::Frames),
            _ => Ok(ChannelUse::Other),
        }
    }

    pub fn body_of_frame(&self, topic: &str, frame: &str) -> Option<&str> {
        let fits =
            |m: &&TopicMap| m.topic == topic && m.frame.as_deref().unwrap_or(&m.body) == frame;
        self.maps.iter().find(fits).map(|m| &m.body[..])
    }

    /// Checks that every map of the caller has a topic or frame in the file.
    pub fn check_all_used(
        &self,
        path: &Path,
        topics: &BTreeSet<String>,
        frames: &BTreeSet<String>,
    ) -> Result<()> {
        let frame = |m: &TopicMap| format!("{}:{}", m.topic, m.frame.as_ref().unwrap_or(&m.body));
        let is_of_frames =
            |m: &TopicMap| frames.iter().any(|f| f.starts_with(&format!("{}:", m.topic)));
        let known = |m: &&TopicMap| match m.frame {
            None if !is_of_frames(m) => topics.contains(&m.topic),
            _ => frames.contains(&frame(m)),
        };
        for (k, map) in self.maps.iter().enumerate().filter(|(_, m)| is_of_frames(m)) {
            if let Some(other) = self.maps[..k].iter().find(|other| frame(other) == frame(map)) {
                let found = format!("{:?} and {:?}", other.body, map.body);
                return Err(Error::unsuitable(path, frame(map), "one body for a frame", found));
            }
        }
        match self.maps.iter().find(|m| !known(m)) {
            Some(map) if !self.by_default => {
                let found = if map.frame.is_some() { frames } else { topics };
                let wanted = map.frame.as_ref().map_or(String::new(), |frame| format!(":{frame}"));
                let wanted = format!("{}{wanted}", map.topic);
                Err(Error::unsuitable(path, "topics", wanted, list_names(found)))
            }
            _ => Ok(()),
        }
    }
}

/// Lists the first names for a message, and the number of the others.
pub(super) fn list_names(names: &BTreeSet<String>) -> String {
    const MAX_NAMES: usize = 40;
    let list = format!("{:?}", names.iter().take(MAX_NAMES).collect::<Vec<_>>());
    match names.len().saturating_sub(MAX_NAMES) {
        0 => list,
        more => format!("{list} and {more} more"),
    }
}
