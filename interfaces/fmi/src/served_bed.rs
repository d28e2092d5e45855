//! Bed on a server: an instance owns a component of another process and steps it over Zenoh.
//!
//! Contract: every call ends within the timeouts of the client. A step without a reply can be repeated: the component
//! computes it once.

use crate::bed::Error;
use crate::bed_backend::{BedBackend, BedState, BedWindow, MotionStart, PartialStep, ServedState};
#[cfg(unix)]
use crate::library_pin::pin_library;
use crate::logger::UnitLogger;
use crate::served_unit::{COMPONENT_VARIABLE, CONNECT_VARIABLE, ServedUnit};
use crate::status::{Complaint, Status};
use ballast::component::{Parameters, WindowInputs, WindowStatus};
use ballast::model::Model;
use ballast_protocol::lockstep::{ErrorCode, ParameterUpdate, RunPosition, WindowKind};
use ballast_protocol::messages::{AdvanceRequest, ReplyStatus, SolverParameters, core_ns};
use ballast_protocol::motion_starts::{motion_starts, motion_starts_after};
use ballast_zenoh::{Client, SessionConfig, StoredStates, Timeouts};
use std::sync::Arc;

/// Name of the client, which other clients see.
const CLIENT_NAME: &str = "fmu";

/// Component of a server, owned by an instance.
pub(crate) struct ServedBed {
    /// `None` after it has detached.
    client: Option<Client>,
    /// Names of the driven bodies `[nd]`.
    bodies: Vec<String>,
    /// Hash of model and state at the start of the run.
    start_hash: String,
    /// Motion starts of the bodies at the start of the run, and now `[nd]`.
    first_starts: Vec<MotionStart>,
    starts: Vec<MotionStart>,
    /// Parameters in force; `None` if those of the case.
    parameters: Option<Parameters>,
    /// Step without a reply.
    pending: Option<Arc<AdvanceRequest>>,
    /// States at the server.
    stored: StoredStates,
}

impl ServedBed {
    /// Becomes the owner of the component of a unit, at the start of its run.
    ///
    /// # Errors
    /// No component, one of another case, or one with another owner.
    pub fn attach(unit: &ServedUnit, logger: &UnitLogger) -> Result<Self, Error> {
        #[cfg(unix)]
        pin_library();
        let timeouts = Timeouts::default();
        let client =
            Client::attach(&unit.component, &session_config(unit), CLIENT_NAME, None, timeouts);
        let mut client = client.map_err(|e| Error::Served(attach_text(unit, &e)))?;
        match go_to_start(&mut client, unit, logger) {
            Ok(starts) => Ok(Self {
                client: Some(client),
                bodies: unit.outline.bodies.clone(),
                start_hash: unit.start_hash.clone(),
                first_starts: starts.clone(),
                starts,
                parameters: None,
                pending: None,
                stored: StoredStates::default(),
            }),
            Err(text) => {
                // Other clients need not wait for the loss of this one.
                let _ = client.detach();
                Err(Error::Served(format!("{}: {text}", unit.component)))
            }
        }
    }

    fn client(&self) -> &Client {
        self.client.as_ref().expect(ATTACHED)
    }

    fn client_mut(&mut self) -> &mut Client {
        self.client.as_mut().expect(ATTACHED)
    }

    /// Returns an error if a run at its start is that of another bed, as after a restart of the component.
    fn expect_case(&self) -> Result<(), Complaint> {
        let (expected, position) = (&self.start_hash, self.client().position());
        if position.seq != 0 || position.hash == *expected || self.parameters.is_some() {
            return Ok(());
        }
        let found = &position.hash;
        Err(Complaint::error(format!(
            "run: expected state {expected} at the start, found {found}; serve the case of the unit and reset the instance"
        )))
    }

    /// Returns an error if the last step has no reply yet.
    fn expect_no_pending(&self) -> Result<(), Complaint> {
        match &self.pending {
            None => Ok(()),
            Some(pending) => Err(Complaint::error(format!(
                "expected the step to {} s once more with equal inputs, as it has no reply yet, found another call; repeat \
                 it, restore a saved state or reset",
                core_ns(pending.t1_ns) as f64 * 1e-9
            ))),
        }
    }
}

