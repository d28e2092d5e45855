//! Serves a component: requests come in through Zenoh, one after the other go through its lockstep, answers
//! go out.
//!
//! Contract:
//! * One thread computes, the one that calls [`Server::run`]. While it does, `ctl/status` and `describe` are
//!   answered, others than the owner refused, and the heartbeat goes on.
//! * Requests that wait are bounded in number and bytes; what is beyond is refused at once.
//! * An owner is a client that is alive: when its token is gone, so is its ownership, and the run holds.

mod answer;
mod gate;
mod heartbeat;
mod inputs;
mod memory;
mod outlets;
mod pictures;
mod requests;
mod running;
mod shared;

use crate::keys::last;
use crate::{DISCONNECT_TIMEOUT, Error, HEARTBEAT_INTERVAL, Keys, SessionConfig};
use ballast::component::Component;
use ballast_protocol::description::ComponentDescription;
use ballast_protocol::lockstep::{ErrorCode, InitRequest, Lockstep, RequestError, WindowKind};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest};
use ballast_protocol::pacer::Pacer;
use gate::Call;
use heartbeat::Heartbeat;
use inputs::Inputs;
use memory::Answered;
use outlets::Outlets;
use pictures::Pictures;
use shared::Shared;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};
use zenoh::liveliness::LivelinessToken;
use zenoh::{Session, Wait};

/// How long the computing thread sleeps at most before it looks whether it is to stop.
const DOZE: Duration = Duration::from_millis(50);

/// How long a session stays open after the last word.
const LINGER: Duration = Duration::from_millis(100);

/// What is done beside answering; called by the computing thread.
pub trait ServerHooks: Send {
    /// Partners find the component from now on, and its status tells this run.
    fn opened(&mut self, _lockstep: &Lockstep) {}

    /// An owner is lost or leaves, the run was taken elsewhere, or the component quits: the state should be
    /// kept; whether it is.
    fn keep(&mut self, _lockstep: &Lockstep) -> bool {
        false
    }

    /// A window was computed and answered; whether the state was kept.
    fn computed(
        &mut self,
        _lockstep: &Lockstep,
        _kind: WindowKind,
        _request: &AdvanceRequest,
        _reply: &AdvanceReply,
    ) -> bool {
        false
    }

    /// Nothing was asked for a moment; whether the state is kept now.
    fn rests(&mut self, _lockstep: &Lockstep) -> bool {
        false
    }

    /// The state is another one at the same place: parameters were set.
    fn changed(&mut self) {}

    /// The run was taken to a kept state, or back to the beginning.
    fn run_replaced(&mut self, _lockstep: &Lockstep) {}

    /// Prepares a component, the computing thread waiting for it; the run then begins anew with it.
    ///
    /// # Errors
    /// Why there is none; the run, if there is one, stays as it is.
    fn init(&mut self, _ask: &InitRequest) -> Result<Component, RequestError> {
        let message = "init: this component was prepared when it was started; `reset` begins anew";
        Err(RequestError::new(ErrorCode::InitFailed, message))
    }

    /// Something that a person may want to know.
    fn note(&mut self, _text: &str) {}

    /// Whether to stop serving: asked between requests, and between the steps of a window, which is then
    /// taken back.
    fn is_stopped(&self) -> bool {
        false
    }
}

/// Does nothing beside.
impl ServerHooks for () {}

/// A component on the network.
pub struct Server {
    link: SessionConfig,
    endpoints: Vec<String>,
    session: Session,
    keys: Keys,
    shared: Arc<Shared>,
    inbox: Receiver<Call>,
    inputs: Inputs,
    heartbeat: Heartbeat,
    pictures: Option<Pictures>,
}

/// A component that is served.
struct Service<'a> {
    session: &'a Session,
    keys: &'a Keys,
    shared: Arc<Shared>,
    lockstep: Lockstep,
    host: &'a mut dyn ServerHooks,
    outlets: Outlets,
    answered: Answered,
    alive: Option<LivelinessToken>,
    inputs: Inputs,
    /// While time runs by itself.
    pacer: Option<Pacer>,
    pictures: Option<Pictures>,
}

impl Server {
    /// Opens the session and declares the component's keys. Until [`Server::run`] it tells that it is
    /// preparing; whoever wants to attach waits.
    ///
    /// # Errors
    /// A name or a link that cannot be used.
    pub fn open(name: &str, link: &SessionConfig) -> Result<Self, Error> {
        let keys = Keys::of(name)?;
        let session = link.open()?;
        let shared = Arc::new(Shared::settling());
        // Bounded by `Shared::admit` and by the samples that wait.
        let (sender, inbox) = channel();
        let inputs = Inputs::declare(&session, &keys, &shared, sender.clone())?;
        gate::open(&session, &keys, &shared, sender)?;
        let heartbeat = Heartbeat::start(&session, &keys, &shared)?;
        let endpoints = link.listen_endpoints()?;
        let link = link.clone();
        Ok(Self {
            link,
            endpoints,
            session,
            keys,
            shared,
            inbox,
            inputs,
            heartbeat,
            pictures: None,
        })
    }

    /// The same, sending pictures for viewers on a session of their own, at most one in `every`: however slow a viewer
    /// is, it holds nobody up.
    ///
    /// # Errors
    /// A link that cannot be used.
    pub fn with_viewer(mut self, link: &SessionConfig, every: Duration) -> Result<Self, Error> {
        self.pictures = Some(Pictures::start(link, &self.keys, every)?);
        Ok(self)
    }

    /// The endpoints that it listens on.
    pub fn endpoints(&self) -> &[String] {
        &self.endpoints
    }

