//! What everyone is told after a window.

use super::Server;
use super::requests::CDR;
use crate::{Error, Keys};
use ballast::model::Model;
use ballast_protocol::messages::{
    AdvanceReply, Clock, Message, PoseStamped, TwistStamped, WrenchImpulse, WrenchStamped,
};
use ballast_protocol::to_cdr;
use std::collections::BTreeMap;
use zenoh::bytes::Encoding;
use zenoh::pubsub::Publisher;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait};

/// Publishers by key, declared once.
pub(super) struct Outlets {
    session: Session,
    keys: Keys,
    by_key: BTreeMap<String, Publisher<'static>>,
}

impl Outlets {
    pub fn declare(session: &Session, keys: &Keys, model: &Model) -> Result<Self, Error> {
        let mut outlets =
            Self { session: session.clone(), keys: keys.clone(), by_key: BTreeMap::new() };
        for body in &model.driven {
            for what in ["pose", "twist", "wrench", "impulse"] {
                outlets.open(keys.out_body(&body.name, what))?;
            }
        }
        for what in ["clock", "solver", "hash"] {
            outlets.open(keys.out(what))?;
        }
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
        // Whoever listens is told; nobody has to.
        if let (Some(publisher), Ok(bytes)) = (self.by_key.get(&key), to_cdr(message)) {
            let encoding = Encoding::from(format!("{CDR};{}", T::NAME));
            let _ = publisher.put(bytes).encoding(encoding).wait();
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
}

impl Server {
    /// Tells everyone what a window has done.
    pub(super) fn tell(&mut self, reply: &AdvanceReply) {
        let outlets = &mut self.outlets;
        for body in &reply.bodies {
            outlets.body(body);
        }
        for zone in &reply.zones {
            outlets.put(outlets.keys.out_zone(&zone.zone), zone);
        }
        outlets.put(outlets.keys.out("solver"), &reply.solver);
        outlets.put(outlets.keys.out("hash"), &reply.hash);
        let now = u64::try_from(reply.t1_ns).unwrap_or(0);
        let clock = Clock { clock: ballast_protocol::messages::Time::from_ns(now) };
        outlets.put(outlets.keys.out("clock"), &clock);
    }
}
