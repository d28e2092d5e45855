//! Between a client and a component: loses, repeats and delays what passes, at random.

use crate::common::scene::Random;
use crate::setup::KEY;
use ballast_zenoh::session::free_endpoint;
use ballast_zenoh::{Keys, SessionConfig};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::key_expr::KeyExpr;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::Query;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

/// Probabilities of the events of a request.
#[derive(Clone, Copy, Default)]
pub struct Faults {
    /// It does not arrive, and the client gets the error of a missing component.
    pub refuse: f64,
    /// It does not arrive, and the client hears nothing.
    pub swallow: f64,
    /// It arrives twice.
    pub repeat: f64,
    /// An older one arrives with it.
    pub echo: f64,
    /// The reply does not arrive, and the client gets the error of a missing reply.
    pub lose_reply: f64,
    /// The reply comes late, by at most so much.
    pub delay: Duration,
}

pub struct Relay {
    pub endpoint: String,
    _front: Session,
    _back: Session,
}

/// Request.
#[derive(Clone)]
struct Request {
    key: KeyExpr<'static>,
    payload: Option<ZBytes>,
    encoding: Option<Encoding>,
    attachment: Option<ZBytes>,
}

impl Request {
    fn of(query: &Query) -> Self {
        Self {
            key: query.key_expr().clone(),
            payload: query.payload().cloned(),
            encoding: query.encoding().cloned(),
            attachment: query.attachment().cloned(),
        }
    }
}

struct Passing {
    back: Session,
    random: Mutex<Random>,
    faults: Faults,
    /// Requests that were swallowed: as long as they are kept, Zenoh waits for their answer.
    kept: Mutex<Vec<Query>>,
    /// A request of old; not the query itself, which would keep its caller waiting.
    old: Mutex<Option<Request>>,
}

impl Relay {
    pub fn before(component: &SessionConfig, seed: u64, faults: Faults) -> Self {
        let keys = Keys::of(KEY).unwrap();
        let back = component.open().unwrap();
        let endpoint = free_endpoint().unwrap();
        let front = SessionConfig::listen_on(&endpoint).open().unwrap();
        mirror(&back, &front, keys.alive_any());
        mirror(&front, &back, keys.owner_any());
        let to = front.clone();
        let status = back.declare_subscriber(keys.out("status")).callback(move |sample: Sample| {
            let put = to.put(sample.key_expr().clone(), sample.payload().clone());
            let _ = put.encoding(sample.encoding().clone()).wait();
        });
        status.background().wait().unwrap();
        let passing = Arc::new(Passing {
            back: back.clone(),
            random: Mutex::new(Random(seed)),
            faults,
            kept: Mutex::default(),
            old: Mutex::default(),
        });
        let control = front.declare_queryable(keys.control_any()).complete(true);
        let control = control.callback(move |query| {
            let passing = Arc::clone(&passing);
            std::thread::spawn(move || passing.pass(query));
        });
        control.background().wait().unwrap();
        Self { endpoint, _front: front, _back: back }
    }
}

impl Passing {
    fn roll(&self, probability: f64) -> bool {
        self.random.lock().unwrap().next() < probability
    }

    fn pass(&self, query: Query) {
        let faults = self.faults;
        if self.roll(faults.refuse) {
            return;
        }
        if self.roll(faults.swallow) {
            return self.kept.lock().unwrap().push(query);
        }
        let request = Request::of(&query);
        let old = self.old.lock().unwrap().clone();
        if let Some(old) = old.filter(|_| self.roll(faults.echo)) {
            let _ = self.forward(&old);
        }
        if self.roll(faults.repeat) {
            let _ = self.forward(&request);
        }
        let answer = self.forward(&request);
        if self.roll(0.2) {
            *self.old.lock().unwrap() = Some(request);
        }
        let share = self.random.lock().unwrap().next();
        std::thread::sleep(faults.delay.mul_f64(share));
        if self.roll(faults.lose_reply) {
            return;
        }
        let _ = match answer {
            Some(Ok(sample)) => query
                .reply(sample.key_expr().clone(), sample.payload().clone())
                .encoding(sample.encoding().clone())
                .wait(),
            Some(Err(payload)) => query.reply_err(payload).wait(),
            None => return,
        };
    }

    fn forward(&self, request: &Request) -> Option<Result<Sample, Vec<u8>>> {
        let Request { key, payload, encoding, attachment } = request.clone();
        let mut get = self.back.get(key).timeout(Duration::from_secs(20));
        if let Some(payload) = payload {
            get = get.payload(payload);
        }
        if let Some(encoding) = encoding {
            get = get.encoding(encoding);
        }
        if let Some(attachment) = attachment {
            get = get.attachment(attachment);
        }
        let reply = get.wait().unwrap().recv().ok()?;
        Some(reply.into_result().map_err(|e| e.payload().to_bytes().into_owned()))
    }
}

/// Declares the tokens of one session in the other.
fn mirror(from: &Session, to: &Session, key: String) {
    let (to, tokens) = (to.clone(), Mutex::new(BTreeMap::<String, LivelinessToken>::new()));
    let watch = move |sample: Sample| {
        let key = sample.key_expr().to_string();
        let mut tokens = tokens.lock().unwrap();
        if sample.kind() == SampleKind::Delete {
            tokens.remove(&key);
        } else if let Ok(token) = to.liveliness().declare_token(key.clone()).wait() {
            tokens.insert(key, token);
        }
    };
    let tokens = from.liveliness().declare_subscriber(key).history(true).callback(watch);
    tokens.background().wait().unwrap();
}
