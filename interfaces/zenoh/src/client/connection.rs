//! The line to a component: asks until there is an answer, or it is clear that there will be none.
//!
//! Contract: every call ends. No answer and no sign of life: *peer lost*. A sign of life, but no answer
//! within the time allowed: *slow*. What got lost on the way is sent again, which is safe: a window is known
//! by its number and content, every other request by a number of its own.

use super::liveness::LivenessMonitor;
use crate::keys::{SCHEMA, last_segment};
use crate::{DISCONNECT_TIMEOUT, Error, Keys, MAX_MESSAGE_BYTES, Purpose, SessionConfig};
use ballast_protocol::description::ComponentDescription;
use ballast_protocol::lockstep::{
    ComponentState, ErrorCode, RequestError, RequestKind, StatusReport,
};
use serde::de::DeserializeOwned;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use zenoh::bytes::Encoding;
use zenoh::handlers::FifoChannelHandler;
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::CongestionControl;
use zenoh::query::{Reply, ReplyError};
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

/// Between two attempts when nobody answers, at first and at most.
const RETRY_DELAY: [Duration; 2] = [Duration::from_millis(5), Duration::from_millis(200)];
/// Between two looks at a component that computes.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// After this time an attempt is given up and made again: Zenoh remembers it for so long.
const QUERY_TIMEOUT: Duration = Duration::from_secs(600);

/// What may be behind a silence.
const ROUTER_HINT: &str = "; the router here passes on nothing between two peers: one of the two has to be its client (--router)";

/// How long calls may take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timeouts {
    /// For requests that compute nothing.
    pub control: Duration,
    /// For a window without a deadline.
    pub window: Duration,
    /// For a window beyond its deadline.
    pub deadline_margin: Duration,
    /// How long the component may be away, at first or in between.
    pub disconnect: Duration,
}

impl Default for Timeouts {
    /// 10 s, an hour, 2 s, and three heartbeats.
    fn default() -> Self {
        Self {
            control: Duration::from_secs(10),
            window: Duration::from_secs(3600),
            deadline_margin: Duration::from_secs(2),
            disconnect: DISCONNECT_TIMEOUT,
        }
    }
}

/// A line to a component, for those who look, and for [`super::Client`]s, who drive.
pub struct Connection {
    link: SessionConfig,
    session: Session,
    keys: Keys,
    liveness: Arc<LivenessMonitor>,
    pub timeouts: Timeouts,
    /// Once set, every call ends within a moment with [`Error::Cancelled`], until it is taken back.
    pub cancelled: Arc<AtomicBool>,
}

/// What is asked.
pub(super) struct OutgoingRequest<'a> {
    pub request: &'a str,
    pub key: String,
    pub payload: Option<(Vec<u8>, Encoding)>,
    /// Ticket and number.
    pub credentials: String,
}

/// How an attempt ended.
enum Attempt {
    Answered(Vec<u8>),
    Refused(RequestError),
    /// Nobody was there, or the answer got lost.
    Nothing,
}

/// Where the answers to an attempt come in.
type Replies = FifoChannelHandler<Reply>;

impl Attempt {
    /// What an answer says; `None` for a word of Zenoh itself.
    fn of(reply: Reply) -> Option<Self> {
        match reply.into_result() {
            Ok(sample) => Some(Self::Answered(sample.payload().to_bytes().into_owned())),
            Err(error) => refusal(&error).map(Self::Refused),
        }
    }
}

impl Connection {
    /// A line to the component `site/id`, which need not be there yet.
    ///
    /// # Errors
    /// A name or a link that cannot be used.
    pub fn open(component: &str, link: &SessionConfig, timeouts: Timeouts) -> Result<Self, Error> {
        Self::open_cancellable(component, link, timeouts, Arc::default())
    }

