//! Server of a component: receives requests through Zenoh, executes them in lockstep, and replies.
//!
//! Contract:
//! * One thread computes, the one that calls [`Server::run`]. Meanwhile other threads answer `ctl/status` and `describe`,
//!   refuse clients other than the owner, and publish the heartbeat.
//! * The queue of requests is bounded in number and bytes; requests beyond are refused at once.
//! * Ownership requires a liveliness token: when it vanishes, the ownership ends and the run is paused.

mod admission;
mod heartbeat;
mod publishers;
mod real_time;
mod reply;
mod reply_cache;
mod request;
mod requests;
mod sample_queue;
mod status;
mod viewer;

use crate::keys::last_segment;
use crate::{DISCONNECT_TIMEOUT, Error, HEARTBEAT_INTERVAL, Keys, SessionConfig};
use ballast::component::Component;
use ballast_protocol::description::{ComponentDescription, TineDescription};
use ballast_protocol::lockstep::{ErrorCode, InitRequest, Lockstep, RequestError, WindowKind};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest};
use ballast_protocol::pacer::Pacer;
use heartbeat::Heartbeat;
use publishers::Publishers;
use reply_cache::ReplyCache;
use request::ServerEvent;
use sample_queue::SampleQueue;
use status::SharedStatus;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use viewer::ViewerStream;
use zenoh::liveliness::LivelinessToken;
use zenoh::{Session, Wait};

/// Maximum time between two checks for a stop request.
const POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Delay between the last message and the end of the session.
const CLOSE_DELAY: Duration = Duration::from_millis(100);

/// Hooks of a server, called by the computing thread: checkpoints, recording, messages, preparation.
pub trait ServerHooks: Send {
    /// Called when clients can find the component and its status names the run.
    fn opened(&mut self, _lockstep: &Lockstep) {}

    /// Writes a checkpoint, because an owner leaves, the state was replaced or the component shuts down.
    ///
    /// Returns true if a checkpoint of the current state exists.
    fn write_checkpoint(&mut self, _lockstep: &Lockstep) -> bool {
        false
    }

    /// Called after a window was computed and answered; returns true if a checkpoint was written.
    fn window_computed(
        &mut self,
        _lockstep: &Lockstep,
        _kind: WindowKind,
        _request: &AdvanceRequest,
        _reply: &AdvanceReply,
    ) -> bool {
        false
    }

    /// Called periodically while no request arrives; returns true if a checkpoint of the current state exists.
    fn idle(&mut self, _lockstep: &Lockstep) -> bool {
        false
    }

    /// Called after parameters were changed.
    fn parameters_changed(&mut self) {}

    /// Called after the state was replaced by `restore`, `reset` or `init`.
    fn state_replaced(&mut self, _lockstep: &Lockstep) {}

    /// Prepares the component of an `init` request, while the computing thread waits.
    ///
    /// # Errors
    /// The reason why there is none; an existing run stays unchanged.
    fn prepare(&mut self, _request: &InitRequest) -> Result<Component, RequestError> {
        let message = "init: the component was prepared at start; use `reset` to start a new run";
        Err(RequestError::new(ErrorCode::InitFailed, message))
    }

    /// Returns the tines of the case's tamping cycle, for the description.
    fn tines(&self, _lockstep: &Lockstep) -> Vec<TineDescription> {
        Vec::new()
    }

    /// Receives messages for people.
    fn log(&mut self, _text: &str) {}

    /// Returns true to stop the server; polled between requests and between steps, and a running window is rolled back.
    fn is_stopped(&self) -> bool {
        false
    }
}

impl ServerHooks for () {}

/// Server of a component.
pub struct Server {
    link: SessionConfig,
    endpoints: Vec<String>,
    session: Session,
    keys: Keys,
    shared: Arc<SharedStatus>,
    inbox: Receiver<ServerEvent>,
    inputs: SampleQueue,
    heartbeat: Heartbeat,
    viewer: Option<ViewerStream>,
}

