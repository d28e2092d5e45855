//! Steps a component from another process.
//!
//! Contract: a request that is not answered is asked again, with the same number, so that it has its effect
//! once. Every call ends: with the answer, with what the component refuses, or with *slow* or *peer lost*
//! once the time allowed is over.

use crate::error::Error;
use crate::keys::last;
use crate::server::{Description, HEARTBEAT};
use crate::{Keys, Link};
use ballast_protocol::lockstep::{
    Attach, Attached, Code, Fault, Kind, Named, Place, StatusReport,
};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, BodyInput, LoadInput, Message};
use ballast_protocol::{from_cdr, to_cdr};
use serde::de::DeserializeOwned;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use zenoh::bytes::Encoding;
use zenoh::liveliness::LivelinessToken;
use zenoh::{Session, Wait};

/// Without a sign of life for so long, a component that is not alive is lost.
const SILENCE: Duration = Duration::from_millis(3 * HEARTBEAT.as_millis() as u64);
/// Between two attempts when nobody answers, at first and at most.
const PAUSE: [Duration; 2] = [Duration::from_millis(5), Duration::from_millis(200)];

/// How long calls may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience {
    /// For requests that compute nothing.
    pub control: Duration,
    /// For a window.
    pub window: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self { control: Duration::from_secs(10), window: Duration::from_secs(3600) }
    }
}

/// A connection to a component, and what is known of its run.
pub struct Client {
    session: Session,
    keys: Keys,
    name: String,
    patience: Patience,
    /// When the component last told what it does, and what.
    heard: Arc<Mutex<Heard>>,
    _token: LivelinessToken,
    ticket: String,
    place: Place,
}

#[derive(Default)]
struct Heard {
    at: Option<Instant>,
    status: Option<StatusReport>,
}

impl Client {
    /// Connects to the component `site/id` and becomes its owner, waiting for it as long as `patience` says.
    ///
    /// # Errors
    /// A name or a link that cannot be used; nobody there; someone else drives.
    pub fn attach(
        component: &str,
        link: &Link,
        ask: &Attach,
        patience: Patience,
    ) -> Result<Self, Error> {
        let keys = Keys::of(component)?;
        let session = link.open()?;
        let zenoh = |e: zenoh::Error| Error::link("zenoh", e);
        let token = session.liveliness().declare_token(keys.owner(&ask.client));
        let token = token.wait().map_err(zenoh)?;
        let heard = Arc::new(Mutex::new(Heard::default()));
        let note = Arc::clone(&heard);
        let listen = move |sample: zenoh::sample::Sample| {
            let status = serde_json::from_slice(&sample.payload().to_bytes()).ok();
            let at = Some(Instant::now());
            *note.lock().unwrap_or_else(PoisonError::into_inner) = Heard { at, status };
        };
        let status = session.declare_subscriber(keys.out("status")).callback(listen);
        status.background().wait().map_err(zenoh)?;
        let mut client = Self {
            session,
            keys,
            name: ask.client.clone(),
            patience,
            heard,
            _token: token,
            ticket: String::new(),
            place: Place::default(),
        };
        client.take(ask)?;
        Ok(client)
    }

    /// Becomes the owner again, of the same run, after the component or the line was away.
    ///
    /// # Errors
    /// As for [`Client::attach`]; the run is another one.
    pub fn attach_again(&mut self) -> Result<(), Error> {
        let ask = Attach {
            client: self.name.clone(),
            resume: Some(self.place.run_id.clone()),
            ticket: Some(self.ticket.clone()),
        };
        self.take(&ask)
    }

    fn take(&mut self, ask: &Attach) -> Result<(), Error> {
        let text = serde_json::to_vec(ask).unwrap_or_default();
        let attached: Attached = self.json("attach", text)?;
        self.ticket = attached.ticket;
        self.place = attached.place;
        Ok(())
    }

    /// Where the run stands.
    pub fn place(&self) -> &Place {
        &self.place
    }

    /// What the component says of itself.
    ///
    /// # Errors
    /// No answer, or none that can be read.
    pub fn describe(&self) -> Result<Description, Error> {
        let (bytes, _) = self.call("describe", self.keys.describe(), None, self.patience.control)?;
        read("describe", &bytes)
    }

