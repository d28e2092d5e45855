//! Serves a component: requests come in through Zenoh, one after the other go through its lockstep, answers
//! go out.
//!
//! Contract:
//! * One thread computes. While it does, `ctl/status` and `describe` are answered and the heartbeat goes on.
//! * Requests that wait are bounded in number, messages in size; what is beyond is refused at once.
//! * An owner is a client that is alive: when its token is gone, so is its ownership, and the run holds.

mod broadcast;
mod describe;
mod requests;

pub use describe::Description;

use crate::keys::last;
use crate::{Error, Keys, Link};
use ballast_protocol::lockstep::{Activity, Lockstep, Progress, StatusReport};
use requests::Answer;
use std::collections::BTreeSet;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use zenoh::liveliness::LivelinessToken;
use zenoh::query::Query;
use zenoh::sample::SampleKind;
use zenoh::{Session, Wait};

/// Between two signs of life.
pub const HEARTBEAT: Duration = Duration::from_millis(500);
/// Most requests that wait.
const QUEUE: usize = 64;

/// What is done beside answering: called by the computing thread.
pub trait Host: Send {
    /// An owner is lost or leaves, or the component quits: the state should be kept; whether it is.
    fn keep(&mut self, _lockstep: &Lockstep) -> bool {
        false
    }

    /// A window was computed.
    fn computed(
        &mut self,
        _lockstep: &Lockstep,
        _request: &ballast_protocol::messages::AdvanceRequest,
        _reply: &ballast_protocol::messages::AdvanceReply,
    ) {
    }

    /// Whether to stop serving.
    fn is_stopped(&self) -> bool {
        false
    }
}

/// Does nothing beside.
impl Host for () {}

/// A component on the network.
pub struct Server {
    session: Session,
    keys: Keys,
    lockstep: Lockstep,
    shared: Arc<Shared>,
    inbox: Receiver<Event>,
    alive: Option<LivelinessToken>,
    live: BTreeSet<String>,
    start: Instant,
    outlets: broadcast::Outlets,
}

/// What other threads see of the computing one.
struct Shared {
    status: Mutex<StatusReport>,
    description: String,
    start: Instant,
}

impl Shared {
    fn status(&self) -> MutexGuard<'_, StatusReport> {
        // A report is whole at any time: it is replaced, not edited, but for single numbers.
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What happens to the computing thread.
enum Event {
    Request(Query),
    Alive(String),
    Gone(String),
}

impl Server {
    /// Opens the session and declares the component's keys; nothing is computed before [`Server::run`].
    ///
    /// # Errors
    /// A name or a link that cannot be used.
    pub fn open(name: &str, link: &Link, lockstep: Lockstep) -> Result<Self, Error> {
        let keys = Keys::of(name)?;
        let session = link.open()?;
        let start = Instant::now();
        let description = Description::of(name, &lockstep);
        let shared = Arc::new(Shared {
            status: Mutex::new(lockstep.status(0)),
            description: serde_json::to_string(&description).unwrap_or_default(),
            start,
        });
        let (sender, inbox) = sync_channel(QUEUE);
        let outlets = broadcast::Outlets::declare(&session, &keys, lockstep.component().model())?;
        let server = Self {
            session,
            keys,
            lockstep,
            shared,
            inbox,
            alive: None,
            live: BTreeSet::new(),
            start,
            outlets,
        };
        server.declare(sender)?;
        Ok(server)
    }

