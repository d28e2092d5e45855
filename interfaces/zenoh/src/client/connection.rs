//! Connection to a component: repeats requests until a reply arrives or a timeout expires.
//!
//! Contract: every call ends. Without heartbeat and reply it fails with [`Error::Disconnected`], with a heartbeat but
//! without reply in time with [`Error::Timeout`]. Repeating a request is safe: windows are identified by number and
//! content, other requests by a request number.

use super::liveness::LivenessMonitor;
use super::send_thread::{POLL_INTERVAL, SendThread};
use crate::keys::{SCHEMA, last_segment};
use crate::{DISCONNECT_TIMEOUT, Error, Keys, MAX_MESSAGE_BYTES, Purpose, SessionConfig};
use ballast::cancel::CancelToken;
use ballast_protocol::description::ComponentDescription;
use ballast_protocol::lockstep::{
    ComponentState, ErrorCode, RequestError, RequestKind, StatusReport,
};
use serde::de::DeserializeOwned;
use std::sync::Arc;
use std::time::{Duration, Instant};
use zenoh::bytes::Encoding;
use zenoh::handlers::FifoChannelHandler;
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::CongestionControl;
use zenoh::query::{Reply, ReplyError};
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

/// Delay between two attempts without reply: initial and maximum.
const RETRY_DELAY: [Duration; 2] = [Duration::from_millis(5), Duration::from_millis(200)];
/// Timeout of a Zenoh query, after which the request is sent again.
const QUERY_TIMEOUT: Duration = Duration::from_secs(600);

/// Hint for a component that cannot be found through a router.
const ROUTER_HINT: &str =
    "; the router forwards nothing between two peers: one of the two must be its client (--router)";

/// Timeouts of calls.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Timeouts {
    /// Timeout of requests that compute nothing.
    pub control: Duration,
    /// Timeout of a window without a deadline.
    pub window: Duration,
    /// Time added to the deadline of a window.
    pub deadline_margin: Duration,
    /// Time without heartbeat and liveliness token after which the component counts as disconnected.
    pub disconnect: Duration,
}

impl Default for Timeouts {
    /// Returns 10 s, one hour, 2 s, and three heartbeats.
    fn default() -> Self {
        Self {
            control: Duration::from_secs(10),
            window: Duration::from_secs(3600),
            deadline_margin: Duration::from_secs(2),
            disconnect: DISCONNECT_TIMEOUT,
        }
    }
}

/// Connection to a component: read-only requests and subscriptions; a [`super::Client`] adds ownership.
pub struct Connection {
    link: SessionConfig,
    session: Session,
    keys: Keys,
    liveness: Arc<LivenessMonitor>,
    send_thread: SendThread,
    /// Timeouts of calls.
    pub timeouts: Timeouts,
    /// Token that ends every call with [`Error::Cancelled`] until it is reset.
    pub cancel: CancelToken,
}

/// Request to be sent.
pub(super) struct OutgoingRequest<'a> {
    pub request: &'a str,
    pub key: String,
    pub payload: Option<(Vec<u8>, Encoding)>,
    /// Ticket and number.
    pub credentials: String,
}

/// Result of one attempt to send a request.
enum Attempt {
    Answered(Vec<u8>),
    Refused(RequestError),
    /// No reply has arrived.
    NoReply,
}

/// Channel of the replies to an attempt.
type Replies = FifoChannelHandler<Reply>;

impl Attempt {
    /// Converts a reply; `None` for an error of Zenoh.
    fn of(reply: Reply) -> Option<Self> {
        match reply.into_result() {
            Ok(sample) => Some(Self::Answered(sample.payload().to_bytes().into_owned())),
            Err(error) => refusal(&error).map(Self::Refused),
        }
    }
}

impl Connection {
    /// Opens a connection to the component `site/id`, which may start later.
    ///
    /// # Errors
    /// An invalid name, or a session that cannot be opened.
    pub fn open(component: &str, link: &SessionConfig, timeouts: Timeouts) -> Result<Self, Error> {
        Self::open_cancellable(component, link, timeouts, CancelToken::default())
    }

    /// Opens a connection whose calls `cancel` ends.
    pub(super) fn open_cancellable(
        component: &str,
        link: &SessionConfig,
        timeouts: Timeouts,
        cancel: CancelToken,
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
        let (link, send_thread) = (link.clone(), SendThread::start()?);
        Ok(Self { link, session, keys, liveness, send_thread, timeouts, cancel })
    }

    /// Returns the key expressions of the component.
    pub fn keys(&self) -> &Keys {
        &self.keys
    }