    /// What the component is doing.
    ///
    /// # Errors
    /// No answer, or none that can be read.
    pub fn status(&self) -> Result<StatusReport, Error> {
        let key = self.keys.control("status");
        let (bytes, _) = self.call("status", key, None, self.patience.control)?;
        read("status", &bytes)
    }

    /// Computes the next window, to `t1_ns`.
    ///
    /// # Errors
    /// What the component refuses; [`Error::Slow`], [`Error::PeerLost`].
    pub fn advance_to(
        &mut self,
        t1_ns: u64,
        motions: Vec<BodyInput>,
        loads: Vec<LoadInput>,
    ) -> Result<AdvanceReply, Error> {
        let request = AdvanceRequest {
            seq: self.place.seq + 1,
            motions,
            loads,
            ..self.window(self.place.now_ns, t1_ns)
        };
        self.send(Kind::Advance, &request)
    }

    /// Computes the last window again with other inputs; `t0_ns` and `t1_ns` are its ends.
    ///
    /// # Errors
    /// As for [`Client::advance_to`].
    pub fn redo(
        &mut self,
        [t0_ns, t1_ns]: [u64; 2],
        motions: Vec<BodyInput>,
        loads: Vec<LoadInput>,
    ) -> Result<AdvanceReply, Error> {
        let request =
            AdvanceRequest { seq: self.place.seq, motions, loads, ..self.window(t0_ns, t1_ns) };
        self.send(Kind::Redo, &request)
    }

    fn window(&self, t0_ns: u64, t1_ns: u64) -> AdvanceRequest {
        let ns = |t: u64| i64::try_from(t).unwrap_or(i64::MAX);
        AdvanceRequest {
            run_id: self.place.run_id.clone(),
            t0_ns: ns(t0_ns),
            t1_ns: ns(t1_ns),
            ..AdvanceRequest::default()
        }
    }

    /// Sends a window's request as it is; for those who number their windows themselves.
    ///
    /// # Errors
    /// As for [`Client::advance_to`].
    pub fn send(&mut self, kind: Kind, request: &AdvanceRequest) -> Result<AdvanceReply, Error> {
        let verb = match kind {
            Kind::Advance => "advance",
            Kind::Redo => "redo",
        };
        let encoding = Encoding::from(format!("application/cdr;{}", AdvanceRequest::NAME));
        let payload = Some((to_cdr(request)?, encoding));
        let key = self.keys.control(verb);
        let (bytes, _) = self.call(verb, key, payload, self.patience.window)?;
        let reply: AdvanceReply = from_cdr(&bytes)?;
        self.place.seq = reply.seq;
        self.place.now_ns = u64::try_from(reply.t1_ns).unwrap_or(0);
        self.place.hash = reply.hash.to_string();
        Ok(reply)
    }

