//! Visualization stream for viewers, on a separate session.
//!
//! Contract: the computing thread hands over a state, or skips it while the previous one is being sent; it never
//! waits. Messages that a viewer does not accept are dropped.

use crate::wire::cdr;
use crate::{Error, Keys, Purpose, SessionConfig};
use ballast::component::Component;
use ballast::math::Vec3;
use ballast::model::Model;
use ballast::state::State;
use ballast_protocol::messages::{AdvanceReply, Message};
use ballast_protocol::{to_cdr, visualization};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

/// Number of point clouds per scene of polyhedra, which is many times larger.
const CLOUDS_PER_SCENE: u64 = 5;

/// State and forces to visualize.
struct ViewerFrame {
    model: Arc<Model>,
    state: Arc<State>,
    /// Forces on the driven bodies, N `[nd]`.
    forces: Vec<Vec3>,
}

/// Thread that sends visualizations.
pub(super) struct ViewerStream {
    pub endpoints: Vec<String>,
    interval: Duration,
    shown: Option<Instant>,
    frames: Option<SyncSender<ViewerFrame>>,
    thread: Option<JoinHandle<()>>,
}

impl ViewerStream {
    /// Starts the thread; it sends at most one visualization per `interval`.
    pub fn start(link: &SessionConfig, keys: &Keys, interval: Duration) -> Result<Self, Error> {
        let session = link.open_for(Purpose::Viewer)?;
        // At most one frame is queued; the next one is newer.
        let (sender, frames) = sync_channel(1);
        let keys = keys.clone();
        let thread = std::thread::Builder::new().name("viewer".into());
        let thread = thread.spawn(move || send_all(&session, &keys, &frames));
        let thread = Some(thread.map_err(|e| Error::transport("viewer", e))?);
        let (endpoints, frames) = (link.listen.clone(), Some(sender));
        Ok(Self { endpoints, interval, shown: None, frames, thread })
    }

    /// Sends the state and the forces of the last window, unless the interval has not passed.
    pub fn show(&mut self, component: &Component, reply: Option<&AdvanceReply>) {
        if self.shown.is_some_and(|at| at.elapsed() < self.interval) {
            return;
        }
        let frame = ViewerFrame {
            model: component.shared_model(),
            state: component.save(),
            forces: reply.map_or_else(Vec::new, visualization::forces),
        };
        if self.frames.as_ref().is_some_and(|frames| frames.try_send(frame).is_ok()) {
            self.shown = Some(Instant::now());
        }
    }
}

impl Drop for ViewerStream {
    fn drop(&mut self) {
        self.frames = None;
        if let Some(thread) = self.thread.take() {
            // A thread that has failed has message so; there is nothing left for it to do.
            let _ = thread.join();
        }
    }
}

fn send_all(session: &Session, keys: &Keys, frames: &Receiver<ViewerFrame>) {
    for (k, frame) in (0..).zip(frames) {
        let ViewerFrame { model, state, forces } = frame;
        if k % CLOUDS_PER_SCENE == 0 {
            send(
                session,
                keys.visualization("scene"),
                &visualization::scene(&model, &state, &forces),
            );
        }
        send(session, keys.visualization("grains"), &visualization::grain_cloud(&model, &state));
    }
}

/// Sends a message that may be dropped.
fn send<T: Message>(session: &Session, key: String, message: &T) {
    let Ok(bytes) = to_cdr(message) else { return };
    let put = session.put(key, bytes).encoding(cdr::<T>());
    let put = put.congestion_control(CongestionControl::Drop).priority(Priority::DataLow);
    let _ = put.wait();
}
