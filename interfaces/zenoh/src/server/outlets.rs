//! What everyone is told after a window, and what late observers are told when they ask.
//!
//! Contract: whoever listens gets all of it or is cut off by the transport; the last message of every key is
//! kept for those who come later and ask with a query.

use super::answer;
use super::shared::Shared;
use crate::wire::cdr;
use crate::{Error, Keys, locked};
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

/// Last message by key: bytes and encoding.
type Last = Arc<Mutex<BTreeMap<String, (Vec<u8>, Encoding)>>>;

/// Publishers by key, declared once.
pub(super) struct Outlets {
    session: Session,
    keys: Keys,
    by_key: BTreeMap<String, Publisher<'static>>,
    last: Last,
    /// Keys of the squeezes that the last window has told: computed anew, it may have others.
    squeezes: Vec<String>,
}

impl Outlets {
    pub fn declare(
        session: &Session,
        keys: &Keys,
        shared: &Arc<Shared>,
        model: &Model,
    ) -> Result<Self, Error> {
        let last = Last::default();
        let mut outlets = Self {
            session: session.clone(),
            keys: keys.clone(),
            by_key: BTreeMap::new(),
            last: Arc::clone(&last),
            squeezes: vec![],
        };
        for body in &model.driven {
            for what in ["pose", "twist", "wrench", "impulse"] {
                outlets.open(keys.out_body(&body.name, what))?;
            }
        }
        for what in ["clock", "solver", "hash", "log"] {
            outlets.open(keys.out(what))?;
        }
        let late = session.declare_queryable(keys.out_any());
        let (shared, status) = (Arc::clone(shared), keys.out("status"));
        let late = late.callback(move |query| match shared.check_rate() {
            Ok(()) => tell_late(&last, &query, &status, &shared),
            Err(fault) => answer::send(&query, status.clone(), Err(fault)),
        });
        late.background().wait().map_err(|e| Error::link("zenoh", e))?;
        Ok(outlets)
    }

    fn open(&mut self, key: String) -> Result<(), Error> {
        let publisher = self
            .session
            .declare_publisher(key.clone())
            .congestion_control(CongestionControl::Block)
            .wait()
            .map_err(|e| Error::link(key.clone(), e))?;
        self.by_key.insert(key, publisher);
        Ok(())
    }

    fn put<T: Message>(&mut self, key: String, message: &T) {
        if !self.by_key.contains_key(&key) && self.open(key.clone()).is_err() {
            return;
        }
        if let (Some(publisher), Ok(bytes)) = (self.by_key.get(&key), to_cdr(message)) {
            // First: who comes in between is told twice, and not of what was before.
            locked(&self.last).insert(key, (bytes.clone(), cdr::<T>()));
            // Whoever listens is told; nobody has to.
            let _ = publisher.put(bytes).encoding(cdr::<T>()).wait();
        }
    }

    fn body(&mut self, body: &WrenchImpulse) {
        let (header, name) = (body.header.clone(), &body.body);
        let pose = PoseStamped { header: header.clone(), pose: body.pose };
        self.put(self.keys.out_body(name, "pose"), &pose);
        let twist = TwistStamped { header: header.clone(), twist: body.twist };
        self.put(self.keys.out_body(name, "twist"), &twist);
        let wrench = WrenchStamped { header, wrench: body.mean };
        self.put(self.keys.out_body(name, "wrench"), &wrench);
        self.put(self.keys.out_body(name, "impulse"), body);
    }

    /// Tells everyone what a window has done; the clock comes last and closes it. Of one that was taken back there is
    /// nothing to tell but that it was: bodies bear what they bore. With a redo the window that stood is gone, too.
    pub fn window(&mut self, kind: WindowKind, reply: &AdvanceReply) {
        if !reply.status.is_kept() {
            let AdvanceReply { seq, status, message, .. } = reply;
            let text = format!("window {seq} was taken back ({}): {message}", status.word());
            self.log(core_ns(reply.t1_ns), &text);
            let now_ns = core_ns(reply.t1_ns);
            return match kind {
                WindowKind::Advance => self.moment(reply.hash, now_ns),
                WindowKind::Redo => self.elsewhere(reply.hash, now_ns),
            };
        }
        let before = std::mem::take(&mut self.squeezes);
        if kind == WindowKind::Redo {
            locked(&self.last).retain(|key, _| !before.contains(key));
        }
        for body in &reply.bodies {
            self.body(body);
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
        self.moment(reply.hash, core_ns(reply.t1_ns));
    }

    /// Tells everyone that the run goes on from elsewhere; what windows before that have message holds no more.
    pub fn elsewhere(&mut self, hash: StateHash, now_ns: u64) {
        let log = self.keys.out("log");
        locked(&self.last).retain(|key, _| *key == log);
        self.moment(hash, now_ns);
    }

    /// State and time of the run.
    fn moment(&mut self, hash: StateHash, now_ns: u64) {
        self.put(self.keys.out("hash"), &hash);
        self.put(self.keys.out("clock"), &Clock { clock: Time::from_ns(now_ns) });
    }

    /// Tells everyone a line of the log, at a time of the run.
    pub fn log(&mut self, now_ns: u64, text: &str) {
        let log = Log::info(now_ns, self.keys.name(), text);
        self.put(self.keys.out("log"), &log);
    }
}

/// Answers with the last messages under the keys that are asked for; under `status` with what the component does now.
fn tell_late(last: &Last, query: &Query, status: &str, shared: &Shared) {
    let is_wanted =
        |key: &str| KeyExpr::try_from(key).is_ok_and(|key| query.key_expr().intersects(&key));
    let last = locked(last);
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
        // Who has gone meanwhile does not miss it.
        let _ = query.reply(key, bytes).encoding(encoding).wait();
    }
}
