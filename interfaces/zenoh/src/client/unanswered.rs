//! What is done when an answer does not come: the owner comes back, catches up, and asks again.

use super::Client;
use crate::Error;
use ballast_protocol::lockstep::{
    AttachRequest, ErrorCode, ParameterUpdate, RequestKind, RunPosition, WindowKind,
};
use ballast_protocol::messages::{AdvanceRequest, core_ns};
use std::sync::Arc;

/// How often a call becomes the owner again before it gives up.
const MOST_RETURNS: u32 = 5;

/// A request that may have had its effect although its answer is lost.
#[derive(Clone, PartialEq)]
pub(super) enum Unanswered {
    Window(WindowKind, Arc<AdvanceRequest>),
    SolverParameters(ParameterUpdate),
}

/// Where a request leads.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Leads {
    /// On from where the run was left.
    On,
    /// To a kept state, wherever the run is now.
    Back,
    /// To a run of its own.
    Anew,
}

impl Client {
    /// Becomes the owner again after the component or the line was away, and brings the component to where it was left.
    fn come_back(&mut self, leads: Leads) -> Result<(), Error> {
        let ask = AttachRequest {
            client: self.id.clone(),
            run_id: (leads != Leads::Anew).then(|| self.position.run_id.clone()),
            ticket: Some(self.ticket.clone()),
        };
        let attached = self.ask_to_drive(&ask)?;
        (self.ticket, self.beats) = (attached.ticket, self.line.beats());
        let is_alone = attached.owner_count <= self.owners;
        self.owners = attached.owner_count;
        let ran_freely = std::mem::take(&mut self.is_real_time);
        // A run that stands before the position where time was let run has lost windows like any other.
        if ran_freely && is_alone && attached.position.seq >= self.position.seq {
            self.begin_at(attached.position);
        } else if leads == Leads::On {
            if self.apart.is_none() {
                self.catch_up(&attached.position, is_alone)?;
            }
            self.is_behind = false;
        }
        // DefaultEndpoint it is, until the request has led elsewhere.
        Ok(())
    }

    /// Goes on from `found`; `is_alone`, unless somebody else has driven since this client did.
    fn catch_up(&mut self, found: &RunPosition, is_alone: bool) -> Result<(), Error> {
        if (found.seq, &found.hash) == (self.position.seq, &self.position.hash) {
            return Ok(());
        }
        // It was done, its answer lost: it will be asked for again.
        let may_be_done = match &self.unanswered {
            Some(Unanswered::Window(_, request)) => found.seq == request.seq,
            Some(Unanswered::SolverParameters(_)) => found.seq == self.position.seq,
            None => false,
        };
        if may_be_done && is_alone {
            self.guess = Some(found.clone());
            return Ok(());
        }
        let Some(windows) = self.journal.after(found) else {
            return Err(self.part(found.clone()));
        };
        for (request, expected) in windows {
            let reply = self.deliver(WindowKind::Advance, &request)?;
            let hash = reply.hash.to_string();
            // Before it goes further: what is elsewhere already must not be led on.
            if hash != expected {
                let now_ns = core_ns(reply.t1_ns);
                return Err(self.part(RunPosition {
                    seq: reply.seq,
                    now_ns,
                    hash,
                    ..found.clone()
                }));
            }
        }
        Ok(())
    }

    /// The run has gone on to `found` without this client, which has nothing to go on from any more.
    fn part(&mut self, found: RunPosition) -> Error {
        let found = told(&found);
        let error = self.diverged(&found);
        (self.apart, self.is_behind) = (Some(found), false);
        (self.unanswered, self.guess) = (None, None);
        error
    }

    /// What leads elsewhere was not answered: the run may be there, or may still be led there.
    pub(super) fn may_be_elsewhere(&mut self, verb: RequestKind) {
        let found =
            || format!("a run that {} may have led elsewhere: it was not answered", verb.word());
        self.apart.get_or_insert_with(found);
    }

    pub(super) fn check_together(&self) -> Result<(), Error> {
        self.apart.as_ref().map_or(Ok(()), |found| Err(self.diverged(found)))
    }

    fn diverged(&self, found: &str) -> Error {
        Error::Diverged {
            component: self.line.keys().name().into(),
            run_id: self.position.run_id.clone(),
            expected: told(&self.position),
            found: found.into(),
        }
    }

    /// Asks again for what was not answered, if something else comes after it.
    pub(super) fn settle_other(&mut self, asked: &Unanswered) -> Result<(), Error> {
        if self.unanswered.as_ref().is_some_and(|unanswered| unanswered != asked) {
            self.settle()?;
        }
        Ok(())
    }

    /// Asks again for what was not answered, for a request that comes after it.
    pub(super) fn settle(&mut self) -> Result<(), Error> {
        let settled = match self.unanswered.clone() {
            None => return Ok(()),
            Some(Unanswered::Window(kind, request)) => self.send(kind, request).map(drop),
            Some(Unanswered::SolverParameters(ask)) => self.set_parameters(&ask).map(drop),
        };
        match settled {
            // It was refused: nothing has changed, and that is all that matters now.
            Err(error) if error.request_error().is_some() && self.unanswered.is_none() => Ok(()),
            settled => settled,
        }
    }

    /// What becomes of a request that was not answered as it should be.
    pub(super) fn without(&mut self, error: Error) -> Error {
        let Some(fault) = error.request_error() else { return error };
        // It was not the request that was refused.
        if self.is_behind {
            return error;
        }
        self.unanswered = None;
        match self.guess.take() {
            // What was found there was not this client's doing.
            Some(found) if fault.code == ErrorCode::OutOfSequence => self.part(found),
            _ => error,
        }
    }

    /// Does what only the owner can, becoming it again if the component has lost sight of this client.
    pub(super) fn returning<T>(
        &mut self,
        leads: Leads,
        mut act: impl FnMut(&Self) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let mut returns = 0;
        loop {
            let come_back = if self.is_behind { self.come_back(leads) } else { Ok(()) };
            let error = match come_back.and_then(|()| act(self)) {
                Ok(done) => return Ok(done),
                Err(error) => error,
            };
            let is_lost = error.request_error().is_some_and(|f| f.code == ErrorCode::NotOwner);
            if !is_lost {
                return Err(error);
            }
            // Also where it is left at that: the request was not refused, and is asked again by the next call.
            self.is_behind = true;
            if returns == MOST_RETURNS {
                return Err(error);
            }
            returns += 1;
        }
    }

    /// Goes on at a position that the windows so far do not lead to.
    pub(super) fn begin_at(&mut self, position: RunPosition) -> &RunPosition {
        self.position = position;
        self.journal.clear();
        (self.unanswered, self.guess, self.apart) = (None, None, None);
        self.is_behind = false;
        &self.position
    }

    /// The same where time stands, however it ran before.
    pub(super) fn begin_anew(&mut self, position: RunPosition) -> &RunPosition {
        self.is_real_time = false;
        self.begin_at(position)
    }
}

fn told(position: &RunPosition) -> String {
    let RunPosition { seq, now_ns, hash, .. } = position;
    format!("window {seq} at {now_ns} ns, state {hash}")
}
