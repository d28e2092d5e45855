//! Lockstep: one owner, windows in sequence, every request answered once and its answer kept.
//!
//! Reads: requests, the wall clock as given. Writes: a component. No transport: whoever carries the messages
//! calls these functions one after the other.
//!
//! Contract:
//! * Only the owner's ticket changes the state.
//! * `advance` with the next number at the present time computes. The last number with the same content gives
//!   the kept reply again, so a retry is always safe. Anything else is refused and tells the number.
//! * `redo` with the last number computes the window again from its beginning.
//! * What was refused, and what was discarded, leaves the state to the bit.
//! * A panic inside does not get out: the component is then in error until it is restored or reset.

mod control;
mod fault;
mod window;

pub use control::{Activity, Attach, Attached, Named, Place, Progress, StatusReport};
pub use fault::{Code, Fault};
pub use window::{Kind, Pace, Watch};

use crate::messages::{AdvanceReply, Digest, StateHash};
use ballast::component::Component;
use ballast::model::Model;
use ballast::state::State;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Most states kept under a name.
pub const MOST_STATES: usize = 64;
/// Longest name of a client or a state, bytes.
pub const LONGEST_NAME: usize = 200;

/// A component with an owner.
pub struct Lockstep {
    component: Component,
    run_id: String,
    /// Where reset goes.
    start: Arc<State>,
    hash: fn(&Model, &State) -> u128,
    /// Of the present state: taken when it changes, since a state is large and asked about often.
    hash_now: StateHash,
    seq: u64,
    /// Content of the last window's request, and its reply.
    answered: Option<(Digest, AdvanceReply)>,
    kept: BTreeMap<String, Arc<State>>,
    owner: Option<Owner>,
    /// What failed inside.
    trouble: Option<String>,
    is_quitting: bool,
    durable_seq: u64,
    answered_count: u64,
    /// Since when nothing was asked, wall ms.
    idle_since_ms: u64,
}

struct Owner {
    client: String,
    ticket: String,
    since_ms: u64,
}

impl Lockstep {
    /// A run that begins where `component` is; `hash` fingerprints states.
    pub fn new(
        component: Component,
        run_id: impl Into<String>,
        hash: fn(&Model, &State) -> u128,
    ) -> Self {
        let start = component.save();
        let hash_now = hash(component.model(), &start).into();
        Self {
            component,
            run_id: run_id.into(),
            start,
            hash,
            hash_now,
            seq: 0,
            answered: None,
            kept: BTreeMap::new(),
            owner: None,
            trouble: None,
            is_quitting: false,
            durable_seq: 0,
            answered_count: 0,
            idle_since_ms: 0,
        }
    }

    /// Takes up a run of which a checkpoint was kept after window `seq`, with what that window was
    /// answered, so that a retry of it is still safe; reset still goes to where the component was.
    ///
    /// # Errors
    /// A state of another model.
    pub fn resume(
        &mut self,
        run_id: impl Into<String>,
        seq: u64,
        state: impl Into<Arc<State>>,
        answered: Option<(Digest, AdvanceReply)>,
    ) -> Result<(), Fault> {
        self.component.restore(state)?;
        (self.run_id, self.seq, self.durable_seq) = (run_id.into(), seq, seq);
        self.answered = answered;
        self.hash_again();
        Ok(())
    }

    /// What the last window was answered, under the digest of its request: kept beside a checkpoint.
    pub fn answered(&self) -> Option<&(Digest, AdvanceReply)> {
        self.answered.as_ref()
    }

    pub fn component(&self) -> &Component {
        &self.component
    }

    /// Where the run stands.
    pub fn place(&self) -> Place {
        Place {
            run_id: self.run_id.clone(),
            seq: self.seq,
            now_ns: self.component.now_ns(),
            hash: self.hash_now.to_string(),
        }
    }

    fn hash_again(&mut self) {
        self.hash_now = (self.hash)(self.component.model(), self.component.state()).into();
    }

