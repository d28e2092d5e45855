//! Lockstep coupling: one owner, windows in sequence, every request answered exactly once.
//!
//! Reads: requests, the wall clock. Writes: a component. No transport: the caller passes requests one after another.
//!
//! Contract:
//! * Only requests with the owner's ticket change the state.
//! * `advance` with the next number and the current time computes a window. The last number with the same content
//!   returns the stored reply, so a retry is always safe. Any other number is refused with the expected one.
//! * `redo` with the last number computes the window again from its beginning.
//! * A refused request and a discarded window leave the state bitwise unchanged.
//! * A panic is caught: the component is then in the error state until `restore` or `reset`.

mod control;
mod error;
mod owner;
mod request_kind;
mod run_control;
mod saved_states;
mod timing;
mod window;

pub use control::{
    AttachReply, AttachRequest, ComponentState, InitRequest, ParameterUpdate, RunPosition,
    StateName, StatusReport, WindowProgress,
};
use error::check_name;
pub use error::{ErrorCode, ErrorDetails, MAX_NAME_BYTES, RequestError, panic_message};
pub use owner::Ownership;
pub use request_kind::{RequestKind, WindowKind};
pub use run_control::empty_model;
use saved_states::SavedStates;
pub use saved_states::{MAX_SAVED_STATES, SavedState};
pub use timing::{WallClock, WindowTiming};
pub use window::WindowPoll;

use crate::messages::{AdvanceReply, Digest, StateHash};
use ballast::component::Component;
use ballast::model::Model;
use ballast::state::State;

/// Data of a checkpoint, besides the state, that a resumed run needs.
///
/// It makes a retry of the last window safe, and lets a returning owner notice that another client was the owner.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ResumeInfo {
    /// Reply to the last window, with the digest of its request.
    pub answered: Option<(Digest, AdvanceReply)>,
    /// True if parameters were changed after the last window.
    pub is_outdated: bool,
    /// Most recent owner.
    pub last_client: String,
    /// Number of owners so far.
    pub owner_count: u64,
}

/// Component that an owner advances in lockstep.
pub struct Lockstep {
    component: Component,
    run_id: String,
    /// State that `reset` returns to, and its hash.
    start: SavedState,
    start_hash: StateHash,
    hash_function: fn(&Model, &State) -> u128,
    /// Hash of the current state, updated when the state changes.
    state_hash: StateHash,
    seq: u64,
    /// Digest of the last window's request, and its reply.
    answered: Option<(Digest, AdvanceReply)>,
    /// True if parameters were changed after the last window.
    is_outdated: bool,
    saved: SavedStates,
    owner: Ownership,
    /// Message of the internal error that has put the component into the error state.
    failure: Option<String>,
    /// True once a bed has been prepared.
    is_configured: bool,
    is_shutting_down: bool,
    durable_seq: u64,
    computed_windows: u64,
    last_timing: Option<WindowTiming>,
    /// Wall time of the last request, ms.
    idle_since_ms: u64,
}

impl Lockstep {
    /// Starts a run at the current state of `component`; `hash` computes state hashes.
    pub fn new(
        component: Component,
        run_id: impl Into<String>,
        hash: fn(&Model, &State) -> u128,
    ) -> Self {
        let start = SavedState::of(&component);
        let state_hash = hash(component.model(), component.state()).into();
        Self {
            component,
            run_id: run_id.into(),
            start,
            start_hash: state_hash,
            hash_function: hash,
            state_hash,
            seq: 0,
            answered: None,
            is_outdated: false,
            saved: SavedStates::default(),
            owner: Ownership::default(),
            failure: None,
            is_configured: true,
            is_shutting_down: false,
            durable_seq: 0,
            computed_windows: 0,
            last_timing: None,
            idle_since_ms: 0,
        }
    }

    /// Resumes a run from its checkpoint after window `seq`; `reset` still returns to the initial state.
    ///
    /// # Errors
    /// A state of another model, or invalid parameters.
    pub fn resume(
        &mut self,
        run_id: impl Into<String>,
        seq: u64,
        saved: SavedState,
        info: ResumeInfo,
    ) -> Result<(), RequestError> {
        saved.restore_to(&mut self.component)?;
        self.run_id = run_id.into();
        self.seq = seq;
        self.durable_seq = seq;
        self.update_hash();
        self.answered = info.answered;
        self.is_outdated = info.is_outdated;
        self.owner.set_history(info.last_client, info.owner_count);
        Ok(())
    }

    /// Returns the hash of the current state.
    pub fn state_hash(&self) -> StateHash {
        self.state_hash
    }

    /// Returns the hash of the state at the start of the run.
    pub fn start_hash(&self) -> StateHash {
        self.start_hash
    }

