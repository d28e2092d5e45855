//! Journal of the windows that a crash of the component would lose, so that the client can repeat them.

use ballast_protocol::lockstep::RunPosition;
use ballast_protocol::messages::{
    AdvanceReply, AdvanceRequest, DeadlinePolicy, ReplyStatus, StateHash,
};
use std::collections::VecDeque;
use std::sync::Arc;

/// Maximum number of windows in the journal.
const MAX_WINDOWS: usize = 100_000;
/// Maximum number of knots of all windows in the journal.
const MAX_KNOTS: usize = 1_000_000;

/// Window with its reply.
pub(super) struct JournalEntry {
    /// Request that leads to the same state again.
    pub request: Arc<AdvanceRequest>,
    /// State hashes before and after.
    pub hashes: [String; 2],
}

/// Returns the request that repeats a window: up to its actual end and without a deadline.
///
/// A rolled-back window becomes an empty one that only takes its number.
fn repeatable(mut request: Arc<AdvanceRequest>, reply: &AdvanceReply) -> Arc<AdvanceRequest> {
    if request.deadline_ms == 0 && matches!(reply.status, ReplyStatus::Ok | ReplyStatus::Warn) {
        return request;
    }
    let again = Arc::make_mut(&mut request);
    again.deadline_ms = 0;
    match reply.status {
        ReplyStatus::Ok | ReplyStatus::Warn => {}
        ReplyStatus::Early => again.t1_ns = reply.t1_ns,
        ReplyStatus::Discard | ReplyStatus::Error | ReplyStatus::Fatal => {
            again.t1_ns = again.t0_ns;
            again.motions.clear();
            again.loads.clear();
            again.deadline_policy = DeadlinePolicy::Discard;
        }
    }
    request
}

/// Journal of windows that no checkpoint contains.
#[derive(Default)]
pub(super) struct Journal {
    entries: VecDeque<JournalEntry>,
    knots: usize,
}

impl Journal {
    /// Records a window that led from `before` to the state of `reply`; a redo replaces the window.
    pub fn record(
        &mut self,
        request: Arc<AdvanceRequest>,
        before: &RunPosition,
        reply: &AdvanceReply,
    ) {
        let hash = |hash: &StateHash| hash.to_string();
        let request = repeatable(request, reply);
        if self.entries.back().is_some_and(|last| last.request.seq == request.seq) {
            if let Some(redone) = self.entries.pop_back() {
                self.knots -= knots(&redone.request);
                self.push(request, [redone.hashes[0].clone(), hash(&reply.hash)]);
            }
        } else if before.seq + 1 == request.seq {
            self.push(request, [before.hash.clone(), hash(&reply.hash)]);
        } else {
            // A redo of a window that is not in the journal.
            self.clear();
        }
    }

    fn push(&mut self, request: Arc<AdvanceRequest>, hashes: [String; 2]) {
        self.knots += knots(&request);
        self.entries.push_back(JournalEntry { request, hashes });
        while self.entries.len() > MAX_WINDOWS || self.knots > MAX_KNOTS {
            self.drop_first();
        }
    }

    fn drop_first(&mut self) {
        if let Some(first) = self.entries.pop_front() {
            self.knots -= knots(&first.request);
        }
    }

    /// Removes windows that survive a crash.
    pub fn discard_through(&mut self, durable_seq: u64) {
        // The last one stays: it may be redone.
        while self.entries.len() > 1 && self.entries[0].request.seq <= durable_seq {
            self.drop_first();
        }
    }

    pub fn clear(&mut self) {
        self.entries.clear();
        self.knots = 0;
    }

    /// Returns the windows after `position` with their final hashes, if the journal has all of them.
    pub fn after(&self, position: &RunPosition) -> Option<Vec<(Arc<AdvanceRequest>, String)>> {
        let first = self.entries.iter().position(|e| e.request.seq == position.seq + 1)?;
        let again = |e: &JournalEntry| (Arc::clone(&e.request), e.hashes[1].clone());
        (self.entries[first].hashes[0] == position.hash)
            .then(|| self.entries.iter().skip(first).map(again).collect())
    }
}

fn knots(request: &AdvanceRequest) -> usize {
    let motions = request.motions.iter().map(|m| m.knots.len());
    motions.chain(request.loads.iter().map(|l| l.knots.len())).sum::<usize>() + 1
}
