//! Which topic moves which body.

use super::few;
use crate::entry::topic_part;
use crate::error::{Error, Result};
use crate::messages::Channel;
use ballast_protocol::MessageError;
use std::collections::BTreeSet;
use std::path::Path;

/// A topic, or a frame of a topic with transforms, that moves a body.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Map {
    pub topic: String,
    /// Child frame, for topics with transforms; by default the body's name.
    pub frame: Option<String>,
    pub body: String,
}

/// `TOPIC=BODY` or `TOPIC:FRAME=BODY`.
impl std::str::FromStr for Map {
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

/// What a channel is good for.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Source<'a> {
    Other,
    Pose(&'a str),
    Twist(&'a str),
    Json(&'a str),
    Transforms,
    /// Transforms that move nothing; they tell which frames the file places.
    Frames,
}

pub(super) struct Assignment {
    maps: Vec<Map>,
    /// The maps are the default ones: nobody asked for them.
    by_default: bool,
}

impl Assignment {
    pub fn new(path: &Path, bodies: &[String], maps: &[Map]) -> Result<Self> {
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
            let pose = Map { topic, frame: None, body: body.clone() };
            [pose, Map { topic: "/tf".into(), frame: Some(body.clone()), body: body.clone() }]
        };
        Ok(Self { maps: bodies.iter().flat_map(default).collect(), by_default: true })
    }

    /// Whether nobody asked for it.
    pub fn is_default(&self) -> bool {
        self.by_default
    }

    pub fn source(&self, channel: &Channel) -> std::result::Result<Source<'_>, MessageError> {
        let topic = &channel.topic;
        let (encoding, kind) = (&channel.encoding[..], channel.schema.replacen("/msg/", "/", 1));
        let is = |name: &str| encoding == "cdr" && kind == name;
        let mut maps = self.maps.iter().filter(|m| m.topic == *topic);
        if let Some(map) = maps.next() {
            let source = match encoding {
                "json" => Source::Json(&map.body),
                _ if is("geometry_msgs/PoseStamped") => Source::Pose(&map.body),
                _ if is("geometry_msgs/TwistStamped") => Source::Twist(&map.body),
                _ if is("tf2_msgs/TFMessage") => Source::Transforms,
                _ => {
                    let expected = "geometry_msgs/PoseStamped, TwistStamped or tf2_msgs/TFMessage in \
                                    CDR, or JSON";
                    let found = format!("{:?} in {encoding:?}", channel.schema);
                    return Err(MessageError::new("type", expected, found));
                }
            };
            return match (&source, maps.next()) {
                (Source::Transforms, _) | (_, None) => Ok(source),
                (_, Some(other)) => {
                    let expected = "one body for a topic that is of one";
                    let found = format!("{:?} and {:?}", map.body, other.body);
                    Err(MessageError::new("map", expected, found))
                }
            };
        }
        // The twists of a pose topic are beside it.
        let beside = |m: &&Map| {
            let stem = m.topic.strip_suffix("/pose");
            stem.is_some() && topic.strip_suffix("/twist") == stem
        };
        match self.maps.iter().find(beside) {
            Some(map) if is("geometry_msgs/TwistStamped") => Ok(Source::Twist(&map.body)),
            _ if is("tf2_msgs/TFMessage") => Ok(Source::Frames),
            _ => Ok(Source::Other),
        }
    }

    pub fn body_of_frame(&self, topic: &str, frame: &str) -> Option<&str> {
        let fits = |m: &&Map| m.topic == topic && m.frame.as_deref().unwrap_or(&m.body) == frame;
        self.maps.iter().find(fits).map(|m| &m.body[..])
    }

    /// Whether every map that was asked for met something.
    pub fn all_used(
        &self,
        path: &Path,
        topics: &BTreeSet<String>,
        frames: &BTreeSet<String>,
    ) -> Result<()> {
        let frame = |m: &Map| format!("{}:{}", m.topic, m.frame.as_ref().unwrap_or(&m.body));
        let is_of_frames = |m: &Map| frames.iter().any(|f| f.starts_with(&format!("{}:", m.topic)));
        let known = |m: &&Map| match m.frame {
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
                Err(Error::unsuitable(path, "topics", wanted, few(found)))
            }
            _ => Ok(()),
        }
    }
}