/// Component that is being served.
struct Service<'a> {
    session: &'a Session,
    keys: &'a Keys,
    shared: Arc<SharedStatus>,
    lockstep: Lockstep,
    hooks: &'a mut dyn ServerHooks,
    publishers: Publishers,
    replies: ReplyCache,
    alive: Option<LivelinessToken>,
    inputs: SampleQueue,
    /// Pacer of the real-time mode, while it is active.
    pacer: Option<Pacer>,
    viewer: Option<ViewerStream>,
}

impl Server {
    /// Opens the session and declares the component's keys.
    ///
    /// The state is `PREPARING` until [`Server::run`]; requests to attach are queued.
    ///
    /// # Errors
    /// An invalid name, or a session that cannot be opened.
    pub fn open(name: &str, link: &SessionConfig) -> Result<Self, Error> {
        let keys = Keys::of(name)?;
        let session = link.open()?;
        let shared = Arc::new(SharedStatus::preparing());
        // Bounded by `SharedStatus::admit` and by the sample queue.
        let (sender, inbox) = channel();
        let inputs = SampleQueue::declare(&session, &keys, &shared, sender.clone())?;
        admission::declare(&session, &keys, &shared, sender)?;
        let heartbeat = Heartbeat::start(&session, &keys, &shared)?;
        let endpoints = link.listen_endpoints()?;
        let link = link.clone();
        Ok(Self { link, endpoints, session, keys, shared, inbox, inputs, heartbeat, viewer: None })
    }

    /// Adds a visualization stream on a separate session, at most one frame per `interval`.
    ///
    /// A slow viewer delays neither the component nor other clients.
    ///
    /// # Errors
    /// A session that cannot be opened.
    pub fn with_viewer(mut self, link: &SessionConfig, interval: Duration) -> Result<Self, Error> {
        self.viewer = Some(ViewerStream::start(link, &self.keys, interval)?);
        Ok(self)
    }

    /// Returns the endpoints that the server listens on.
    pub fn endpoints(&self) -> &[String] {
        &self.endpoints
    }

    /// Returns true if clients in the default mode `peer` cannot find the server, because both are peers of one router.
    pub fn is_isolated_by_router(&self) -> bool {
        self.link.is_isolated_by_router(&self.session)
    }

    /// Waits until no other component is alive under this key; a killed one stays alive for a moment.
    ///
    /// [`Server::run`] does the same; call it earlier before files are replaced.
    ///
    /// # Errors
    /// Another component serves this key.
    pub fn ensure_unique(&self) -> Result<(), Error> {
        ensure_unique(&self.session, &self.keys)
    }

    /// Serves until the component is shut down or the hooks stop it; returns the lockstep.
    ///
    /// # Errors
    /// The session fails.
    pub fn run(self, lockstep: Lockstep, hooks: &mut dyn ServerHooks) -> Result<Lockstep, Error> {
        let Self { session, keys, shared, inbox, inputs, heartbeat, viewer, .. } = self;
        let publishers =
            Publishers::declare(&session, &keys, &shared, lockstep.component().model())?;
        let mut service = Service {
            session: &session,
            keys: &keys,
            shared,
            lockstep,
            hooks,
            publishers,
            replies: ReplyCache::default(),
            alive: None,
            inputs,
            pacer: None,
            viewer,
        };
        service.update_viewer(None);
        service.publish_description();
        service.publish_status();
        ensure_unique(service.session, service.keys)?;
        service.declare_alive()?;
        service.hooks.opened(&service.lockstep);
        service.serve(&inbox)?;
        service.lockstep.stop();
        service.write_checkpoint();
        service.publish_status();
        while let Ok(call) = inbox.try_recv() {
            if let ServerEvent::Request(request) = call {
                service.refuse(&request);
            }
        }
        heartbeat.stop();
        let Service { lockstep, alive, publishers, .. } = service;
        drop((alive, publishers));
        // Zenoh batches small messages and drops them when a session closes: the last refusals and the last status
        // would be lost.
        std::thread::sleep(CLOSE_DELAY);
        session.close().wait().map_err(|e| Error::transport("zenoh", e))?;
        Ok(lockstep)
    }
}