/// Panic message for a use after the client has detached, which only happens at the end.
const ATTACHED: &str = "an attached client";

impl BedBackend for ServedBed {
    fn now_ns(&self) -> u64 {
        self.client().position().now_ns
    }

    fn motion_start(&self, d: usize) -> MotionStart {
        self.starts[d]
    }

    fn state_hash(&self) -> String {
        self.client().position().hash.clone()
    }

    /// Ignores the number: the server has its threads.
    fn set_threads(&mut self, _threads: usize) -> Result<(), Complaint> {
        Ok(())
    }

    fn set_parameters(&mut self, parameters: &Parameters) -> Result<(), Complaint> {
        if self.parameters == Some(*parameters) {
            return Ok(());
        }
        self.expect_no_pending()?;
        self.expect_case()?;
        let SolverParameters { max_iterations, tolerance, max_penetration } = (*parameters).into();
        let update = ParameterUpdate {
            max_iterations: Some(max_iterations),
            tolerance: Some(tolerance),
            max_penetration: Some(max_penetration),
            real_time: None,
        };
        self.client_mut().set_parameters(&update).map_err(|e| failed(&e))?;
        self.parameters = Some(*parameters);
        Ok(())
    }

    fn advance(
        &mut self,
        end_ns: u64,
        inputs: &WindowInputs,
        partial: PartialStep,
    ) -> Result<BedWindow, Complaint> {
        let request = AdvanceRequest {
            motions: inputs.motions.iter().map(Into::into).collect(),
            loads: inputs.loads.iter().map(Into::into).collect(),
            ..self.client().next_request(end_ns)
        };
        if self.pending.as_ref().is_some_and(|pending| **pending != request) {
            self.expect_no_pending()?;
        }
        let request = Arc::new(request);
        self.pending = Some(Arc::clone(&request));
        let sent = self.client_mut().send(WindowKind::Advance, request);
        if sent.is_ok() || !self.client().has_pending() {
            self.pending = None;
        }
        let reply = sent.map_err(|e| failed(&e))?;
        if matches!(reply.status, ReplyStatus::Error | ReplyStatus::Fatal) {
            let text = format!("{}; restore a saved state or reset", reply.message);
            return Err(Complaint::error(text));
        }
        let unusable = |what: String| Complaint::error(format!("reply to the step: {what}"));
        let result = reply.outcome().map_err(|e| unusable(e.to_string()))?;
        let (expected, found) = (self.bodies.len(), result.bodies.len());
        if expected != found {
            return Err(unusable(format!("expected {expected} bodies, found {found}")));
        }
        if result.status != WindowStatus::Discard {
            let end_ns = core_ns(reply.t1_ns);
            self.starts = motion_starts_after(&self.starts, &self.bodies, &inputs.motions, end_ns);
        }
        if (result.status, partial) == (WindowStatus::Early, PartialStep::RollBack) {
            let expected = "a component that discards windows that fail, as `ballast serve` does";
            return Err(unusable(format!("expected {expected}, found one that keeps their steps")));
        }
        Ok(BedWindow { result, reason: reply.message })
    }

    fn save(&mut self) -> Result<BedState, Complaint> {
        self.expect_no_pending()?;
        let stored = self.stored.clone();
        let (name, _) = stored.save(self.client_mut()).map_err(|e| failed(&e))?;
        Ok(BedState::Served(Arc::new(ServedState {
            name,
            starts: self.starts.clone(),
            parameters: self.parameters,
            stored,
        })))
    }

    fn restore(&mut self, state: &BedState, _has_failed: bool) -> Result<(), Complaint> {
        let state = match state {
            BedState::Served(state) if state.stored.is_same(&self.stored) => state,
            _ => {
                let text = "state: expected one that this instance has saved, found another";
                return Err(Complaint::error(text));
            }
        };
        self.client_mut().restore(&state.name).map_err(|e| failed(&e))?;
        self.pending = None;
        self.starts.clone_from(&state.starts);
        self.parameters = state.parameters;
        Ok(())
    }

    fn reset(&mut self) -> Result<(), Complaint> {
        self.client_mut().reset().map_err(|e| failed(&e))?;
        self.pending = None;
        self.starts.clone_from(&self.first_starts);
        self.parameters = None;
        self.expect_case()
    }

    fn model(&self) -> Option<&Model> {
        None
    }
}