    /// What it is doing between windows.
    pub fn status(&self, now_ms: u64) -> StatusReport {
        let activity = match (&self.trouble, self.is_quitting) {
            (_, true) => Activity::Quitting,
            (Some(_), false) => Activity::Error,
            (None, false) => Activity::Paused,
        };
        let waiting = match (&self.owner, &self.trouble) {
            (None, _) => "an owner to attach".to_string(),
            (Some(o), None) => format!("window {} from {}", self.seq + 1, o.client),
            (Some(o), Some(_)) => format!("restore or reset from {}", o.client),
        };
        StatusReport {
            activity,
            place: self.place(),
            owner: self.owner.as_ref().map(|o| o.client.clone()),
            owner_since_ms: self.owner.as_ref().map(|o| now_ms.saturating_sub(o.since_ms)),
            waiting_for: Some(waiting),
            waiting_since_ms: Some(now_ms.saturating_sub(self.idle_since_ms)),
            progress: None,
            trouble: self.trouble.clone(),
            durable_seq: self.durable_seq,
            uptime_ms: now_ms,
        }
    }

    /// How many windows were computed; a retry that is answered from memory does not count.
    pub fn answered_count(&self) -> u64 {
        self.answered_count
    }

    /// Notes that a checkpoint of the present state is kept.
    pub fn is_durable(&mut self) {
        self.durable_seq = self.seq;
    }

    /// Makes the caller the owner; `ticket` is fresh and hard to guess.
    ///
    /// # Errors
    /// [`Code::Busy`] while another one drives, [`Code::WrongRun`], [`Code::Quitting`].
    pub fn attach(&mut self, ask: &Attach, ticket: String, now_ms: u64) -> Result<Attached, Fault> {
        self.check_not_quitting()?;
        check_name("client", &ask.client)?;
        if let Some(resume) = &ask.resume
            && *resume != self.run_id
        {
            return Err(self.wrong_run(resume));
        }
        if let Some(owner) = &self.owner
            && ask.ticket.as_ref() != Some(&owner.ticket)
        {
            let since = now_ms.saturating_sub(owner.since_ms);
            let message = format!("{:?} drives, for {:.1} s", owner.client, since as f64 * 1e-3);
            let fault = Fault::new(Code::Busy, message);
            return Err(Fault {
                owner: Some(owner.client.clone()),
                since_ms: Some(since),
                ..fault
            });
        }
        let client = ask.client.clone();
        self.owner = Some(Owner { client, ticket: ticket.clone(), since_ms: now_ms });
        self.idle_since_ms = now_ms;
        Ok(Attached { ticket, place: self.place() })
    }

    /// The owner leaves; the run stays where it is.
    ///
    /// # Errors
    /// [`Code::NotOwner`].
    pub fn detach(&mut self, ticket: &str) -> Result<Place, Fault> {
        self.check_owner(ticket)?;
        self.owner = None;
        Ok(self.place())
    }

    /// The transport has lost a client; whether it was the owner.
    pub fn lost(&mut self, client: &str) -> bool {
        let was = self.owner.as_ref().is_some_and(|o| o.client == client);
        if was {
            self.owner = None;
        }
        was
    }

    /// Back to the beginning, as a run of its own.
    ///
    /// # Errors
    /// [`Code::NotOwner`], [`Code::Quitting`].
    pub fn reset(&mut self, run_id: String, ticket: &str, now_ms: u64) -> Result<Place, Fault> {
        self.check_owner(ticket)?;
        self.check_not_quitting()?;
        self.put(Arc::clone(&self.start))?;
        (self.run_id, self.seq, self.durable_seq) = (run_id, 0, 0);
        self.kept.clear();
        self.idle_since_ms = now_ms;
        Ok(self.place())
    }

    /// Keeps the state under a name; an older one of this name is replaced.
    ///
    /// # Errors
    /// [`Code::NotOwner`], [`Code::InError`], [`Code::Malformed`] for a name that cannot be one,
    /// [`Code::TooManyStates`].
    pub fn save(&mut self, ask: &Named, ticket: &str) -> Result<Place, Fault> {
        self.check_ready(ticket)?;
        check_name("name", &ask.name)?;
        if self.kept.len() >= MOST_STATES && !self.kept.contains_key(&ask.name) {
            let found = format!("{} and {:?}", self.kept.len(), ask.name);
            let expected = format!("at most {MOST_STATES}");
            return Err(Fault::expected(Code::TooManyStates, "kept states", expected, found));
        }
        self.kept.insert(ask.name.clone(), self.component.save());
        Ok(self.place())
    }