    fn declare(&self, sender: SyncSender<Event>) -> Result<(), Error> {
        let zenoh = |e: zenoh::Error| Error::link("zenoh", e);
        let (shared, to) = (Arc::clone(&self.shared), sender.clone());
        let request = move |query: Query| {
            if last(query.key_expr().as_str()) == "status" {
                let report = shared.status().clone();
                requests::answer(&query, Ok(Answer::json(&report)));
            } else if let Err(refused) = to.try_send(Event::Request(query)) {
                use std::sync::mpsc::TrySendError::{Disconnected, Full};
                let (Full(event) | Disconnected(event)) = refused;
                requests::refuse_waiting(event, QUEUE);
            }
        };
        let control = self.session.declare_queryable(self.keys.control_any()).complete(true);
        control.callback(request).background().wait().map_err(zenoh)?;
        let shared = Arc::clone(&self.shared);
        let describe = self.session.declare_queryable(self.keys.describe()).complete(true);
        let told = move |query: Query| {
            requests::answer(&query, Ok(Answer::text(shared.description.clone())));
        };
        describe.callback(told).background().wait().map_err(zenoh)?;
        let owners = self.session.liveliness().declare_subscriber(self.keys.owner_any());
        let token = move |sample: zenoh::sample::Sample| {
            let client = last(sample.key_expr().as_str()).to_string();
            let event = match sample.kind() {
                SampleKind::Put => Event::Alive(client),
                SampleKind::Delete => Event::Gone(client),
            };
            // Waits for room: the loss of an owner must not be lost.
            let _ = sender.send(event);
        };
        owners.history(true).callback(token).background().wait().map_err(zenoh)
    }

    /// The endpoints that others can connect to.
    pub fn endpoints(&self) -> Vec<String> {
        self.session.info().locators().wait().iter().map(ToString::to_string).collect()
    }

    /// Serves until the component is shut down or the host stops; gives back the lockstep.
    ///
    /// # Errors
    /// The session breaks down.
    pub fn run(mut self, host: &mut dyn Host) -> Result<Lockstep, Error> {
        let beat = self.heartbeat()?;
        self.come_alive()?;
        loop {
            match self.inbox.recv_timeout(Duration::from_millis(50)) {
                Ok(Event::Request(query)) => self.request(&query, host)?,
                Ok(Event::Alive(client)) => drop(self.live.insert(client)),
                Ok(Event::Gone(client)) => {
                    self.live.remove(&client);
                    if self.lockstep.lost(&client) {
                        self.keep(host);
                    }
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            self.show();
            let quits = self.shared.status().activity == Activity::Quitting;
            if quits || host.is_stopped() {
                break;
            }
        }
        self.keep(host);
        drop(beat);
        self.alive = None;
        self.session.close().wait().map_err(|e| Error::link("zenoh", e))?;
        Ok(self.lockstep)
    }

    fn keep(&mut self, host: &mut dyn Host) {
        if host.keep(&self.lockstep) {
            self.lockstep.is_durable();
        }
    }

    /// Wall time since the start, ms.
    fn now_ms(&self) -> u64 {
        self.start.elapsed().as_millis() as u64
    }

    /// Lets others see the status.
    fn show(&self) {
        *self.shared.status() = self.lockstep.status(self.now_ms());
    }

    /// Shows how far a window is.
    fn show_progress(shared: &Shared, progress: &Progress) {
        let mut status = shared.status();
        status.activity = Activity::Playing;
        (status.waiting_for, status.waiting_since_ms) = (None, None);
        status.progress = Some(*progress);
    }

    /// Declares the component alive in its run.
    fn come_alive(&mut self) -> Result<(), Error> {
        let key = self.keys.alive(&self.lockstep.place().run_id);
        let token = self.session.liveliness().declare_token(key).wait();
        self.alive = Some(token.map_err(|e| Error::link("zenoh", e))?);
        Ok(())
    }

    /// A thread that tells the status at every beat, until the guard is dropped.
    fn heartbeat(&self) -> Result<SyncSender<()>, Error> {
        let (guard, stop) = sync_channel::<()>(0);
        let publisher = self
            .session
            .declare_publisher(self.keys.out("status"))
            .encoding(zenoh::bytes::Encoding::APPLICATION_JSON)
            .wait()
            .map_err(|e| Error::link("zenoh", e))?;
        let shared = Arc::clone(&self.shared);
        let beats = move || {
            while matches!(stop.recv_timeout(HEARTBEAT), Err(RecvTimeoutError::Timeout)) {
                let mut report = shared.status().clone();
                report.uptime_ms = shared.start.elapsed().as_millis() as u64;
                let text = serde_json::to_string(&report).unwrap_or_default();
                if publisher.put(text).wait().is_err() {
                    break;
                }
            }
        };
        let thread = std::thread::Builder::new().name("heartbeat".into());
        thread.spawn(beats).map_err(|e| Error::link("heartbeat", e))?;
        Ok(guard)
    }
}
