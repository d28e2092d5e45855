//! Samples of motion that come in while time runs by itself.
//!
//! Contract: runs on threads of the transport and never waits. Only what the owner's ticket goes with is decoded;
//! what waits is bounded.

use super::gate::Call;
use super::shared::Shared;
use crate::wire::is_cdr;
use crate::{Error, Keys, locked};
use ballast_protocol::messages::MotionKnot;
use ballast_protocol::{from_cdr, from_json};
use std::collections::VecDeque;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex};
use zenoh::bytes::ZBytes;
use zenoh::sample::Sample;
use zenoh::{Session, Wait};

/// Most samples that wait for the computing thread, and most bytes of one.
const MOST: usize = 4096;
const LARGEST: usize = 4096;

/// A sample: the part of its key that stands for the body, the motion, and when it came, wall ns.
pub(super) type Heard = (String, MotionKnot, u64);

/// Samples that wait, and how many of the owner's could not be read or kept.
#[derive(Clone, Default)]
pub(super) struct Inputs {
    waiting: Arc<Mutex<(VecDeque<Heard>, u64)>>,
}

impl Inputs {
    /// Declares the keys of all bodies; `wake` is told when there is something again.
    pub fn declare(
        session: &Session,
        keys: &Keys,
        shared: &Arc<Shared>,
        wake: Sender<Call>,
    ) -> Result<Self, Error> {
        let inputs = Self::default();
        let (to, at) = (inputs.clone(), Arc::clone(shared));
        let samples = session.declare_subscriber(keys.input_any());
        let samples = samples.callback(move |sample: Sample| to.hear(&at, &sample, &wake));
        samples.background().wait().map_err(|e| Error::link("zenoh", e))?;
        Ok(inputs)
    }

    fn hear(&self, shared: &Shared, sample: &Sample, wake: &Sender<Call>) {
        let ticket = sample.attachment().filter(|a| a.len() <= LARGEST).map(ZBytes::to_bytes);
        let ticket = ticket.as_deref().and_then(|t| std::str::from_utf8(t).ok()).unwrap_or("");
        if shared.check_owner(ticket).is_err() {
            return;
        }
        let read = read(sample);
        let mut waiting = locked(&self.waiting);
        let (waiting, unread) = &mut *waiting;
        let Some((body, knot)) = read.filter(|_| waiting.len() < MOST) else {
            *unread += 1;
            return;
        };
        waiting.push_back((body, knot, shared.now_ns()));
        if waiting.len() == 1 {
            // Fails when nothing is computed any more.
            let _ = wake.send(Call::Input);
        }
    }

    /// What has come since it was last asked, and how many more that were of no use.
    pub fn take(&self) -> (VecDeque<Heard>, u64) {
        std::mem::take(&mut *locked(&self.waiting))
    }
}

/// Body and motion of a sample, if it is one.
fn read(sample: &Sample) -> Option<(String, MotionKnot)> {
    if sample.payload().len() > LARGEST {
        return None;
    }
    let bytes = sample.payload().to_bytes();
    let is_cdr = is_cdr(sample.encoding());
    let knot =
        if is_cdr { from_cdr::<MotionKnot>(&bytes) } else { from_json::<MotionKnot>(&bytes) };
    let body = sample.key_expr().as_str().rsplit('/').nth(1)?;
    Some((body.into(), knot.ok()?))
}
