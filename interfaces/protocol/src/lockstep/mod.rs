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
mod cost;
mod fault;
mod owner;
mod state;
mod verb;
mod window;

pub use control::{
    AttachReply, AttachRequest, ComponentState, InitRequest, ParameterUpdate, RunPosition,
    StateName, StatusReport, WindowProgress,
};
pub use cost::{WallClock, WindowTiming};
pub use fault::{ErrorCode, ErrorDetails, RequestError, panic_message};
pub use owner::Ownership;
use state::SavedStates;
pub use state::{SavedState, empty_model};
pub use verb::RequestKind;
pub use window::{WindowControl, WindowKind, WindowPoll};

use crate::messages::{AdvanceReply, Digest, StateHash};
use ballast::component::Component;
use ballast::model::Model;
use ballast::state::State;

/// Most states kept under a name.
pub const MAX_SAVED_STATES: usize = 64;
/// Longest name of a client or a state, bytes.
pub const MAX_NAME_BYTES: usize = 200;

/// What is kept beside the state in a checkpoint: with it a retry of the last window is safe, and nobody takes what
/// another one has driven for its own.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ResumeInfo {
    /// What the last window was answered, under the digest of its request.
    pub answered: Option<(Digest, AdvanceReply)>,
    /// Other parameters were set since.
    pub is_outdated: bool,
    /// The client that has driven last, and how many have one after another.
    pub last_client: String,
    pub owners: u64,
}

/// A component with an owner.
pub struct Lockstep {
    component: Component,
    run_id: String,
    /// Where reset goes.
    start: SavedState,
    hash: fn(&Model, &State) -> u128,
    /// Of the present state: taken when it changes, since a state is large and asked about often.
    hash_now: StateHash,
    seq: u64,
    /// Content of the last window's request, and its reply.
    answered: Option<(Digest, AdvanceReply)>,
    /// Other parameters were set since.
    is_outdated: bool,
    kept: SavedStates,
    owner: Ownership,
    /// What failed inside.
    failure: Option<String>,
    /// Whether there is anything to step.
    is_configured: bool,
    is_quitting: bool,
    durable_seq: u64,
    computed_windows: u64,
    /// Of the last window.
    cost: Option<WindowTiming>,
    /// Since when nothing was asked, wall ms.
    idle_since_ms: u64,
}

impl Lockstep {
    /// A run that begins where `component` is; `hash` fingerprints states.
    pub fn new(
        component: Component,
        run_id: impl Into<String>,
        hash: fn(&Model, &State) -> u128,
    ) -> Self {
        let start = SavedState::of(&component);
        let hash_now = hash(component.model(), component.state()).into();
        Self {
            component,
            run_id: run_id.into(),
            start,
            hash,
            hash_now,
            seq: 0,
            answered: None,
            is_outdated: false,
            kept: SavedStates::default(),
            owner: Ownership::default(),
            failure: None,
            is_configured: true,
            is_quitting: false,
            durable_seq: 0,
            computed_windows: 0,
            cost: None,
            idle_since_ms: 0,
        }
    }

    /// Takes up a run of which a checkpoint was kept after window `seq`, with its `memory`; reset still goes to where the
    /// component was.
    ///
    /// # Errors
    /// A state of another model, parameters that cannot be used.
    pub fn resume(
        &mut self,
        run_id: impl Into<String>,
        seq: u64,
        kept: SavedState,
        memory: ResumeInfo,
    ) -> Result<(), RequestError> {
        kept.take_up(&mut self.component)?;
        (self.run_id, self.seq, self.durable_seq) = (run_id.into(), seq, seq);
        self.hash_again();
        let ResumeInfo { answered, is_outdated, last_client, owners } = memory;
        (self.answered, self.is_outdated) = (answered, is_outdated);
        self.owner.remember(last_client, owners);
        Ok(())
    }

    /// Fingerprint of the present state.
    pub fn hash_now(&self) -> StateHash {
        self.hash_now
    }

    /// What is kept beside the state in a checkpoint.
    pub fn memory(&self) -> ResumeInfo {
        let (last_client, owners) = self.owner.history();
        ResumeInfo {
            answered: self.answered.clone(),
            is_outdated: self.is_outdated,
            last_client: last_client.into(),
            owners,
        }
    }

    pub fn component(&self) -> &Component {
        &self.component
    }