    /// Whether partners that are peers, as they are without a word, do not find it: it has a router, and is itself a peer
    /// and no client of it.
    pub fn is_isolated_by_router(&self) -> bool {
        self.link.is_isolated_by_router(&self.session)
    }

    /// Waits until no other component is alive under this key, as one that was killed is for a moment. [`Server::run`]
    /// does so, too; whoever replaces or prepares something before may look earlier.
    ///
    /// # Errors
    /// It stays: partners could not tell the two apart.
    pub fn ensure_unique(&self) -> Result<(), Error> {
        ensure_unique(&self.session, &self.keys)
    }

    /// Serves until the component is shut down or the host stops; gives back the lockstep.
    ///
    /// # Errors
    /// The session breaks down.
    pub fn run(self, lockstep: Lockstep, host: &mut dyn ServerHooks) -> Result<Lockstep, Error> {
        let Self { session, keys, shared, inbox, inputs, heartbeat, pictures, .. } = self;
        let outlets = Outlets::declare(&session, &keys, &shared, lockstep.component().model())?;
        let mut service = Service {
            session: &session,
            keys: &keys,
            shared,
            lockstep,
            host,
            outlets,
            answered: Answered::default(),
            alive: None,
            inputs,
            pacer: None,
            pictures,
        };
        service.picture(None);
        service.describe();
        service.show();
        ensure_unique(service.session, service.keys)?;
        service.come_alive()?;
        service.host.opened(&service.lockstep);
        service.serve(&inbox)?;
        service.lockstep.quit();
        service.keep();
        service.show();
        while let Ok(call) = inbox.try_recv() {
            if let Call::Request(request) = call {
                service.refuse(&request);
            }
        }
        heartbeat.end();
        let Service { lockstep, alive, outlets, .. } = service;
        drop((alive, outlets));
        // Zenoh collects small messages for a moment before it sends them, and a session that closes does
        // not wait for them: the last refusals and the last status would be lost.
        std::thread::sleep(LINGER);
        session.close().wait().map_err(|e| Error::link("zenoh", e))?;
        Ok(lockstep)
    }
}

impl Service<'_> {
    fn serve(&mut self, inbox: &Receiver<Call>) -> Result<(), Error> {
        while !self.shared.is_quitting() && !self.host.is_stopped() {
            let most = self.run_on().unwrap_or(DOZE).min(DOZE);
            match inbox.recv_timeout(most) {
                Ok(Call::Request(request)) => self.request(*request)?,
                Ok(Call::Input) => {}
                Err(RecvTimeoutError::Timeout) => self.rest(),
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if let Some(client) = self.shared.take_lost_owner()
                && self.lockstep.lost(&client)
            {
                self.answered.forget();
                self.stop_real_time("its owner is gone");
                self.say(&format!("{client:?} is gone; the run holds"));
                self.keep();
                self.show();
            }
        }
        Ok(())
    }

    /// Nothing was asked for a while.
    fn rest(&mut self) {
        if self.host.rests(&self.lockstep) {
            self.lockstep.note_durable();
            self.show();
        }
    }

    /// Shows what the component is doing between two requests.
    fn show(&self) {
        let mut status = self.lockstep.status(self.shared.now_ms());
        if let Some(pacer) = &self.pacer {
            pacer.tell(&mut status, self.shared.now_ns());
        }
        self.shared.show(&self.lockstep, status);
    }

    fn keep(&mut self) {
        if self.host.keep(&self.lockstep) {
            self.lockstep.note_durable();
        }
    }

    /// Describes the component: its bodies, and what is set.
    fn describe(&self) {
        let description = self.lockstep.is_configured().then(|| {
            let viewer_endpoints =
                self.pictures.as_ref().map_or(Vec::new(), |p| p.endpoints.clone());
            ComponentDescription {
                viewer_endpoints,
                ..ComponentDescription::of(self.keys.name(), &self.lockstep)
            }
        });
        self.shared.describe(description);
    }

    /// Shows viewers where the run is.
    fn picture(&mut self, reply: Option<&AdvanceReply>) {
        if let Some(pictures) = &mut self.pictures {
            pictures.show(self.lockstep.component(), reply);
        }
    }

    /// Tells people here and observers.
    fn say(&mut self, text: &str) {
        self.host.note(text);
        self.outlets.log(self.lockstep.component().now_ns(), text);
    }

    /// Declares the component alive in its run.
    fn come_alive(&mut self) -> Result<(), Error> {
        let key = self.keys.alive(&self.lockstep.position().run_id);
        let token = self.session.liveliness().declare_token(key).wait();
        // The new token is there before the old one goes: nobody sees the component die.
        self.alive = Some(token.map_err(|e| Error::link("zenoh", e))?);
        Ok(())
    }
}

fn ensure_unique(session: &Session, keys: &Keys) -> Result<(), Error> {
    let begin = Instant::now();
    while let Some(run) = find_token(session, keys.alive_any(), DISCONNECT_TIMEOUT)? {
        if begin.elapsed() > 3 * DISCONNECT_TIMEOUT {
            let found = format!("expected nobody alive there, found run {run}");
            return Err(Error::link(format!("key {}", keys.name()), found));
        }
        std::thread::sleep(HEARTBEAT_INTERVAL);
    }
    Ok(())
}

/// The last word of a liveliness token of others under `key`, if one is found within `most`.
fn find_token(session: &Session, key: String, most: Duration) -> Result<Option<String>, Error> {
    let tokens = session.liveliness().get(key).timeout(most).wait();
    let tokens = tokens.map_err(|e| Error::link("zenoh", e))?;
    let alive = std::iter::from_fn(|| tokens.recv().ok()).find_map(|r| r.into_result().ok());
    Ok(alive.map(|token| last(token.key_expr().as_str()).to_string()))
}
