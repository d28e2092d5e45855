//! States: the beginning, kept ones, and the parameters with which they go on.

use super::{
    ErrorCode, Lockstep, MAX_SAVED_STATES, ParameterUpdate, RequestError, RunPosition, StateName,
    check_name,
};
use ballast::component::{Component, Limits, Parameters};
use ballast::math::Vec3;
use ballast::model::{Grains, Model, Solver, Stepping};
use ballast::state::State;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A state and the parameters with which windows go on from it.
#[derive(Debug, Clone, PartialEq)]
pub struct SavedState {
    pub state: Arc<State>,
    pub parameters: Parameters,
}

impl SavedState {
    /// Where a component is.
    pub fn of(component: &Component) -> Self {
        Self { state: component.save(), parameters: component.parameters() }
    }

    pub(super) fn take_up(self, component: &mut Component) -> Result<(), RequestError> {
        component.restore(self.state)?;
        Ok(component.set_parameters(&self.parameters)?)
    }
}

/// A model of nothing at all: what stands where no other is known yet.
pub fn empty_model() -> Model {
    Model {
        shapes: Vec::new(),
        grains: Grains::default(),
        driven: Vec::new(),
        gravity: Vec3::zeros(),
        grain_friction: 0.0,
        restitution: 0.0,
        stepping: Stepping { step_ns: 1, theta: 0.5, detection_distance: 0.0 },
        solver: Solver::default(),
    }
}

/// States kept under names, up to [`MAX_SAVED_STATES`].
#[derive(Debug, Default)]
pub(super) struct SavedStates {
    saved: BTreeMap<String, Saved>,
    /// How many were ever saved.
    count: u64,
}

#[derive(Debug)]
struct Saved {
    kept: SavedState,
    /// Who has saved it, and as the how-manieth.
    client: String,
    number: u64,
}

impl SavedStates {
    /// Keeps a state of `client`'s. Where there is no room, the oldest of a client that is gone gives way.
    fn put(&mut self, name: &str, kept: SavedState, client: &str) -> Result<(), RequestError> {
        if self.saved.len() >= MAX_SAVED_STATES && !self.saved.contains_key(name) {
            let others = self.saved.iter().filter(|(_, saved)| saved.client != client);
            let oldest = others.min_by_key(|(_, saved)| saved.number).map(|(name, _)| name.clone());
            let Some(oldest) = oldest else {
                let found = format!("{} and {name:?}", self.saved.len());
                let expected = format!("at most {MAX_SAVED_STATES}");
                return Err(RequestError::expected(
                    ErrorCode::TooManyStates,
                    "kept states",
                    expected,
                    found,
                ));
            };
            self.saved.remove(&oldest);
        }
        self.count += 1;
        let saved = Saved { kept, client: client.into(), number: self.count };
        self.saved.insert(name.into(), saved);
        Ok(())
    }

    fn get(&self, name: &str) -> Result<SavedState, RequestError> {
        self.saved.get(name).map(|saved| saved.kept.clone()).ok_or_else(|| self.unknown(name))
    }

    fn remove(&mut self, name: &str) -> Result<(), RequestError> {
        self.saved.remove(name).map(|_| ()).ok_or_else(|| self.unknown(name))
    }

    fn unknown(&self, name: &str) -> RequestError {
        let known: Vec<_> = self.saved.keys().collect();
        let found: String = name.chars().take(50).collect();
        let expected = match known[..] {
            [] => "a state that was saved before; there is none".to_string(),
            _ => format!("one of {known:?}"),
        };
        RequestError::expected(ErrorCode::UnknownState, "name", expected, format!("{found:?}"))
    }
}

impl Lockstep {
    /// A component that is to be told by its partner when to prepare what it steps, see [`Lockstep::begin`].
    ///
    /// # Errors
    /// None: an empty world can be stepped.
    pub fn unconfigured(hash: fn(&Model, &State) -> u128) -> Result<Self, RequestError> {
        let nothing = Arc::new(empty_model());
        let component = Component::new(nothing, State::default(), Limits::default())?;
        Ok(Self { is_configured: false, ..Self::new(component, "unconfigured", hash) })
    }