    /// Declares the liveliness token of a client.
    pub(super) fn declare_client(&self, client: &str) -> Result<LivelinessToken, Error> {
        let token = self.session.liveliness().declare_token(self.keys.owner(client)).wait();
        token.map_err(|e| Error::transport("zenoh", e))
    }

    /// Publishes a message without reply; `request` stands for it in errors.
    pub(super) fn put(
        &self,
        request: &str,
        key: String,
        bytes: Vec<u8>,
        encoding: Encoding,
        ticket: &str,
    ) -> Result<(), Error> {
        let ticket = ticket.to_string();
        self.send(request, Instant::now(), self.timeouts.control, move |session| {
            let put = session.put(key, bytes).encoding(encoding).attachment(ticket);
            put.congestion_control(CongestionControl::Block).express(true).wait()
        })
    }

    /// Sends a message with `send`; gives up as a call does that began at `begin` and may last for `allowed`.
    fn send<T: Send + 'static>(
        &self,
        request: &str,
        begin: Instant,
        allowed: Duration,
        send: impl FnOnce(&Session) -> zenoh::Result<T> + Send + 'static,
    ) -> Result<T, Error> {
        let session = self.session.clone();
        let check = || self.check(request, begin, allowed);
        let sent = self.send_thread.run(move || send(&session), check)?;
        sent.map_err(|e| Error::transport(request, e))
    }

    /// Subscribes to all messages of the component; `callback` receives key, encoding and bytes.
    ///
    /// # Errors
    /// The session fails.
    pub fn subscribe(
        &self,
        callback: impl Fn(&str, &str, &[u8]) + Send + Sync + 'static,
    ) -> Result<(), Error> {
        let listen = move |sample: Sample| {
            let encoding = sample.encoding().to_string();
            callback(sample.key_expr().as_str(), &encoding, &sample.payload().to_bytes());
        };
        let all = self.session.declare_subscriber(self.keys.out_any()).callback(listen);
        all.background().wait().map_err(|e| Error::transport("zenoh", e))
    }

    /// Returns the last message of every key of the component: key, encoding, bytes.
    ///
    /// # Errors
    /// The session fails, or the component refuses the request.
    pub fn last_messages(&self) -> Result<Vec<(String, String, Vec<u8>)>, Error> {
        let (key, timeout) = (self.keys.out_any(), self.timeouts.control);
        let get = move |session: &Session| session.get(key).timeout(timeout).wait();
        let replies = self.send("messages", Instant::now(), timeout, get)?;
        let mut messages = Vec::new();
        for reply in replies {
            match reply.into_result() {
                Ok(s) => {
                    let bytes = s.payload().to_bytes().into_owned();
                    messages.push((s.key_expr().to_string(), s.encoding().to_string(), bytes));
                }
                Err(error) => {
                    if let Some(fault) = refusal(&error) {
                        return Err(fault.into());
                    }
                }
            }
        }
        Ok(messages)
    }

    /// Returns the description of the component.
    ///
    /// # Errors
    /// No valid reply, or the bed is being prepared.
    pub fn describe(&self) -> Result<ComponentDescription, Error> {
        self.query("describe", self.keys.describe())
    }

    /// Returns the JSON Schema of the component's requests and replies.
    ///
    /// # Errors
    /// No valid reply.
    pub fn schema(&self) -> Result<serde_json::Value, Error> {
        self.query("schema", format!("{}?{SCHEMA}", self.keys.describe()))
    }

    /// Returns the status of the component.
    ///
    /// # Errors
    /// No valid reply.
    pub fn status(&self) -> Result<StatusReport, Error> {
        let verb = RequestKind::Status.name();
        self.query(verb, self.keys.control(verb))
    }

    fn query<T: DeserializeOwned>(&self, request: &str, key: String) -> Result<T, Error> {
        let ask = OutgoingRequest { request, key, payload: None, credentials: String::new() };
        decode(request, &self.call(&ask, self.timeouts.control)?)
    }

    /// Returns the status of the last heartbeat.
    pub fn last_status(&self) -> Option<StatusReport> {
        self.liveness.status()
    }

    /// Sends a request repeatedly until a reply arrives or the timeout expires.
    pub(super) fn call(&self, ask: &OutgoingRequest, allowed: Duration) -> Result<Vec<u8>, Error> {
        if let Some((bytes, _)) = ask.payload.as_ref().filter(|p| p.0.len() > MAX_MESSAGE_BYTES) {
            // Zenoh would drop a larger message.
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
                Attempt::Refused(_) | Attempt::NoReply => {}
            }
            self.check(ask.request, begin, allowed)?;
            self.liveness.wait(pause);
            pause = (2 * pause).min(RETRY_DELAY[1]);
        }
    }

    /// Sends a request once and waits for a reply to it or to an earlier attempt, which a slow connection may delay.
    fn attempt(
        &self,
        ask: &OutgoingRequest,
        sent: &mut Vec<Replies>,
        begin: Instant,
        allowed: Duration,
    ) -> Result<Attempt, Error> {
        let (key, credentials, payload) =
            (ask.key.clone(), ask.credentials.clone(), ask.payload.clone());
        let get = move |session: &Session| {
            let get = session.get(key).timeout(QUERY_TIMEOUT).attachment(credentials);
            let get = get.congestion_control(CongestionControl::Block).express(true);
            match payload {
                Some((bytes, encoding)) => get.payload(bytes).encoding(encoding).wait(),
                None => get.wait(),
            }
        };
        let asked = Instant::now();
        let replies = self.send(ask.request, begin, allowed, get)?;
        // A request that took long to send may take as long to arrive.
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
                    self.check(ask.request, begin, allowed)?;
                    if out.elapsed() >= took && self.liveness.is_idle_since(heartbeats) {
                        sent.push(replies);
                        return Ok(Attempt::NoReply);
                    }
                }
                // The query has ended without a reply of the component.
                Err(_) => return Ok(Attempt::NoReply),
            }
        }
    }

    /// Returns an error if the component has been disconnected for `timeout`, counted from `since` at the earliest.
    fn ensure_connected(
        &self,
        request: &str,
        since: Option<Instant>,
        timeout: Duration,
    ) -> Result<(), Error> {
        let gone = self.liveness.disconnected_for(since).filter(|gone| *gone >= timeout);
        gone.map_or(Ok(()), |gone| {
            let (request, component) = (request.to_string(), self.keys.name().to_string());
            let hint =
                if self.link.is_isolated_by_router(&self.session) { ROUTER_HINT } else { "" };
            Err(Error::Disconnected { request, component, silent_s: gone.as_secs_f64(), hint })
        })
    }

    /// Returns an error if the component is disconnected or a heartbeat after number `heartbeats` names another owner.
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

    /// Returns the number of received heartbeats.
    pub(super) fn heartbeats(&self) -> u64 {
        self.liveness.heartbeats()
    }

    /// Returns an error if the call is cancelled, the component disconnected, or the timeout expired.
    fn check(&self, request: &str, begin: Instant, allowed: Duration) -> Result<(), Error> {
        let waited = begin.elapsed();
        let component = self.keys.name().to_string();
        if self.cancel.reason().is_some() {
            let (request, waited_s) = (request.into(), waited.as_secs_f64());
            return Err(Error::Cancelled { request, component, waited_s });
        }
        // A disconnected component is reported as such, also if the timeout is shorter.
        self.ensure_connected(request, Some(begin), self.timeouts.disconnect.min(allowed))?;
        if waited < allowed {
            return Ok(());
        }
        let activity = describe_activity(self.liveness.status().as_ref());
        let (request, waited_s) = (request.into(), waited.as_secs_f64());
        Err(Error::Timeout { request, component, waited_s, activity })
    }
}

