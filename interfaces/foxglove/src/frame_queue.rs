//! Queue of states between the computing thread and the thread that sends them.
//!
//! Contract: a lock is held while a frame is moved and not longer. No thread waits for room: the oldest frame is dropped.

use ballast::model::Model;
use ballast::state::State;
use ballast_protocol::messages::AdvanceReply;
use foxglove::websocket::{ChannelView, Client, ServerListener};
use std::collections::VecDeque;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Maximum number of queued frames while a viewer is connected.
const MAX_FRAMES: usize = 4;

/// State at the end of a window, with its results.
pub(crate) struct LiveFrame {
    pub model: Arc<Model>,
    pub state: Arc<State>,
    /// `None`: no window has led to this state.
    pub reply: Option<AdvanceReply>,
}

/// Reason for which the sending thread wakes up.
pub(crate) enum QueueEvent {
    /// Another run, or the same from another state.
    Restart,
    /// A viewer has connected or subscribed, and has seen nothing yet.
    Subscription,
    /// The next frame.
    Frame(Arc<LiveFrame>),
    /// The timeout has passed.
    Timeout,
    /// The live view ends.
    End,
}

#[derive(Default)]
struct QueueContent {
    frames: VecDeque<Arc<LiveFrame>>,
    has_restarted: bool,
    has_subscription: bool,
    is_closed: bool,
}

/// Queue of frames and events.
#[derive(Default)]
pub(crate) struct FrameQueue {
    content: Mutex<QueueContent>,
    wake: Condvar,
    viewers: AtomicUsize,
}

impl FrameQueue {
    fn lock(&self) -> MutexGuard<'_, QueueContent> {
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns true if a viewer is connected.
    pub fn has_viewers(&self) -> bool {
        self.viewers.load(Relaxed) > 0
    }

    /// Appends a frame; without viewers, the queue has the newest one alone and the sending thread sleeps.
    pub fn push(&self, frame: LiveFrame) {
        let has_viewers = self.has_viewers();
        let max_frames = if has_viewers { MAX_FRAMES } else { 1 };
        let mut content = self.lock();
        while content.frames.len() >= max_frames {
            content.frames.pop_front();
        }
        content.frames.push_back(Arc::new(frame));
        drop(content);
        if has_viewers {
            self.wake.notify_one();
        }
    }

    /// Drops all frames, because the run continues from another state.
    pub fn restart(&self) {
        let mut content = self.lock();
        content.frames.clear();
        content.has_restarted = true;
    }

    /// Ends the sending thread.
    pub fn close(&self) {
        self.lock().is_closed = true;
        self.wake.notify_one();
    }

    fn note_subscription(&self) {
        self.lock().has_subscription = true;
        self.wake.notify_one();
    }

    /// Waits for the next event, without `timeout` for any time.
    pub fn next(&self, timeout: Option<Duration>) -> QueueEvent {
        let is_idle = |content: &mut QueueContent| {
            let QueueContent { frames, has_restarted, has_subscription, is_closed } = content;
            frames.is_empty() && !(*has_restarted || *has_subscription || *is_closed)
        };
        let (content, wake) = (self.lock(), &self.wake);
        let mut content = match timeout {
            None => wake.wait_while(content, is_idle).unwrap_or_else(PoisonError::into_inner),
            Some(timeout) => {
                let woken = wake.wait_timeout_while(content, timeout, is_idle);
                woken.unwrap_or_else(PoisonError::into_inner).0
            }
        };
        if content.is_closed {
            QueueEvent::End
        } else if std::mem::take(&mut content.has_restarted) {
            QueueEvent::Restart
        } else if std::mem::take(&mut content.has_subscription) {
            QueueEvent::Subscription
        } else {
            content.frames.pop_front().map_or(QueueEvent::Timeout, QueueEvent::Frame)
        }
    }
}

impl ServerListener for FrameQueue {
    fn on_client_connect(&self) {
        self.viewers.fetch_add(1, Relaxed);
        self.note_subscription();
    }

    fn on_client_disconnect(&self) {
        self.viewers.fetch_sub(1, Relaxed);
    }

    fn on_subscribe(&self, _: Client, _: ChannelView) {
        self.note_subscription();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame_at(time_ns: u64) -> LiveFrame {
        let state = State { time_ns, ..State::default() };
        let model = ballast_protocol::lockstep::empty_model();
        LiveFrame { model: Arc::new(model), state: Arc::new(state), reply: None }
    }

    /// Returns the times of all queued frames.
    fn times(queue: &FrameQueue) -> Vec<u64> {
        let next = || match queue.next(Some(Duration::ZERO)) {
            QueueEvent::Frame(frame) => Some(frame.state.time_ns),
            _ => None,
        };
        std::iter::from_fn(next).collect()
    }

    #[test]
    fn the_newest_frames_are_sent_and_only_the_last_without_a_viewer() {
        let queue = FrameQueue::default();
        (0..10).for_each(|time_ns| queue.push(frame_at(time_ns)));
        assert_eq!(times(&queue), [9]);
        queue.on_client_connect();
        (0..10).for_each(|time_ns| queue.push(frame_at(time_ns)));
        assert!(matches!(queue.next(None), QueueEvent::Subscription));
        assert_eq!(times(&queue), [6, 7, 8, 9]);
        // Results of a run that was replaced are not shown after its replacement.
        queue.push(frame_at(10));
        queue.restart();
        queue.push(frame_at(0));
        assert!(matches!(queue.next(None), QueueEvent::Restart));
        assert_eq!(times(&queue), [0]);
        queue.on_client_disconnect();
        assert!(!queue.has_viewers());
        queue.close();
        assert!(matches!(queue.next(None), QueueEvent::End));
    }
}
