//! Recovery from a lost reply: re-attach, repeat windows that the component lost, repeat the request.

use super::Client;
use super::pending::{Effect, PendingRequest};
use crate::Error;
use ballast_protocol::lockstep::{AttachRequest, ErrorCode, RequestKind, RunPosition, WindowKind};
use ballast_protocol::messages::core_ns;

/// Maximum number of times that a call re-attaches.
const MAX_REATTACHES: u32 = 5;

impl Client {
    /// Attaches again after a disconnection and repeats the windows that the component has lost.
    fn reattach(&mut self, effect: Effect) -> Result<(), Error> {
        let ask = AttachRequest {
            client: self.id.clone(),
            run_id: (effect != Effect::StartsRun).then(|| self.position.run_id.clone()),
            ticket: Some(self.ticket.clone()),
        };
        let attached = self.send_attach(&ask)?;
        (self.ticket, self.heartbeats) = (attached.ticket, self.connection.heartbeats());
        let is_sole_owner = attached.owner_count <= self.owner_count;
        self.owner_count = attached.owner_count;
        let ran_freely = std::mem::take(&mut self.is_real_time);
        // A run that is before the start of the real-time mode has lost windows like any other.
        if ran_freely && is_sole_owner && attached.position.seq >= self.position.seq {
            self.continue_at(attached.position);
        } else if effect == Effect::Continues {
            if self.diverged_at.is_none() {
                self.repeat_lost_windows(&attached.position, is_sole_owner)?;
            }
            self.must_reattach = false;
        }
        // DefaultEndpoint it is, until the request has led elsewhere.
        Ok(())
    }

    /// Repeats lost windows from `found`; `is_sole_owner` if no other client was the owner in between.
    fn repeat_lost_windows(
        &mut self,
        found: &RunPosition,
        is_sole_owner: bool,
    ) -> Result<(), Error> {
        if (found.seq, &found.hash) == (self.position.seq, &self.position.hash) {
            return Ok(());
        }
        // The pending request may have been executed; it will be repeated.
        let may_be_done = match &self.pending {
            Some(PendingRequest::Window(_, request)) => found.seq == request.seq,
            Some(PendingRequest::Parameters(_)) => found.seq == self.position.seq,
            None => false,
        };
        if may_be_done && is_sole_owner {
            self.assumed_position = Some(found.clone());
            return Ok(());
        }
        let Some(windows) = self.journal.after(found) else {
            return Err(self.mark_diverged(found.clone()));
        };
        for (request, expected) in windows {
            let reply = self.deliver(WindowKind::Advance, &request)?;
            let hash = reply.hash.to_string();
            // Checked before the next window: a diverged run must not be continued.
            if hash != expected {
                let now_ns = core_ns(reply.t1_ns);
                return Err(self.mark_diverged(RunPosition {
                    seq: reply.seq,
                    now_ns,
                    hash,
                    ..found.clone()
                }));
            }
        }
        Ok(())
    }

    /// Records that the run has diverged to `found`.
    fn mark_diverged(&mut self, found: RunPosition) -> Error {
        let found = describe_position(&found);
        let error = self.diverged(&found);
        (self.diverged_at, self.must_reattach) = (Some(found), false);
        (self.pending, self.assumed_position) = (None, None);
        error
    }

    /// Records that an unanswered request may have replaced the run.
    pub(super) fn set_possibly_diverged(&mut self, verb: RequestKind) {
        let found =
            || format!("`{}` without a reply; the position of the run is unknown", verb.name());
        self.diverged_at.get_or_insert_with(found);
    }

    pub(super) fn ensure_in_sync(&self) -> Result<(), Error> {
        self.diverged_at.as_ref().map_or(Ok(()), |found| Err(self.diverged(found)))
    }

    fn diverged(&self, found: &str) -> Error {
        Error::Diverged {
            component: self.connection.keys().name().into(),
            run_id: self.position.run_id.clone(),
            expected: describe_position(&self.position),
            found: found.into(),
        }
    }

    /// Repeats a pending request that differs from `asked`.
    pub(super) fn resolve_other_pending(&mut self, asked: &PendingRequest) -> Result<(), Error> {
        if self.pending.as_ref().is_some_and(|pending| pending != asked) {
            self.resolve_pending()?;
        }
        Ok(())
    }

    /// Repeats the pending request before another one is sent.
    pub(super) fn resolve_pending(&mut self) -> Result<(), Error> {
        let settled = match self.pending.clone() {
            None => return Ok(()),
            Some(PendingRequest::Window(kind, request)) => self.send(kind, request).map(drop),
            Some(PendingRequest::Parameters(ask)) => self.set_parameters(&ask).map(drop),
        };
        match settled {
            // A refused request has no effect.
            Err(error) if error.request_error().is_some() && self.pending.is_none() => Ok(()),
            settled => settled,
        }
    }

    /// Updates the pending request after an error.
    pub(super) fn resolve_error(&mut self, error: Error) -> Error {
        let Some(fault) = error.request_error() else { return error };
        // The refusal was not that of the request.
        if self.must_reattach {
            return error;
        }
        self.pending = None;
        match self.assumed_position.take() {
            // The position found was not reached by this client.
            Some(found) if fault.code == ErrorCode::OutOfSequence => self.mark_diverged(found),
            _ => error,
        }
    }

    /// Runs an action of the owner, and re-attaches if the component no longer knows this client.
    pub(super) fn with_ownership<T>(
        &mut self,
        effect: Effect,
        mut act: impl FnMut(&Self) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let mut returns = 0;
        loop {
            let reattach = if self.must_reattach { self.reattach(effect) } else { Ok(()) };
            let error = match reattach.and_then(|()| act(self)) {
                Ok(done) => return Ok(done),
                Err(error) => error,
            };
            let is_lost = error.request_error().is_some_and(|f| f.code == ErrorCode::NotOwner);
            if !is_lost {
                return Err(error);
            }
            // Set also before giving up: the request was not refused, and the next call repeats it.
            self.must_reattach = true;
            if returns == MAX_REATTACHES {
                return Err(error);
            }
            returns += 1;
        }
    }

    /// Continues at a position that the journal does not lead to.
    pub(super) fn continue_at(&mut self, position: RunPosition) -> &RunPosition {
        self.position = position;
        self.journal.clear();
        (self.pending, self.assumed_position, self.diverged_at) = (None, None, None);
        self.must_reattach = false;
        &self.position
    }

    /// Continues at a position with the real-time mode stopped.
    pub(super) fn continue_paused_at(&mut self, position: RunPosition) -> &RunPosition {
        self.is_real_time = false;
        self.continue_at(position)
    }
}

fn describe_position(position: &RunPosition) -> String {
    let RunPosition { seq, now_ns, hash, .. } = position;
    format!("window {seq} at {now_ns} ns, state {hash}")
}