    /// The same; calls end once `cancelled` is set.
    pub(super) fn open_cancellable(
        component: &str,
        link: &SessionConfig,
        timeouts: Timeouts,
        cancelled: Arc<AtomicBool>,
    ) -> Result<Self, Error> {
        let zenoh = |e: zenoh::Error| Error::transport("zenoh", e);
        let keys = Keys::of(component)?;
        let session = link.open_for(Purpose::Client)?;
        let liveness = Arc::new(LivenessMonitor::new());
        let to = Arc::clone(&liveness);
        let listen = move |sample: Sample| {
            if let Ok(status) = serde_json::from_slice(&sample.payload().to_bytes()) {
                to.heartbeat(status);
            }
        };
        let status = session.declare_subscriber(keys.out("status")).callback(listen);
        status.background().wait().map_err(zenoh)?;
        let to = Arc::clone(&liveness);
        let watch = move |sample: Sample| {
            let run = last_segment(sample.key_expr().as_str());
            match sample.kind() {
                SampleKind::Put => to.token_appeared(run),
                SampleKind::Delete => to.token_vanished(run),
            }
        };
        let alive = session.liveliness().declare_subscriber(keys.alive_any()).history(true);
        alive.callback(watch).background().wait().map_err(zenoh)?;
        let link = link.clone();
        Ok(Self { link, session, keys, liveness, timeouts, cancelled })
    }

    /// The names under which the component is found.
    pub fn keys(&self) -> &Keys {
        &self.keys
    }

    /// Declares a client alive until the token is dropped.
    pub(super) fn declare_client(&self, client: &str) -> Result<LivelinessToken, Error> {
        let token = self.session.liveliness().declare_token(self.keys.owner(client)).wait();
        token.map_err(|e| Error::transport("zenoh", e))
    }

    /// Sends something that is not answered.
    pub(super) fn put(
        &self,
        key: String,
        bytes: Vec<u8>,
        encoding: Encoding,
        ticket: &str,
    ) -> Result<(), Error> {
        let put = self.session.put(&key, bytes).encoding(encoding).attachment(ticket);
        let put = put.congestion_control(CongestionControl::Block).express(true);
        put.wait().map_err(|e| Error::transport(key, e))
    }

    /// Calls `take` with key, encoding and bytes of everything that the component tells.
    ///
    /// # Errors
    /// The session breaks down.
    pub fn listen(
        &self,
        take: impl Fn(&str, &str, &[u8]) + Send + Sync + 'static,
    ) -> Result<(), Error> {
        let listen = move |sample: Sample| {
            let encoding = sample.encoding().to_string();
            take(sample.key_expr().as_str(), &encoding, &sample.payload().to_bytes());
        };
        let all = self.session.declare_subscriber(self.keys.out_any()).callback(listen);
        all.background().wait().map_err(|e| Error::transport("zenoh", e))
    }

    /// What the component told last under every key, for those who came late: key, encoding, bytes.
    ///
    /// # Errors
    /// The session breaks down; more is asked than the component answers.
    pub fn last_messages(&self) -> Result<Vec<(String, String, Vec<u8>)>, Error> {
        let get = self.session.get(self.keys.out_any()).timeout(self.timeouts.control);
        let replies = get.wait().map_err(|e| Error::transport("zenoh", e))?;
        let mut told = Vec::new();
        for reply in replies {
            match reply.into_result() {
                Ok(s) => {
                    let bytes = s.payload().to_bytes().into_owned();
                    told.push((s.key_expr().to_string(), s.encoding().to_string(), bytes));
                }
                Err(error) => {
                    if let Some(fault) = refusal(&error) {
                        return Err(fault.into());
                    }
                }
            }
        }
        Ok(told)
    }

    /// What the component says of itself.
    ///
    /// # Errors
    /// No answer, or none that can be read; it is being prepared.
    pub fn describe(&self) -> Result<ComponentDescription, Error> {
        self.query("describe", self.keys.describe())
    }

    /// The JSON Schema of the component's requests and replies.
    ///
    /// # Errors
    /// No answer, or none that can be read.
    pub fn schema(&self) -> Result<serde_json::Value, Error> {
        self.query("schema", format!("{}?{SCHEMA}", self.keys.describe()))
    }