    /// Returns the data that a checkpoint stores besides the state.
    pub fn resume_info(&self) -> ResumeInfo {
        let (last_client, owner_count) = self.owner.history();
        ResumeInfo {
            answered: self.answered.clone(),
            is_outdated: self.is_outdated,
            last_client: last_client.into(),
            owner_count,
        }
    }

    /// Returns the component.
    pub fn component(&self) -> &Component {
        &self.component
    }

    /// Returns the position of the run.
    pub fn position(&self) -> RunPosition {
        RunPosition {
            run_id: self.run_id.clone(),
            seq: self.seq,
            now_ns: self.component.now_ns(),
            hash: self.state_hash.to_string(),
        }
    }

    fn update_hash(&mut self) {
        self.state_hash =
            (self.hash_function)(self.component.model(), self.component.state()).into();
    }

    /// Returns the status between two windows; `now_ms` is the wall time since the start.
    pub fn status(&self, now_ms: u64) -> StatusReport {
        let state = match (&self.failure, self.is_shutting_down) {
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
            error: self.failure.clone(),
            last_window: self.last_timing.clone(),
            durable_seq: self.durable_seq,
            uptime_ms: now_ms,
            ..StatusReport::default()
        }
    }

    /// Returns the number of computed windows; replies repeated from the store do not count.
    pub fn computed_windows(&self) -> u64 {
        self.computed_windows
    }

    /// Records that a checkpoint of the current state has been written.
    pub fn note_durable(&mut self) {
        self.durable_seq = self.seq;
    }

    /// Returns the number of the last window that a checkpoint contains.
    pub fn durable_seq(&self) -> u64 {
        self.durable_seq
    }

    /// Excludes the last window from the durable ones, because the state has changed after the checkpoint.
    fn invalidate_last_checkpoint(&mut self) {
        self.durable_seq = self.durable_seq.min(self.seq.saturating_sub(1));
    }

    /// Makes the client the owner; `ticket` must be new and hard to guess.
    ///
    /// # Errors
    /// [`ErrorCode::Busy`] if another client is the owner, [`ErrorCode::WrongRun`], [`ErrorCode::ShuttingDown`].
    pub fn attach(
        &mut self,
        request: &AttachRequest,
        ticket: String,
        now_ms: u64,
    ) -> Result<AttachReply, RequestError> {
        self.check_not_shutting_down()?;
        check_name("client", &request.client)?;
        if let Some(run_id) = &request.run_id
            && *run_id != self.run_id
        {
            return Err(self.wrong_run(run_id));
        }
        let owner_count = self.owner.attach(request, &ticket, now_ms)?;
        self.idle_since_ms = now_ms;
        Ok(AttachReply { ticket, owner_count, position: self.position() })
    }

    /// Ends the ownership; the run stays at its position.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`].
    pub fn detach(&mut self, ticket: &str) -> Result<RunPosition, RequestError> {
        self.owner.check(ticket)?;
        self.owner.detach();
        Ok(self.position())
    }

    /// Ends the ownership of a disconnected client; returns true if it was the owner.
    pub fn client_disconnected(&mut self, client: &str) -> bool {
        self.owner.disconnect(client)
    }

    /// Shuts the component down at the owner's request; no window is computed afterwards.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`].
    pub fn shut_down(&mut self, ticket: &str) -> Result<RunPosition, RequestError> {
        self.check_owner(ticket)?;
        self.stop();
        Ok(self.position())
    }

    /// Shuts the component down without a request.
    pub fn stop(&mut self) {
        self.is_shutting_down = true;
    }

    /// Returns true once a bed has been prepared.
    pub fn is_configured(&self) -> bool {
        self.is_configured
    }

    /// Returns the ownership.
    pub fn owner(&self) -> &Ownership {
        &self.owner
    }

    fn check_owner(&self, ticket: &str) -> Result<(), RequestError> {
        self.owner.check(ticket)
    }

    fn check_not_shutting_down(&self) -> Result<(), RequestError> {
        if self.is_shutting_down {
            let message = "the component is shutting down";
            return Err(RequestError::new(ErrorCode::ShuttingDown, message));
        }
        Ok(())
    }

    /// Returns an error unless the ticket is the owner's and the component can compute.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`], [`ErrorCode::ShuttingDown`], [`ErrorCode::Unconfigured`], [`ErrorCode::ErrorState`].
    pub fn check_ready(&self, ticket: &str) -> Result<(), RequestError> {
        self.check_owner(ticket)?;
        self.check_operational()
    }

    fn check_configured(&self) -> Result<(), RequestError> {
        self.check_not_shutting_down()?;
        if self.is_configured {
            return Ok(());
        }
        let message = "no bed has been prepared; request `init` first";
        Err(RequestError::new(ErrorCode::Unconfigured, message))
    }

    fn check_operational(&self) -> Result<(), RequestError> {
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
        let expected = format!("{:?}", self.run_id);
        RequestError::expected(ErrorCode::WrongRun, "run_id", expected, format!("{found:?}"))
    }
}
