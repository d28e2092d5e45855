//! Pictures for viewers, on a session of their own.
//!
//! Contract: the computing thread hands a state over, or does not when the last one is still being sent; it waits for
//! nothing. What a viewer does not take is dropped.

use crate::wire::cdr;
use crate::{Error, Keys, Purpose, SessionConfig};
use ballast::component::Component;
use ballast::math::Vec3;
use ballast::model::Model;
use ballast::state::State;
use ballast_protocol::messages::{AdvanceReply, Message};
use ballast_protocol::{pictures, to_cdr};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::{Session, Wait};

/// Polyhedra, which are many times larger than points, come once in so many pictures.
const POINTS_PER_SCENE: u64 = 5;

/// What a picture is made of.
struct Frame {
    model: Arc<Model>,
    state: Arc<State>,
    /// On the driven bodies, N `[nd]`.
    forces: Vec<Vec3>,
}

/// The thread that sends pictures.
pub(super) struct Pictures {
    pub endpoints: Vec<String>,
    every: Duration,
    shown: Option<Instant>,
    frames: Option<SyncSender<Frame>>,
    thread: Option<JoinHandle<()>>,
}

impl Pictures {
    /// Sends a picture at most once in `every`.
    pub fn start(link: &SessionConfig, keys: &Keys, every: Duration) -> Result<Self, Error> {
        let session = link.open_for(Purpose::Pictures)?;
        // One waits at most; what would come behind it is older than the next.
        let (sender, frames) = sync_channel(1);
        let keys = keys.clone();
        let thread = std::thread::Builder::new().name("pictures".into());
        let thread = thread.spawn(move || send_all(&session, &keys, &frames));
        let thread = Some(thread.map_err(|e| Error::link("pictures", e))?);
        let (endpoints, frames) = (link.listen.clone(), Some(sender));
        Ok(Self { endpoints, every, shown: None, frames, thread })
    }

    /// Shows where a component is, with the forces of its last window, unless a picture was shown a moment ago.
    pub fn show(&mut self, component: &Component, reply: Option<&AdvanceReply>) {
        if self.shown.is_some_and(|at| at.elapsed() < self.every) {
            return;
        }
        let forces = reply.map_or(&[][..], |r| &r.bodies).iter();
        let frame = Frame {
            model: component.shared_model(),
            state: component.save(),
            forces: forces.map(|b| b.moving_average.force.into()).collect(),
        };
        if self.frames.as_ref().is_some_and(|frames| frames.try_send(frame).is_ok()) {
            self.shown = Some(Instant::now());
        }
    }
}

impl Drop for Pictures {
    fn drop(&mut self) {
        self.frames = None;
        if let Some(thread) = self.thread.take() {
            // A thread that has failed has message so; there is nothing left for it to do.
            let _ = thread.join();
        }
    }
}

fn send_all(session: &Session, keys: &Keys, frames: &Receiver<Frame>) {
    for (k, frame) in (0..).zip(frames) {
        let Frame { model, state, forces } = frame;
        if k % POINTS_PER_SCENE == 0 {
            send(session, keys.picture("scene"), &pictures::scene(&model, &state, &forces));
        }
        send(session, keys.picture("stones"), &pictures::stones(&model, &state));
    }
}

/// Nobody has to take it.
fn send<T: Message>(session: &Session, key: String, message: &T) {
    let Ok(bytes) = to_cdr(message) else { return };
    let put = session.put(key, bytes).encoding(cdr::<T>());
    let put = put.congestion_control(CongestionControl::Drop).priority(Priority::DataLow);
    let _ = put.wait();
}
