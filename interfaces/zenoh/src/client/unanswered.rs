//! What is done when an answer does not come: the owner comes back, catches up, and asks again.

use super::Client;
use crate::Error;
use ballast_protocol::lockstep::{Attach, Code, Place, SetParameters, Verb, WindowKind};
use ballast_protocol::messages::{AdvanceRequest, core_ns};
use std::sync::Arc;

/// How often a call becomes the owner again before it gives up.
const MOST_RETURNS: u32 = 5;

/// A request that may have had its effect although its answer is lost.
#[derive(Clone, PartialEq)]
pub(super) enum Unanswered {
    Window(WindowKind, Arc<AdvanceRequest>),
    Parameters(SetParameters),
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
        let ask = Attach {
            client: self.id.clone(),
            resume: (leads != Leads::Anew).then(|| self.place.run_id.clone()),
            ticket: Some(self.ticket.clone()),
        };
        let attached = self.ask_to_drive(&ask)?;
        (self.ticket, self.beats) = (attached.ticket, self.line.beats());
        let is_alone = attached.owners <= self.owners;
        self.owners = attached.owners;
        let ran_freely = std::mem::take(&mut self.runs_freely);
        // A run that stands before the place where time was let run has lost windows like any other.
        if ran_freely && is_alone && attached.place.seq >= self.place.seq {
            self.begin_at(attached.place);
        } else if leads == Leads::On {
            if self.apart.is_none() {
                self.catch_up(&attached.place, is_alone)?;
            }
            self.is_behind = false;
        }
        // Otherwise it is, until the request has led elsewhere.
        Ok(())
    }

    /// Goes on from `found`; `is_alone`, unless somebody else has driven since this client did.
    fn catch_up(&mut self, found: &Place, is_alone: bool) -> Result<(), Error> {
        if (found.seq, &found.hash) == (self.place.seq, &self.place.hash) {
            return Ok(());
        }
        // It was done, its answer lost: it will be asked for again.
        let may_be_done = match &self.unanswered {
            Some(Unanswered::Window(_, request)) => found.seq == request.seq,
            Some(Unanswered::Parameters(_)) => found.seq == self.place.seq,
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
                return Err(self.part(Place { seq: reply.seq, now_ns, hash, ..found.clone() }));
            }
        }
        Ok(())
    }

    /// The run has gone on to `found` without this client, which has nothing to go on from any more.
    fn part(&mut self, found: Place) -> Error {
        let found = told(&found);
        let error = self.diverged(&found);
        (self.apart, self.is_behind) = (Some(found), false);
        (self.unanswered, self.guess) = (None, None);
        error
    }

    /// What leads elsewhere was not answered: the run may be there, or may still be led there.
    pub(super) fn may_be_elsewhere(&mut self, verb: Verb) {
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
            run_id: self.place.run_id.clone(),
            expected: told(&self.place),
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
            Some(Unanswered::Parameters(ask)) => self.set_parameters(&ask).map(drop),
        };
        match settled {
            // It was refused: nothing has changed, and that is all that matters now.
            Err(error) if error.fault().is_some() && self.unanswered.is_none() => Ok(()),
            settled => settled,
        }
    }

    /// What becomes of a request that was not answered as it should be.
    pub(super) fn without(&mut self, error: Error) -> Error {
        let Some(fault) = error.fault() else { return error };
        // It was not the request that was refused.
        if self.is_behind {
            return error;
        }
        self.unanswered = None;
        match self.guess.take() {
            // What was found there was not this client's doing.
            Some(found) if fault.code == Code::OutOfSequence => self.part(found),
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
            let is_lost = error.fault().is_some_and(|f| f.code == Code::NotOwner);
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

    /// Goes on at a place that the windows so far do not lead to.
    pub(super) fn begin_at(&mut self, place: Place) -> &Place {
        self.place = place;
        self.journal.clear();
        (self.unanswered, self.guess, self.apart) = (None, None, None);
        self.is_behind = false;
        &self.place
    }

    /// The same where time stands, however it ran before.
    pub(super) fn begin_anew(&mut self, place: Place) -> &Place {
        self.runs_freely = false;
        self.begin_at(place)
    }
}

fn told(place: &Place) -> String {
    let Place { seq, now_ns, hash, .. } = place;
    format!("window {seq} at {now_ns} ns, state {hash}")
}