    /// Whether `init` may be asked for: by the owner, unless the component quits.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`], [`ErrorCode::ShuttingDown`].
    pub fn check_init(&self, ticket: &str) -> Result<(), RequestError> {
        self.check_owner(ticket)?;
        self.check_not_quitting()
    }

    /// What `init` has prepared, as a run of its own; who drives stays.
    pub fn begin(&mut self, component: Component, run_id: String, now_ms: u64) -> RunPosition {
        let owner = std::mem::take(&mut self.owner);
        let computed_windows = self.computed_windows;
        *self = Self::new(component, run_id, self.hash);
        (self.owner, self.computed_windows) = (owner, computed_windows);
        self.idle_since_ms = now_ms;
        self.position()
    }

    /// Sets parameters for all windows from now on, and for a redo of the last one.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`], [`ErrorCode::ErrorState`], [`ErrorCode::ParameterInvalid`]; nothing is changed.
    pub fn set_parameters(
        &mut self,
        ask: &ParameterUpdate,
        ticket: &str,
    ) -> Result<RunPosition, RequestError> {
        self.check_ready(ticket)?;
        let changes = ask.apply(&mut self.component)?;
        self.is_outdated |= changes;
        if changes {
            self.lose_durable();
        }
        // They are part of what decides how the run continues.
        self.hash_again();
        Ok(self.position())
    }

    /// Back to the beginning, with the parameters it had there, as a run of its own.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`], [`ErrorCode::ShuttingDown`].
    pub fn reset(
        &mut self,
        run_id: String,
        ticket: &str,
        now_ms: u64,
    ) -> Result<RunPosition, RequestError> {
        self.check_owner(ticket)?;
        self.check_configured()?;
        self.put(self.start.clone())?;
        (self.run_id, self.seq, self.durable_seq) = (run_id, 0, 0);
        self.kept = SavedStates::default();
        self.idle_since_ms = now_ms;
        Ok(self.position())
    }

    /// Keeps the state and the parameters under a name; an older one of this name is replaced, and where there is no room,
    /// the oldest of a client that is gone.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`], [`ErrorCode::ErrorState`], [`ErrorCode::MessageError`] for a name that cannot be one,
    /// [`ErrorCode::TooManyStates`].
    pub fn save(&mut self, ask: &StateName, ticket: &str) -> Result<RunPosition, RequestError> {
        self.check_ready(ticket)?;
        check_name("name", &ask.name)?;
        let client = self.owner.client().unwrap_or_default();
        self.kept.put(&ask.name, SavedState::of(&self.component), client)?;
        Ok(self.position())
    }

    /// Takes up a kept state and its parameters; windows go on counting.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`], [`ErrorCode::UnknownState`], [`ErrorCode::ShuttingDown`].
    pub fn restore(&mut self, ask: &StateName, ticket: &str) -> Result<RunPosition, RequestError> {
        self.check_owner(ticket)?;
        self.check_not_quitting()?;
        self.put(self.kept.get(&ask.name)?)?;
        self.lose_durable();
        Ok(self.position())
    }

    /// Forgets a kept state.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`], [`ErrorCode::UnknownState`].
    pub fn drop_state(
        &mut self,
        ask: &StateName,
        ticket: &str,
    ) -> Result<RunPosition, RequestError> {
        self.check_owner(ticket)?;
        self.kept.remove(&ask.name)?;
        Ok(self.position())
    }

    /// Takes up a state, out of any trouble; the last window cannot be redone or asked for again.
    fn put(&mut self, kept: SavedState) -> Result<(), RequestError> {
        if self.failure.take().is_some() {
            self.component.recover(Arc::clone(&kept.state))?;
        }
        kept.take_up(&mut self.component)?;
        (self.answered, self.is_outdated) = (None, false);
        self.hash_again();
        Ok(())
    }
}