    /// What the component is doing.
    ///
    /// # Errors
    /// No answer, or none that can be read.
    pub fn status(&self) -> Result<StatusReport, Error> {
        let verb = RequestKind::Status.name();
        self.query(verb, self.keys.control(verb))
    }

    fn query<T: DeserializeOwned>(&self, request: &str, key: String) -> Result<T, Error> {
        let ask = OutgoingRequest { request, key, payload: None, credentials: String::new() };
        decode(request, &self.call(&ask, self.timeouts.control)?)
    }

    /// What the component was doing at its last heartbeat.
    pub fn last_status(&self) -> Option<StatusReport> {
        self.liveness.status()
    }

    /// Asks until there is an answer or the time allowed is over.
    pub(super) fn call(&self, ask: &OutgoingRequest, allowed: Duration) -> Result<Vec<u8>, Error> {
        if let Some((bytes, _)) = ask.payload.as_ref().filter(|p| p.0.len() > MAX_MESSAGE_BYTES) {
            // It would never arrive: the wire drops what is larger.
            let expected = format!("at most {MAX_MESSAGE_BYTES} bytes");
            return Err(RequestError::expected(
                ErrorCode::TooLarge,
                ask.request,
                expected,
                bytes.len(),
            )
            .into());
        }
        let begin = Instant::now();
        let (mut sent, mut pause) = (Vec::new(), RETRY_DELAY[0]);
        loop {
            match self.attempt(ask, &mut sent, begin, allowed)? {
                Attempt::Answered(bytes) => return Ok(bytes),
                Attempt::Refused(fault) if fault.code != ErrorCode::TooManyRequests => {
                    return Err(fault.into());
                }
                Attempt::Refused(_) | Attempt::Nothing => {}
            }
            self.check(ask, begin, allowed)?;
            self.liveness.wait(pause);
            pause = (2 * pause).min(RETRY_DELAY[1]);
        }
    }

    /// Asks, and waits for an answer to this or to what was `sent` before: on a slow wire it may be under way for long.
    fn attempt(
        &self,
        ask: &OutgoingRequest,
        sent: &mut Vec<Replies>,
        begin: Instant,
        allowed: Duration,
    ) -> Result<Attempt, Error> {
        let mut get = self
            .session
            .get(&ask.key)
            .timeout(QUERY_TIMEOUT)
            .congestion_control(CongestionControl::Block)
            .express(true)
            .attachment(ask.credentials.clone());
        if let Some((bytes, encoding)) = &ask.payload {
            get = get.payload(bytes.clone()).encoding(encoding.clone());
        }
        let asked = Instant::now();
        let replies = get.wait().map_err(|e| Error::transport(&ask.key, e))?;
        // What has taken its time to go out may take as long to arrive.
        let (heartbeats, out, took) = (self.liveness.heartbeats(), Instant::now(), asked.elapsed());
        loop {
            let mut late = sent.iter().filter_map(|replies| replies.try_recv().ok().flatten());
            if let Some(ended) = late.find_map(Attempt::of) {
                return Ok(ended);
            }
            match replies.recv_timeout(POLL_INTERVAL) {
                Ok(Some(reply)) => {
                    if let Some(ended) = Attempt::of(reply) {
                        return Ok(ended);
                    }
                }
                Ok(None) => {
                    self.check(ask, begin, allowed)?;
                    if out.elapsed() >= took && self.liveness.is_idle_since(heartbeats) {
                        sent.push(replies);
                        return Ok(Attempt::Nothing);
                    }
                }
                // All replies are in, and none is an answer.
                Err(_) => return Ok(Attempt::Nothing),
            }
        }
    }