impl Drop for ServedBed {
    /// Deletes the saved states and detaches.
    fn drop(&mut self) {
        if let Some(client) = self.client.take() {
            self.stored.detach(client);
        }
    }
}

fn session_config(unit: &ServedUnit) -> SessionConfig {
    let endpoints = unit.endpoints.clone();
    SessionConfig {
        config: endpoints.config,
        listen: endpoints.listen,
        connect: endpoints.connect,
        router: endpoints.router,
        ..SessionConfig::default()
    }
    .or_connect_to_default()
}

/// Checks that a component has the case of the unit, and resets a run that has left its start; returns the motion starts.
fn go_to_start(
    client: &mut Client,
    unit: &ServedUnit,
    logger: &UnitLogger,
) -> Result<Vec<MotionStart>, String> {
    let mut description = client.describe().map_err(|e| e.to_string())?;
    let (outline, found) = (&unit.outline, &description.start_hash);
    if *found != unit.start_hash {
        return Err(format!(
            "expected the case {:?} with {} grains and state {} at the start, found {} grains and state {found}; serve the \
             case of the unit with the bed and the options of its export, or export the unit again",
            outline.name, outline.grains, unit.start_hash, description.grains
        ));
    }
    let RunPosition { run_id, seq, now_ns, hash } = client.position();
    if *seq != 0 || *hash != unit.start_hash {
        let time_s = *now_ns as f64 * 1e-9;
        let text = format!(
            "{}: run {run_id} is reset to its start, found at {time_s} s after window {seq}",
            unit.component
        );
        logger.log(Status::Warning, &text);
        client.reset().map_err(|e| e.to_string())?;
        description = client.describe().map_err(|e| e.to_string())?;
    }
    motion_starts(&description).map_err(|e| format!("description: {e}"))
}

/// Returns the message for a component that cannot be owned.
fn attach_text(unit: &ServedUnit, error: &ballast_zenoh::Error) -> String {
    let component = &unit.component;
    let endpoints = &unit.endpoints;
    let place = match (&endpoints.router, &endpoints.connect[..], &endpoints.config) {
        (Some(router), ..) => format!("router {router}"),
        (None, [], Some(file)) => file.display().to_string(),
        (None, [], None) => ballast_zenoh::session::DEFAULT_ENDPOINT.into(),
        (None, connect, _) => connect.join(", "),
    };
    let hint = match error {
        ballast_zenoh::Error::Rejected(refusal) if refusal.code == ErrorCode::Busy => {
            "end that client, or serve the case under another name for each instance".into()
        }
        ballast_zenoh::Error::Rejected(_) => "try again when the component is ready".into(),
        _ => format!("start `ballast serve CASE --key {component}` there"),
    };
    format!(
        "{component} at {place}: expected a component to own, found: {error}; {hint}. {COMPONENT_VARIABLE} and \
         {CONNECT_VARIABLE} name another component and endpoint"
    )
}

/// Returns the complaint about a request without effect.
fn failed(error: &ballast_zenoh::Error) -> Complaint {
    use ErrorCode::{
        InputGap, InputInvalid, InputJump, ParameterInvalid, TimeGrid, TooManyRequests,
    };
    match error {
        ballast_zenoh::Error::Timeout { .. }
        | ballast_zenoh::Error::Disconnected { .. }
        | ballast_zenoh::Error::Transport { .. } => Complaint::discard(format!(
            "{error}; continue the component with `ballast serve … --resume` if it has ended, then repeat the call"
        )),
        ballast_zenoh::Error::Rejected(refusal) => match refusal.code {
            InputGap | InputInvalid | InputJump | ParameterInvalid | TimeGrid | TooManyRequests => {
                Complaint::discard(error.to_string())
            }
            ErrorCode::UnknownState => Complaint::error(format!(
                "{error}; saved states end with the component, and with a reset of its run"
            )),
            ErrorCode::WrongRun => Complaint::error(format!(
                "{error}; the component has begun another run: reset the instance"
            )),
            _ => Complaint::error(error.to_string()),
        },
        ballast_zenoh::Error::Diverged { .. } => {
            Complaint::error(format!("{error}; restore a saved state or reset"))
        }
        _ => Complaint::error(error.to_string()),
    }
}
