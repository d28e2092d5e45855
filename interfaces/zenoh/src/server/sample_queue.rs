//! Queue of motion samples for the real-time mode.
//!
//! Contract: runs on the transport's threads and never waits. Only samples with the owner's ticket are decoded, and
//! the queue is bounded.

use super::request::ServerEvent;
use super::status::SharedStatus;
use crate::wire::is_cdr;
use crate::{Error, Keys, lock_unpoisoned};
use ballast_protocol::messages::MotionKnot;
use ballast_protocol::{from_cdr, from_json};
use std::collections::VecDeque;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex};
use zenoh::bytes::ZBytes;
use zenoh::sample::Sample;
use zenoh::{Session, Wait};

/// Maximum number of queued samples.
const MAX_SAMPLES: usize = 4096;
/// Maximum size of a sample or a ticket, bytes.
const MAX_SAMPLE_BYTES: usize = 4096;

/// Received sample: the key segment of its body, the motion, and the wall time of its arrival, ns.
pub(super) type ReceivedSample = (String, MotionKnot, u64);

/// Queued samples, and the number of samples that could not be decoded or queued.
#[derive(Clone, Default)]
pub(super) struct SampleQueue {
    waiting: Arc<Mutex<(VecDeque<ReceivedSample>, u64)>>,
}

impl SampleQueue {
    /// Subscribes to the samples of all bodies; `wake` receives an event when the queue is no longer empty.
    pub fn declare(
        session: &Session,
        keys: &Keys,
        shared: &Arc<SharedStatus>,
        wake: Sender<ServerEvent>,
    ) -> Result<Self, Error> {
        let inputs = Self::default();
        let (to, at) = (inputs.clone(), Arc::clone(shared));
        let samples = session.declare_subscriber(keys.input_any());
        let samples = samples.callback(move |sample: Sample| to.receive(&at, &sample, &wake));
        samples.background().wait().map_err(|e| Error::transport("zenoh", e))?;
        Ok(inputs)
    }

    fn receive(&self, shared: &SharedStatus, sample: &Sample, wake: &Sender<ServerEvent>) {
        let ticket =
            sample.attachment().filter(|a| a.len() <= MAX_SAMPLE_BYTES).map(ZBytes::to_bytes);
        let ticket = ticket.as_deref().and_then(|t| std::str::from_utf8(t).ok()).unwrap_or("");
        if shared.check_owner(ticket).is_err() {
            return;
        }
        let read = read(sample);
        let mut waiting = lock_unpoisoned(&self.waiting);
        let (waiting, unread) = &mut *waiting;
        let Some((body, knot)) = read.filter(|_| waiting.len() < MAX_SAMPLES) else {
            *unread += 1;
            return;
        };
        waiting.push_back((body, knot, shared.now_ns()));
        if waiting.len() == 1 {
            // Fails when the component is shutting down.
            let _ = wake.send(ServerEvent::Samples);
        }
    }

    /// Takes all queued samples and the number of dropped ones.
    pub fn take(&self) -> (VecDeque<ReceivedSample>, u64) {
        std::mem::take(&mut *lock_unpoisoned(&self.waiting))
    }
}

/// Decodes the body and motion of a sample.
fn read(sample: &Sample) -> Option<(String, MotionKnot)> {
    if sample.payload().len() > MAX_SAMPLE_BYTES {
        return None;
    }
    let bytes = sample.payload().to_bytes();
    let is_cdr = is_cdr(sample.encoding());
    let knot =
        if is_cdr { from_cdr::<MotionKnot>(&bytes) } else { from_json::<MotionKnot>(&bytes) };
    let body = sample.key_expr().as_str().rsplit('/').nth(1)?;
    Some((body.into(), knot.ok()?))
}