/// Decodes the error of a component; other errors come from Zenoh, which found no component in time.
fn refusal(error: &ReplyError) -> Option<RequestError> {
    serde_json::from_slice(&error.payload().to_bytes()).ok()
}

fn describe_activity(status: Option<&StatusReport>) -> String {
    let Some(status) = status else { return "no status received".into() };
    match (&status.progress, &status.waiting_for) {
        (Some(p), _) if status.state == ComponentState::Running => {
            let seconds = |ms: u64| ms as f64 * 1e-3;
            let time = match p.remaining_ms {
                Some(ms) => format!("{:.1} s remaining", seconds(ms)),
                None => format!("first step running for {:.1} s", seconds(p.elapsed_ms)),
            };
            format!("step {} of {} of window {}, {time}", p.step, p.steps, p.seq)
        }
        (_, Some(what)) => format!("waiting for {what}"),
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
    fn remaining_time_is_known_after_the_first_step() {
        let text = |progress| {
            let (state, progress) = (ComponentState::Running, Some(progress));
            describe_activity(Some(&StatusReport { state, progress, ..StatusReport::default() }))
        };
        let begun =
            WindowProgress { seq: 7, steps: 3, elapsed_ms: 4200, ..WindowProgress::default() };
        assert_eq!(text(begun), "step 0 of 3 of window 7, first step running for 4.2 s");
        let on = WindowProgress { step: 1, remaining_ms: Some(8400), ..begun };
        assert_eq!(text(on), "step 1 of 3 of window 7, 8.4 s remaining");
    }
}