    /// Takes up a kept state; windows go on counting.
    ///
    /// # Errors
    /// [`Code::NotOwner`], [`Code::UnknownState`], [`Code::Quitting`].
    pub fn restore(&mut self, ask: &Named, ticket: &str) -> Result<Place, Fault> {
        self.check_owner(ticket)?;
        self.check_not_quitting()?;
        let state = self.kept.get(&ask.name).cloned().ok_or_else(|| self.unknown(&ask.name))?;
        self.put(state)?;
        Ok(self.place())
    }

    /// Forgets a kept state.
    ///
    /// # Errors
    /// [`Code::NotOwner`], [`Code::UnknownState`].
    pub fn drop_state(&mut self, ask: &Named, ticket: &str) -> Result<Place, Fault> {
        self.check_owner(ticket)?;
        self.kept.remove(&ask.name).ok_or_else(|| self.unknown(&ask.name))?;
        Ok(self.place())
    }

    /// Nothing more is computed.
    ///
    /// # Errors
    /// [`Code::NotOwner`].
    pub fn shut_down(&mut self, ticket: &str) -> Result<Place, Fault> {
        self.check_owner(ticket)?;
        self.quit();
        Ok(self.place())
    }

    /// The same, at the wish of who runs the component.
    pub fn quit(&mut self) {
        self.is_quitting = true;
    }

    /// The client that drives, and its ticket, which is for no one else to see.
    pub fn owner(&self) -> Option<(&str, &str)> {
        self.owner.as_ref().map(|o| (&o.client[..], &o.ticket[..]))
    }

    /// Takes up a state, out of any trouble; the last window cannot be redone or asked for again.
    fn put(&mut self, state: Arc<State>) -> Result<(), Fault> {
        match self.trouble.take() {
            None => self.component.restore(state)?,
            Some(_) => self.component.recover(state)?,
        }
        self.answered = None;
        self.hash_again();
        Ok(())
    }

    fn check_owner(&self, ticket: &str) -> Result<(), Fault> {
        match &self.owner {
            Some(owner) if owner.ticket == ticket => Ok(()),
            Some(owner) => {
                let message = format!("ticket: expected that of the owner, {:?}", owner.client);
                let name = Some(owner.client.clone());
                Err(Fault { owner: name, ..Fault::new(Code::NotOwner, message) })
            }
            None => Err(Fault::new(Code::NotOwner, "ticket: expected an owner; attach first")),
        }
    }

    fn check_not_quitting(&self) -> Result<(), Fault> {
        if self.is_quitting {
            return Err(Fault::new(Code::Quitting, "the component is being shut down"));
        }
        Ok(())
    }

    fn check_ready(&self, ticket: &str) -> Result<(), Fault> {
        self.check_owner(ticket)?;
        self.check_sound()
    }

    fn check_sound(&self) -> Result<(), Fault> {
        self.check_not_quitting()?;
        match &self.trouble {
            None => Ok(()),
            Some(trouble) => {
                let message = format!("{trouble}; restore, reset and detach are possible");
                Err(Fault::new(Code::InError, message))
            }
        }
    }

    fn wrong_run(&self, found: &str) -> Fault {
        let found: String = found.chars().take(50).collect();
        Fault::expected(
            Code::WrongRun,
            "run_id",
            format!("{:?}", self.run_id),
            format!("{found:?}"),
        )
    }

    fn unknown(&self, name: &str) -> Fault {
        let known: Vec<_> = self.kept.keys().collect();
        let found: String = name.chars().take(50).collect();
        Fault::expected(
            Code::UnknownState,
            "name",
            format!("one of {known:?}"),
            format!("{found:?}"),
        )
    }
}

fn check_name(place: &str, name: &str) -> Result<(), Fault> {
    let fits = !name.is_empty()
        && name.len() <= LONGEST_NAME
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b));
    if fits {
        return Ok(());
    }
    let expected = format!("1 to {LONGEST_NAME} letters, digits, '-', '_' or '.'");
    let found: String = name.chars().take(50).collect();
    Err(Fault::expected(Code::Malformed, place, expected, format!("{found:?}")))
}