    /// Where the run stands.
    pub fn position(&self) -> RunPosition {
        RunPosition {
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
        let state = match (&self.failure, self.is_quitting) {
            (_, true) => ComponentState::ShuttingDown,
            _ if !self.is_configured => ComponentState::Unconfigured,
            (Some(_), false) => ComponentState::Error,
            (None, false) => ComponentState::Idle,
        };
        let waiting = match (self.owner.client(), &self.failure) {
            (None, _) => "an owner to attach".to_string(),
            (Some(client), _) if !self.is_configured => format!("init from {client}"),
            (Some(client), None) => format!("window {} from {client}", self.seq + 1),
            (Some(client), Some(_)) => format!("restore or reset from {client}"),
        };
        StatusReport {
            state,
            position: self.position(),
            owner: self.owner.client().map(str::to_string),
            owner_since_ms: self.owner.since_ms(now_ms),
            waiting_for: Some(waiting),
            waiting_since_ms: Some(now_ms.saturating_sub(self.idle_since_ms)),
            progress: None,
            real_time: None,
            error: self.failure.clone(),
            last_window: self.cost.clone(),
            durable_seq: self.durable_seq,
            uptime_ms: now_ms,
        }
    }

    /// How many windows were computed; a retry that is answered from memory does not count.
    pub fn computed_windows(&self) -> u64 {
        self.computed_windows
    }

    /// Notes that a checkpoint of the present state is kept.
    pub fn note_durable(&mut self) {
        self.durable_seq = self.seq;
    }

    /// The last window that survives a crash.
    pub fn durable_seq(&self) -> u64 {
        self.durable_seq
    }

    /// The last window leads elsewhere now than where a checkpoint may have it.
    fn lose_durable(&mut self) {
        self.durable_seq = self.durable_seq.min(self.seq.saturating_sub(1));
    }

    /// Makes the caller the owner; `ticket` is fresh and hard to guess.
    ///
    /// # Errors
    /// [`ErrorCode::Busy`] while another one drives, [`ErrorCode::WrongRun`], [`ErrorCode::ShuttingDown`].
    pub fn attach(
        &mut self,
        ask: &AttachRequest,
        ticket: String,
        now_ms: u64,
    ) -> Result<AttachReply, RequestError> {
        self.check_not_quitting()?;
        check_name("client", &ask.client)?;
        if let Some(resume) = &ask.run_id
            && *resume != self.run_id
        {
            return Err(self.wrong_run(resume));
        }
        let owner_count = self.owner.take(ask, &ticket, now_ms)?;
        self.idle_since_ms = now_ms;
        Ok(AttachReply { ticket, owner_count, position: self.position() })
    }

    /// The owner leaves; the run stays where it is.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`].
    pub fn detach(&mut self, ticket: &str) -> Result<RunPosition, RequestError> {
        self.owner.check(ticket)?;
        self.owner.leave();
        Ok(self.position())
    }

    /// The transport has lost a client; whether it was the owner.
    pub fn lost(&mut self, client: &str) -> bool {
        self.owner.lose(client)
    }

    /// Nothing more is computed.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`].
    pub fn shut_down(&mut self, ticket: &str) -> Result<RunPosition, RequestError> {
        self.check_owner(ticket)?;
        self.quit();
        Ok(self.position())
    }

    /// The same, at the wish of who runs the component.
    pub fn quit(&mut self) {
        self.is_quitting = true;
    }

    /// Whether there is anything to step yet.
    pub fn is_configured(&self) -> bool {
        self.is_configured
    }

    /// Who drives.
    pub fn owner(&self) -> &Ownership {
        &self.owner
    }

    fn check_owner(&self, ticket: &str) -> Result<(), RequestError> {
        self.owner.check(ticket)
    }

    fn check_not_quitting(&self) -> Result<(), RequestError> {
        if self.is_quitting {
            return Err(RequestError::new(
                ErrorCode::ShuttingDown,
                "the component is being shut down",
            ));
        }
        Ok(())
    }

    /// Refuses what only the owner may do, with a sound component.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`], [`ErrorCode::ShuttingDown`], [`ErrorCode::Unconfigured`], [`ErrorCode::ErrorState`].
    pub fn check_ready(&self, ticket: &str) -> Result<(), RequestError> {
        self.check_owner(ticket)?;
        self.check_sound()
    }

    fn check_configured(&self) -> Result<(), RequestError> {
        self.check_not_quitting()?;
        if self.is_configured {
            return Ok(());
        }
        let message = "the bed has not been prepared yet; ask for `init`";
        Err(RequestError::new(ErrorCode::Unconfigured, message))
    }

    fn check_sound(&self) -> Result<(), RequestError> {
        self.check_configured()?;
        match &self.failure {
            None => Ok(()),
            Some(failure) => {
                let message = format!("{failure}; restore, reset and detach are possible");
                Err(RequestError::new(ErrorCode::ErrorState, message))
            }
        }
    }

    fn wrong_run(&self, found: &str) -> RequestError {
        let found: String = found.chars().take(50).collect();
        RequestError::expected(
            ErrorCode::WrongRun,
            "run_id",
            format!("{:?}", self.run_id),
            format!("{found:?}"),
        )
    }
}

fn check_name(place: &str, name: &str) -> Result<(), RequestError> {
    let fits = !name.is_empty()
        && name.len() <= MAX_NAME_BYTES
        && name.bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.".contains(&b));
    if fits {
        return Ok(());
    }
    let expected = format!("1 to {MAX_NAME_BYTES} letters, digits, '-', '_' or '.'");
    let found: String = name.chars().take(50).collect();
    Err(RequestError::expected(ErrorCode::MessageError, place, expected, format!("{found:?}")))
}