    /// Whether the component was there not longer than so ago, counted from `since` at the earliest, if that is given.
    fn ensure_connected(
        &self,
        request: &str,
        since: Option<Instant>,
        most: Duration,
    ) -> Result<(), Error> {
        let gone = self.liveness.disconnected_for(since).filter(|gone| *gone >= most);
        gone.map_or(Ok(()), |gone| {
            let (request, component) = (request.to_string(), self.keys.name().to_string());
            let hint =
                if self.link.is_isolated_by_router(&self.session) { ROUTER_HINT } else { "" };
            Err(Error::Disconnected { request, component, silent_s: gone.as_secs_f64(), hint })
        })
    }

    /// Whether what is sent without an answer is heeded, by what the component has told since it had told what it does so
    /// many times.
    pub(super) fn ensure_owner(
        &self,
        request: &str,
        client: &str,
        ticket: &str,
        heartbeats: u64,
    ) -> Result<(), Error> {
        self.ensure_connected(request, None, self.timeouts.disconnect)?;
        match self.liveness.owner_since(heartbeats) {
            Some(owner) if owner.as_deref() != Some(client) => {
                Err(RequestError::not_owner(ticket, owner.as_deref()).into())
            }
            _ => Ok(()),
        }
    }

    /// How many times the component has told what it does.
    pub(super) fn heartbeats(&self) -> u64 {
        self.liveness.heartbeats()
    }

    /// Whether it still makes sense to wait.
    fn check(&self, ask: &OutgoingRequest, begin: Instant, allowed: Duration) -> Result<(), Error> {
        let (request, component) = (ask.request.to_string(), self.keys.name().to_string());
        let waited = begin.elapsed();
        if self.cancelled.load(Ordering::Relaxed) {
            return Err(Error::Cancelled { request, component, waited_s: waited.as_secs_f64() });
        }
        // Someone who is away is lost, not slow, also where the time allowed is shorter.
        self.ensure_connected(ask.request, Some(begin), self.timeouts.disconnect.min(allowed))?;
        if waited < allowed {
            return Ok(());
        }
        let activity = describe_activity(self.liveness.status().as_ref());
        Err(Error::Timeout { request, component, waited_s: waited.as_secs_f64(), activity })
    }
}

/// A refusal of ours; what is none comes from Zenoh itself: nobody is there, or the time of the query is over.
fn refusal(error: &ReplyError) -> Option<RequestError> {
    serde_json::from_slice(&error.payload().to_bytes()).ok()
}

fn describe_activity(status: Option<&StatusReport>) -> String {
    let Some(status) = status else { return "it has not told what it does".into() };
    match (&status.progress, &status.waiting_for) {
        (Some(p), _) if status.state == ComponentState::Running => {
            let seconds = |ms: u64| ms as f64 * 1e-3;
            let time = match p.remaining_ms {
                Some(ms) => format!("{:.1} s left", seconds(ms)),
                None => format!("its first one for {:.1} s", seconds(p.elapsed_ms)),
            };
            format!("step {} of {} of window {}, {time}", p.step, p.steps, p.seq)
        }
        (_, Some(what)) => format!("it waits for {what}"),
        _ => status.state.to_string(),
    }
}

pub(super) fn decode<T: DeserializeOwned>(request: &str, bytes: &[u8]) -> Result<T, Error> {
    serde_json::from_slice(bytes).map_err(|e| Error::bad_reply(request, e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ballast_protocol::lockstep::WindowProgress;

    #[test]
    fn what_is_left_is_told_when_a_step_has_told_it() {
        let told = |progress| {
            let (state, progress) = (ComponentState::Running, Some(progress));
            describe_activity(Some(&StatusReport { state, progress, ..StatusReport::default() }))
        };
        let begun =
            WindowProgress { seq: 7, steps: 3, elapsed_ms: 4200, ..WindowProgress::default() };
        assert_eq!(told(begun), "step 0 of 3 of window 7, its first one for 4.2 s");
        let on = WindowProgress { step: 1, remaining_ms: Some(8400), ..begun };
        assert_eq!(told(on), "step 1 of 3 of window 7, 8.4 s left");
    }
}