    /// Keeps the state under a name, over there.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn save(&mut self, name: &str) -> Result<&Place, Error> {
        self.named("save", name)
    }

    /// Goes back to a kept state.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn restore(&mut self, name: &str) -> Result<&Place, Error> {
        self.named("restore", name)
    }

    /// Forgets a kept state.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn drop_state(&mut self, name: &str) -> Result<&Place, Error> {
        self.named("drop", name)
    }

    /// Starts a run of its own from the beginning.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn reset(&mut self) -> Result<&Place, Error> {
        self.place = self.json("reset", b"{}".to_vec())?;
        Ok(&self.place)
    }

    /// Leaves; the run stays where it is.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn detach(mut self) -> Result<Place, Error> {
        self.json("detach", b"{}".to_vec())
    }

    /// Ends the component.
    ///
    /// # Errors
    /// What the component refuses; no answer.
    pub fn shut_down(mut self) -> Result<Place, Error> {
        self.json("shutdown", b"{}".to_vec())
    }

    fn named(&mut self, verb: &str, name: &str) -> Result<&Place, Error> {
        let text = serde_json::to_vec(&Named { name: name.into() }).unwrap_or_default();
        self.place = self.json(verb, text)?;
        Ok(&self.place)
    }

    fn json<T: DeserializeOwned>(&mut self, verb: &str, text: Vec<u8>) -> Result<T, Error> {
        let payload = Some((text, Encoding::APPLICATION_JSON));
        let key = self.keys.control(verb);
        let (bytes, _) = self.call(verb, key, payload, self.patience.control)?;
        read(verb, &bytes)
    }

    /// Asks until there is an answer or the time allowed is over.
    fn call(
        &self,
        request: &str,
        key: String,
        payload: Option<(Vec<u8>, Encoding)>,
        allowed: Duration,
    ) -> Result<(Vec<u8>, Encoding), Error> {
        let begin = Instant::now();
        let mut pause = PAUSE[0];
        loop {
            let left = allowed.saturating_sub(begin.elapsed());
            // Ends early when the line breaks or nobody is there; not while the component computes.
            match self.attempt(&key, payload.clone(), left)? {
                Some(Ok(answer)) => return Ok(answer),
                Some(Err(bytes)) => match refused(request, &bytes) {
                    Error::Refused(fault) if fault.code == Code::TooManyRequests => {}
                    error => return Err(error),
                },
                None => {}
            }
            let waited = begin.elapsed();
            if waited >= allowed {
                return Err(self.no_answer(request, waited));
            }
            std::thread::sleep(pause.min(allowed - waited));
            pause = (2 * pause).min(PAUSE[1]);
        }
    }

    /// One attempt; `None` if nobody answered.
    #[allow(clippy::type_complexity, reason = "an answer or a refusal, or neither")]
    fn attempt(
        &self,
        key: &str,
        payload: Option<(Vec<u8>, Encoding)>,
        timeout: Duration,
    ) -> Result<Option<Result<(Vec<u8>, Encoding), Vec<u8>>>, Error> {
        let mut get = self.session.get(key).timeout(timeout.max(PAUSE[0]));
        get = get.attachment(self.ticket.clone());
        if let Some((bytes, encoding)) = payload {
            get = get.payload(bytes).encoding(encoding);
        }
        let replies = get.wait().map_err(|e| Error::link(key, e))?;
        while let Ok(reply) = replies.recv() {
            match reply.into_result() {
                Ok(sample) => {
                    let bytes = sample.payload().to_bytes().into_owned();
                    return Ok(Some(Ok((bytes, sample.encoding().clone()))));
                }
                // What is no JSON comes from Zenoh itself: the time of the attempt is over.
                Err(error) if *error.encoding() == Encoding::APPLICATION_JSON => {
                    return Ok(Some(Err(error.payload().to_bytes().into_owned())));
                }
                Err(_) => {}
            }
        }
        Ok(None)
    }

    /// Slow or lost.
    fn no_answer(&self, request: &str, waited: Duration) -> Error {
        let (request, waited_s) = (request.to_string(), waited.as_secs_f64());
        let heard = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        let recent = heard.at.is_some_and(|at| at.elapsed() < SILENCE);
        let alive = self.session.liveliness().get(self.keys.alive_any()).timeout(SILENCE).wait();
        let alive = alive.is_ok_and(|r| r.recv().is_ok_and(|reply| reply.result().is_ok()));
        let key = last(&self.keys.describe()).to_string();
        let key = self.keys.describe().trim_end_matches(&format!("/{key}")).to_string();
        if !recent && !alive {
            return Error::PeerLost { request, key, waited_s };
        }
        let doing = heard.status.as_ref().map_or_else(
            || "it has not told what it does".to_string(),
            |s| match (&s.progress, &s.waiting_for) {
                (Some(p), _) => format!("step {} of {} of window {}", p.step, p.steps, p.seq),
                (None, Some(what)) => format!("it waits for {what}"),
                (None, None) => format!("{:?}", s.activity),
            },
        );
        Error::Slow { request, key, waited_s, doing }
    }
}

fn read<T: DeserializeOwned>(request: &str, bytes: &[u8]) -> Result<T, Error> {
    serde_json::from_slice(bytes)
        .map_err(|e| Error::Answer { request: request.into(), what: e.to_string() })
}

fn refused(request: &str, bytes: &[u8]) -> Error {
    match serde_json::from_slice::<Fault>(bytes) {
        Ok(fault) => Error::Refused(fault),
        Err(e) => Error::Answer { request: request.into(), what: e.to_string() },
    }
}
