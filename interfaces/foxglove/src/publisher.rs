//! Thread that encodes frames and sends them to viewers.
//!
//! Results are sent with every frame, pictures (points, polyhedra, arrows) at most 25 times per second. The polyhedra of
//! all grains are large: they come with every n-th picture, so that a picture has half a megabyte of them on average.

use crate::frame_queue::{FrameQueue, LiveFrame, QueueEvent};
use ballast_protocol::messages::{Message, PointCloud2, SceneUpdate, schema};
use ballast_protocol::{MessageError, TopicMessage, topics, visualization};
use foxglove::{
    ChannelBuilder, Context, PartialMetadata, RawChannel, Schema, WebSocketServerHandle,
};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Minimum wall time between two windows, which limits the work for viewers of a fast run.
const MIN_WINDOW_INTERVAL: Duration = Duration::from_millis(5);
/// Minimum wall time between two pictures.
const MIN_PICTURE_INTERVAL: Duration = Duration::from_millis(40);
/// Wall time after the last picture at which it is repeated with grains, if it had none.
const GRAINS_DELAY: Duration = Duration::from_secs(1);
/// Mean size of the polyhedra of grains per picture, bytes. With the length of the queue of a viewer, it limits the
/// memory for a viewer that does not read.
const MEAN_GRAIN_BYTES: usize = 512 << 10;

/// Sender of frames; lives on its thread.
pub(crate) struct LivePublisher {
    queue: Arc<FrameQueue>,
    server: WebSocketServerHandle,
    context: Arc<Context>,
    channels: BTreeMap<String, Arc<RawChannel>>,
    latest: Option<Arc<LiveFrame>>,
    /// Time of the last picture.
    pictured: Option<Instant>,
    has_new_frame: bool,
    /// True if the last picture had no grains.
    lacks_grains: bool,
    /// Number of pictures until the next one with grains.
    pictures_to_grains: usize,
}

impl LivePublisher {
    pub fn new(
        queue: Arc<FrameQueue>,
        server: WebSocketServerHandle,
        context: Arc<Context>,
    ) -> Self {
        let mut publisher = Self {
            queue,
            server,
            context,
            channels: BTreeMap::new(),
            latest: None,
            pictured: None,
            has_new_frame: false,
            lacks_grains: false,
            pictures_to_grains: 0,
        };
        // Encoded only for subscribers, who need a channel to subscribe to.
        publisher.open(topics::STONES, PointCloud2::NAME, schema::<PointCloud2>);
        publisher.open(topics::SCENE, SceneUpdate::NAME, schema::<SceneUpdate>);
        publisher
    }

    /// Sends frames until the queue is closed.
    pub fn run(mut self) {
        loop {
            match self.queue.next(self.time_to_picture()) {
                QueueEvent::End => break,
                QueueEvent::Restart => self.restart(),
                QueueEvent::Subscription => self.repeat_latest(),
                QueueEvent::Frame(frame) => {
                    self.send_results(&frame);
                    (self.latest, self.has_new_frame) = (Some(frame), true);
                }
                QueueEvent::Timeout => {}
            }
            if self.time_to_picture() == Some(Duration::ZERO) {
                self.send_picture();
            }
            std::thread::sleep(MIN_WINDOW_INTERVAL);
        }
        // Waiting for a viewer that does not read would take forever.
        self.server.stop().detach_all();
    }

    /// Returns the time until a picture is due, or `None` if there is nothing new or no viewer.
    fn time_to_picture(&self) -> Option<Duration> {
        let interval = match (self.has_new_frame, self.lacks_grains) {
            _ if !self.queue.has_viewers() => return None,
            (true, _) => MIN_PICTURE_INTERVAL,
            (false, true) => GRAINS_DELAY,
            (false, false) => return None,
        };
        Some(self.pictured.map_or(Duration::ZERO, |at| interval.saturating_sub(at.elapsed())))
    }

    /// Lets viewers forget what they have seen.
    fn restart(&mut self) {
        self.server.clear_session(None);
        (self.latest, self.pictured, self.pictures_to_grains) = (None, None, 0);
        (self.has_new_frame, self.lacks_grains) = (false, false);
    }

    /// Sends everything about the latest frame to a viewer that has just subscribed, and to the others.
    fn repeat_latest(&mut self) {
        let Some(frame) = self.latest.clone() else { return };
        self.send(topics::start_messages(&frame.model, &frame.state));
        self.send_results(&frame);
        (self.pictured, self.has_new_frame, self.pictures_to_grains) = (None, true, 0);
    }

    fn send_results(&mut self, frame: &LiveFrame) {
        self.server.broadcast_time(frame.state.time_ns);
        self.send(match &frame.reply {
            Some(reply) => topics::window_messages(&frame.model, &frame.state, reply),
            None => topics::start_messages(&frame.model, &frame.state),
        });
    }

    fn send_picture(&mut self) {
        let Some(frame) = self.latest.clone() else { return };
        let (model, state) = (&frame.model, &frame.state);
        if self.has_subscriber(topics::STONES) {
            self.send(topics::stones_message(model, state).map(|message| vec![message]));
        }
        let has_grains = self.pictures_to_grains == 0 || !self.has_new_frame;
        self.lacks_grains = false;
        if self.has_subscriber(topics::SCENE) {
            let forces = frame.reply.as_ref().map_or_else(Vec::new, visualization::forces);
            let scene = topics::scene_message(model, state, &forces, has_grains);
            self.pictures_to_grains = match &scene {
                Ok(scene) if has_grains => scene.bytes.len() / MEAN_GRAIN_BYTES,
                _ => self.pictures_to_grains.saturating_sub(1),
            };
            self.lacks_grains = !has_grains;
            self.send(scene.map(|message| vec![message]));
        }
        (self.pictured, self.has_new_frame) = (Some(Instant::now()), false);
    }

    fn has_subscriber(&self, topic: &str) -> bool {
        self.channels.get(topic).is_some_and(|channel| channel.has_sinks())
    }

    /// Sends messages; those that cannot be encoded have no viewer.
    fn send(&mut self, messages: Result<Vec<TopicMessage>, MessageError>) {
        for message in messages.into_iter().flatten() {
            if !self.channels.contains_key(&message.topic) {
                self.open(&message.topic, message.kind, message.schema);
            }
            if let Some(channel) = self.channels.get(&message.topic) {
                let time = PartialMetadata::with_log_time(message.time_ns);
                channel.log_with_meta(&message.bytes, time);
            }
        }
    }

    fn open(&mut self, topic: &str, kind: &str, schema: fn() -> String) {
        let channel = ChannelBuilder::new(topic)
            .context(&self.context)
            .message_encoding("cdr")
            .schema(Schema::new(kind, "ros2msg", schema().into_bytes()))
            .build_raw();
        // Fails only without an encoding.
        self.channels.extend(channel.ok().map(|channel| (topic.to_string(), channel)));
    }
}
