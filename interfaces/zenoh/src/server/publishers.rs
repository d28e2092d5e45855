//! Publishers of window results, and the last message of each key for late observers.
//!
//! Contract: a subscriber receives every message or is disconnected by the transport. The last message of every key
//! is stored and returned to queries.

use super::reply;
use super::status::SharedStatus;
use crate::wire::cdr;
use crate::{Error, Keys, lock_unpoisoned};
use ballast::model::Model;
use ballast_protocol::lockstep::WindowKind;
use ballast_protocol::messages::{
    AdvanceReply, Clock, Log, Message, PoseStamped, StateHash, Time, TwistStamped, WrenchImpulse,
    WrenchStamped, core_ns,
};
use ballast_protocol::to_cdr;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use zenoh::bytes::Encoding;
use zenoh::key_expr::KeyExpr;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::query::Query;
use zenoh::{Session, Wait};

/// Last message of each key: bytes and encoding.
type LastMessages = Arc<Mutex<BTreeMap<String, (Vec<u8>, Encoding)>>>;

/// Publishers by key.
pub(super) struct Publishers {
    session: Session,
    keys: Keys,
    publishers: BTreeMap<String, Publisher<'static>>,
    last: LastMessages,
    /// Keys of the squeezes published by the last window; a redo may publish others.
    squeezes: Vec<String>,
}

impl Publishers {
    pub fn declare(
        session: &Session,
        keys: &Keys,
        shared: &Arc<SharedStatus>,
        model: &Model,
    ) -> Result<Self, Error> {
        let last = LastMessages::default();
        let mut publishers = Self {
            session: session.clone(),
            keys: keys.clone(),
            publishers: BTreeMap::new(),
            last: Arc::clone(&last),
            squeezes: vec![],
        };
        for body in &model.driven {
            for what in ["pose", "twist", "wrench", "impulse"] {
                publishers.open(keys.out_body(&body.name, what))?;
            }
        }
        for what in ["clock", "solver", "hash", "log"] {
            publishers.open(keys.out(what))?;
        }
        let late = session.declare_queryable(keys.out_any());
        let (shared, status) = (Arc::clone(shared), keys.out("status"));
        let late = late.callback(move |query| match shared.check_rate() {
            Ok(()) => answer_late_observer(&last, &query, &status, &shared),
            Err(fault) => reply::send(&query, status.clone(), Err(fault)),
        });
        late.background().wait().map_err(|e| Error::transport("zenoh", e))?;
        Ok(publishers)
    }

    fn open(&mut self, key: String) -> Result<(), Error> {
        let publisher = self
            .session
            .declare_publisher(key.clone())
            .congestion_control(CongestionControl::Block)
            .wait()
            .map_err(|e| Error::transport(key.clone(), e))?;
        self.publishers.insert(key, publisher);
        Ok(())
    }

    fn put<T: Message>(&mut self, key: String, message: &T) {
        if !self.publishers.contains_key(&key) && self.open(key.clone()).is_err() {
            return;
        }
        if let (Some(publisher), Ok(bytes)) = (self.publishers.get(&key), to_cdr(message)) {
            // Stored first, so that a query in between returns the new message.
            lock_unpoisoned(&self.last).insert(key, (bytes.clone(), cdr::<T>()));
            // Publishing without subscribers is no error.
            let _ = publisher.put(bytes).encoding(cdr::<T>()).wait();
        }
    }

    fn publish_body(&mut self, body: &WrenchImpulse) {
        let (header, name) = (body.header.clone(), &body.body);
        let pose = PoseStamped { header: header.clone(), pose: body.pose };
        self.put(self.keys.out_body(name, "pose"), &pose);
        let twist = TwistStamped { header: header.clone(), twist: body.twist };
        self.put(self.keys.out_body(name, "twist"), &twist);
        let wrench = WrenchStamped { header, wrench: body.mean };
        self.put(self.keys.out_body(name, "wrench"), &wrench);
        self.put(self.keys.out_body(name, "impulse"), body);
    }

    /// Publishes the results of a window; the clock is published last.
    ///
    /// A rolled-back window is only logged. A rolled-back redo also invalidates the results of the previous window.
    pub fn publish_window(&mut self, kind: WindowKind, reply: &AdvanceReply) {
        if !reply.status.is_kept() {
            let AdvanceReply { seq, status, message, .. } = reply;
            let text = format!("window {seq} was rolled back ({}): {message}", status.word());
            self.log(core_ns(reply.t1_ns), &text);
            let now_ns = core_ns(reply.t1_ns);
            return match kind {
                WindowKind::Advance => self.publish_position(reply.hash, now_ns),
                WindowKind::Redo => self.publish_replaced_state(reply.hash, now_ns),
            };
        }
        let before = std::mem::take(&mut self.squeezes);
        if kind == WindowKind::Redo {
            lock_unpoisoned(&self.last).retain(|key, _| !before.contains(key));
        }
        for body in &reply.bodies {
            self.publish_body(body);
        }
        for zone in &reply.zones {
            self.put(self.keys.out_zone(&zone.zone), zone);
        }
        for squeeze in &reply.squeezes {
            let key = self.keys.out_squeeze(&squeeze.pair);
            self.put(key.clone(), squeeze);
            self.squeezes.push(key);
        }
        self.put(self.keys.out("solver"), &reply.solver);
        self.publish_position(reply.hash, core_ns(reply.t1_ns));
    }

    /// Publishes that the state was replaced, and removes the stored results of earlier windows.
    pub fn publish_replaced_state(&mut self, hash: StateHash, now_ns: u64) {
        let log = self.keys.out("log");
        lock_unpoisoned(&self.last).retain(|key, _| *key == log);
        self.publish_position(hash, now_ns);
    }

    /// Publishes hash and time of the run.
    fn publish_position(&mut self, hash: StateHash, now_ns: u64) {
        self.put(self.keys.out("hash"), &hash);
        self.put(self.keys.out("clock"), &Clock { clock: Time::from_ns(now_ns) });
    }

    /// Publishes a log message at a simulated time.
    pub fn log(&mut self, now_ns: u64, text: &str) {
        let log = Log::info(now_ns, self.keys.name(), text);
        self.put(self.keys.out("log"), &log);
    }
}

/// Answers a query with the last messages of its keys, and with the current status.
fn answer_late_observer(last: &LastMessages, query: &Query, status: &str, shared: &SharedStatus) {
    let is_wanted =
        |key: &str| KeyExpr::try_from(key).is_ok_and(|key| query.key_expr().intersects(&key));
    let last = lock_unpoisoned(last);
    let mut wanted: Vec<_> = last
        .iter()
        .filter(|(key, _)| is_wanted(key))
        .map(|(key, (bytes, encoding))| (key.clone(), bytes.clone(), encoding.clone()))
        .collect();
    drop(last);
    if is_wanted(status) {
        let text = serde_json::to_vec(&shared.status()).unwrap_or_default();
        wanted.push((status.to_string(), text, Encoding::APPLICATION_JSON));
    }
    for (key, bytes, encoding) in wanted {
        // A client that has disconnected needs no reply.
        let _ = query.reply(key, bytes).encoding(encoding).wait();
    }
}