impl Service<'_> {
    fn serve(&mut self, inbox: &Receiver<ServerEvent>) -> Result<(), Error> {
        while !self.shared.is_shutting_down() && !self.hooks.is_stopped() {
            let wait = self.advance_real_time().unwrap_or(POLL_INTERVAL).min(POLL_INTERVAL);
            match inbox.recv_timeout(wait) {
                Ok(ServerEvent::Request(request)) => self.handle(*request)?,
                Ok(ServerEvent::Samples) => {}
                Err(RecvTimeoutError::Timeout) => self.on_idle(),
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if let Some(client) = self.shared.take_disconnected_owner()
                && self.lockstep.client_disconnected(&client)
            {
                self.replies.clear();
                self.stop_real_time("the owner disconnected");
                self.log(&format!("{client:?} disconnected; the run is paused"));
                self.write_checkpoint();
                self.publish_status();
            }
        }
        Ok(())
    }

    /// Lets the hooks write a checkpoint while no request arrives.
    fn on_idle(&mut self) {
        if self.hooks.idle(&self.lockstep) {
            self.lockstep.note_durable();
            self.publish_status();
        }
    }

    /// Publishes the status between two requests.
    fn publish_status(&self) {
        let mut status = self.lockstep.status(self.shared.now_ms());
        if let Some(pacer) = &self.pacer {
            pacer.write_status(&mut status, self.shared.now_ns());
        }
        self.shared.set_status(&self.lockstep, status);
    }

    fn write_checkpoint(&mut self) {
        if self.hooks.write_checkpoint(&self.lockstep) {
            self.lockstep.note_durable();
        }
    }

    /// Publishes the description of the component.
    fn publish_description(&self) {
        let description = self.lockstep.is_configured().then(|| {
            let viewer_endpoints =
                self.viewer.as_ref().map_or(Vec::new(), |viewer| viewer.endpoints.clone());
            ComponentDescription {
                viewer_endpoints,
                tines: self.hooks.tines(&self.lockstep),
                ..ComponentDescription::of(self.keys.name(), &self.lockstep)
            }
        });
        self.shared.set_description(description);
    }

    /// Sends the state to viewers.
    fn update_viewer(&mut self, reply: Option<&AdvanceReply>) {
        if let Some(viewer) = &mut self.viewer {
            viewer.show(self.lockstep.component(), reply);
        }
    }

    /// Logs a message for people, here and on the key `log`.
    fn log(&mut self, text: &str) {
        self.hooks.log(text);
        self.publishers.log(self.lockstep.component().now_ns(), text);
    }

    /// Declares the liveliness token of the current run.
    fn declare_alive(&mut self) -> Result<(), Error> {
        let key = self.keys.alive(&self.lockstep.position().run_id);
        let token = self.session.liveliness().declare_token(key).wait();
        // The new token is declared before the old one is dropped, so that clients see no gap.
        self.alive = Some(token.map_err(|e| Error::transport("zenoh", e))?);
        Ok(())
    }
}

fn ensure_unique(session: &Session, keys: &Keys) -> Result<(), Error> {
    let begin = Instant::now();
    while let Some(run) = find_token(session, keys.alive_any(), DISCONNECT_TIMEOUT)? {
        if begin.elapsed() > 3 * DISCONNECT_TIMEOUT {
            let found = format!("key is already served by run {run}");
            return Err(Error::transport(format!("key {}", keys.name()), found));
        }
        std::thread::sleep(HEARTBEAT_INTERVAL);
    }
    Ok(())
}

/// Returns the last segment of a liveliness token under `key` that is found within `timeout`.
fn find_token(session: &Session, key: String, timeout: Duration) -> Result<Option<String>, Error> {
    let tokens = session.liveliness().get(key).timeout(timeout).wait();
    let tokens = tokens.map_err(|e| Error::transport("zenoh", e))?;
    let alive = std::iter::from_fn(|| tokens.recv().ok()).find_map(|r| r.into_result().ok());
    Ok(alive.map(|token| last_segment(token.key_expr().as_str()).to_string()))
}
