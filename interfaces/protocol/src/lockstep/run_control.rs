//! Requests that set, save and replace the state of a run.

use super::saved_states::{SavedState, SavedStates};
use super::{Lockstep, ParameterUpdate, RequestError, RunPosition, StateName, check_name};
use ballast::component::{Component, Limits};
use ballast::math::Vec3;
use ballast::model::{ContactStiffness, Grains, Model, Solver, Stepping};
use ballast::state::State;
use std::sync::Arc;

/// Returns a model without bodies, a placeholder before the first `init`.
pub fn empty_model() -> Model {
    Model {
        shapes: Vec::new(),
        grains: Grains::default(),
        driven: Vec::new(),
        gravity: Vec3::zeros(),
        grain_friction: 0.0,
        grain_stiffness: ContactStiffness::RIGID,
        restitution: 0.0,
        stepping: Stepping { step_ns: 1, theta: 0.5, detection_distance: 0.0 },
        solver: Solver::default(),
    }
}

impl Lockstep {
    /// Creates a component without a bed; the owner's `init` prepares one, see [`Lockstep::begin_run`].
    ///
    /// # Errors
    /// None in practice: an empty model can be stepped.
    pub fn unconfigured(hash: fn(&Model, &State) -> u128) -> Result<Self, RequestError> {
        let component =
            Component::new(Arc::new(empty_model()), State::default(), Limits::default())?;
        Ok(Self { is_configured: false, ..Self::new(component, "unconfigured", hash) })
    }

    /// Returns an error unless the owner may request `init`.
    ///
    /// # Errors
    /// [`ErrorCode::NotOwner`](super::ErrorCode::NotOwner), [`ErrorCode::ShuttingDown`](super::ErrorCode::ShuttingDown).
    pub fn check_init(&self, ticket: &str) -> Result<(), RequestError> {
        self.check_owner(ticket)?;
        self.check_not_shutting_down()
    }

    /// Starts a new run with the component that `init` prepared; the owner stays.
    pub fn begin_run(&mut self, component: Component, run_id: String, now_ms: u64) -> RunPosition {
        let owner = std::mem::take(&mut self.owner);
        let computed_windows = self.computed_windows;
        *self = Self::new(component, run_id, self.hash_function);
        self.owner = owner;
        self.computed_windows = computed_windows;
        self.idle_since_ms = now_ms;
        self.position()
    }

    /// Sets parameters for all later windows and for a redo of the last one.
    ///
    /// # Errors
    /// `not_owner`, `error_state` or `parameter_invalid`; nothing is changed then.
    pub fn set_parameters(
        &mut self,
        update: &ParameterUpdate,
        ticket: &str,
    ) -> Result<RunPosition, RequestError> {
        self.check_ready(ticket)?;
        let has_changed = update.apply(&mut self.component)?;
        self.is_outdated |= has_changed;
        if has_changed {
            self.invalidate_last_checkpoint();
        }
        // The parameters are part of the hashed state.
        self.update_hash();
        Ok(self.position())
    }

    /// Starts a new run from the initial state, with the parameters in force there.
    ///
    /// # Errors
    /// `not_owner`, `shutting_down` or `unconfigured`.
    pub fn reset(
        &mut self,
        run_id: String,
        ticket: &str,
        now_ms: u64,
    ) -> Result<RunPosition, RequestError> {
        self.check_owner(ticket)?;
        self.check_configured()?;
        self.replace_state(self.start.clone())?;
        self.run_id = run_id;
        self.seq = 0;
        self.durable_seq = 0;
        self.saved = SavedStates::default();
        self.idle_since_ms = now_ms;
        Ok(self.position())
    }

    /// Saves the state and its parameters under a name, replacing a state of that name.
    ///
    /// When the store is full, the oldest state of another client is evicted.
    ///
    /// # Errors
    /// `not_owner`, `error_state`, `too_many_states`, or `malformed` for an invalid name.
    pub fn save(&mut self, request: &StateName, ticket: &str) -> Result<RunPosition, RequestError> {
        self.check_ready(ticket)?;
        check_name("name", &request.name)?;
        let client = self.owner.client().unwrap_or_default();
        self.saved.put(&request.name, SavedState::of(&self.component), client)?;
        Ok(self.position())
    }

    /// Restores a saved state and its parameters; window numbers continue.
    ///
    /// # Errors
    /// `not_owner`, `unknown_state` or `shutting_down`.
    pub fn restore(
        &mut self,
        request: &StateName,
        ticket: &str,
    ) -> Result<RunPosition, RequestError> {
        self.check_owner(ticket)?;
        self.check_not_shutting_down()?;
        self.replace_state(self.saved.get(&request.name)?)?;
        self.invalidate_last_checkpoint();
        Ok(self.position())
    }

    /// Deletes a saved state.
    ///
    /// # Errors
    /// `not_owner` or `unknown_state`.
    pub fn drop_state(
        &mut self,
        request: &StateName,
        ticket: &str,
    ) -> Result<RunPosition, RequestError> {
        self.check_owner(ticket)?;
        self.saved.remove(&request.name)?;
        Ok(self.position())
    }

    /// Replaces the state and leaves the error state; the last window can then neither be redone nor repeated.
    fn replace_state(&mut self, saved: SavedState) -> Result<(), RequestError> {
        if self.failure.take().is_some() {
            self.component.recover(Arc::clone(&saved.state))?;
        }
        saved.restore_to(&mut self.component)?;
        self.answered = None;
        self.is_outdated = false;
        self.update_hash();
        Ok(())
    }
}
