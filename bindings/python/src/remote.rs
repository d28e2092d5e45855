//! Remote backend: drives a component of another process (`ballast serve`) over Zenoh.
//!
//! Contract: equal windows give the results and state hashes of the local backend. A window without a received reply is
//! requested again before anything else; the component computes it once.

use crate::backend::{Backend, LastResult, WindowSpec};
use crate::calls::CallState;
use crate::errors::{self, Error, RemoteError};
use crate::lock::lock;
use crate::result::PyWindowResult;
use crate::state::{CommandedMotion, PyState, RemoteState, StateStorage};
use crate::threads::{TaskControl, ThreadPoolHandle, run_controlled};
use ballast::cancel::CancelToken;
use ballast_protocol::MessageError;
use ballast_protocol::lockstep::{ParameterUpdate, RequestKind, WindowKind};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, ReplyStatus, core_ns};
use ballast_protocol::motion_starts::{motion_starts, motion_starts_after};
use ballast_zenoh::{Client, ComponentDescription, SessionConfig, StoredStates, Timeouts};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Instant;

/// First process that opened a session. All sessions of a process share Zenoh's threads, which a fork does not have: there
/// no request would ever be answered.
static SESSION_PROCESS: OnceLock<u32> = OnceLock::new();

/// Panic message for a use after `close`, which consumes the backend.
const ATTACHED: &str = "an attached client";

/// A client and the process that has the threads of its session.
struct RemoteClient {
    process: u32,
    /// `None` after it has detached.
    client: Option<Client>,
    /// One worker, which waits for replies while the calling thread handles signals.
    threads: ThreadPoolHandle,
}

impl RemoteClient {
    fn attach(
        py: Python<'_>,
        name: &str,
        link: &SessionConfig,
        cancel: CancelToken,
    ) -> PyResult<(Self, ComponentDescription)> {
        let process = std::process::id();
        check_process(py, *SESSION_PROCESS.get_or_init(|| process))?;
        let threads = ThreadPoolHandle::dedicated();
        let control = TaskControl::new(cancel.clone());
        let (attached, raised) = run_controlled(py, &threads, &control, |_| {
            let timeouts = Timeouts::default();
            let client = Client::attach_cancellable(name, link, "python", None, timeouts, cancel)?;
            let description = client.describe()?;
            Ok((client, description))
        })?;
        if let Some(raised) = raised {
            py.detach(|| drop(attached));
            return Err(raised);
        }
        let (client, description) = attached.map_err(|e| failed(py, e))?;
        Ok((Self { process, client: Some(client), threads }, description))
    }

    fn client(&self) -> &Client {
        self.client.as_ref().expect(ATTACHED)
    }

    /// Runs `work` with the client; returns its result and the exception that was raised meanwhile, such as by Ctrl-C.
    fn run<T: Send>(
        &mut self,
        py: Python<'_>,
        work: impl FnOnce(&mut Client) -> T + Send,
    ) -> PyResult<(T, Option<PyErr>)> {
        check_process(py, self.process)?;
        let control = TaskControl::new(self.client().connection().cancel.clone());
        let Self { client, threads, .. } = self;
        run_controlled(py, threads, &control, |_| work(client.as_mut().expect(ATTACHED)))
    }

    /// Runs `work` whose result is not needed if an exception was raised meanwhile.
    fn request<T: Send>(
        &mut self,
        py: Python<'_>,
        work: impl FnOnce(&mut Client) -> Result<T, ballast_zenoh::Error> + Send,
    ) -> PyResult<T> {
        match self.run(py, work)? {
            (_, Some(raised)) => Err(raised),
            (result, None) => result.map_err(|e| failed(py, e)),
        }
    }

    /// Releases stored states and detaches.
    fn detach(&mut self, py: Python<'_>, stored: &StoredStates) -> PyResult<()> {
        let is_of_this_process = self.process == std::process::id();
        let Some(client) = self.client.take_if(|_| is_of_this_process) else { return Ok(()) };
        let control = TaskControl::new(client.connection().cancel.clone());
        let ((), raised) = run_controlled(py, &self.threads, &control, |_| stored.detach(client))?;
        raised.map_or(Ok(()), Err)
    }
}

impl Drop for RemoteClient {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            // Closing a session waits for threads that this process does not have.
            std::mem::forget(self.client.take());
        }
    }
}

/// Checks that `process` is this one.
fn check_process(py: Python<'_>, process: u32) -> PyResult<()> {
    if process == std::process::id() {
        return Ok(());
    }
    let expected = "the process that opened the first remote simulation, or one that was not forked from it \
                    (multiprocessing's \"spawn\" or \"forkserver\")";
    Err(errors::request(py, "forked_process", "zenoh", expected, "a fork of it"))
}

/// A remote component that this process owns.
pub struct RemoteBackend {
    client: RemoteClient,
    /// Names of the driven bodies `[nd]`.
    names: Arc<[String]>,
    commanded: CommandedMotion,
    /// Start and end of the last window, ns, and the commanded motion at its start.
    last_window: Option<([u64; 2], CommandedMotion)>,
    pending: Option<PendingWindow>,
    calls: Arc<CallState>,
    last_result: LastResult,
    /// The component has failed.
    has_failed: bool,
    /// States that the component stores for this simulation.
    stored: StoredStates,
}

/// A requested window without a received reply.
#[derive(Clone)]
struct PendingWindow {
    kind: WindowKind,
    request: Arc<AdvanceRequest>,
    /// The request includes zones.
    zones: bool,
}

impl RemoteBackend {
    /// Becomes the owner of the component `site/id`.
    pub fn attach(
        py: Python<'_>,
        name: &str,
        link: SessionConfig,
    ) -> PyResult<(Self, ComponentDescription)> {
        let calls = Arc::<CallState>::default();
        let (client, description) = RemoteClient::attach(py, name, &link, calls.cancel.clone())?;
        let commanded = motion_starts(&description).map_err(|e| bad_reply(py, "describe", &e))?;
        let backend = Self {
            client,
            names: description.bodies.iter().map(|b| b.name.clone()).collect(),
            commanded: commanded.into(),
            last_window: None,
            pending: None,
            calls,
            last_result: LastResult::default(),
            has_failed: false,
            stored: StoredStates::default(),
        };
        Ok((backend, description))
    }

    pub fn calls(&self) -> &Arc<CallState> {
        &self.calls
    }

    pub fn last_result(&self) -> &LastResult {
        &self.last_result
    }

    fn request(
        &self,
        py: Python<'_>,
        kind: WindowKind,
        spec: &WindowSpec,
    ) -> PyResult<AdvanceRequest> {
        let mut request = match (kind, spec.t1_ns, &self.last_window) {
            (WindowKind::Advance, Some(t1_ns), _) => self.client.client().next_request(t1_ns),
            (WindowKind::Redo, None, Some((ends, _))) => self.client.client().redo_request(*ends),
            _ => {
                let expected = "a window before this one";
                return Err(errors::request(py, "nothing_to_redo", "redo", expected, "none"));
            }
        };
        check_times(py, spec)?;
        request.motions = spec.motions.iter().map(Into::into).collect();
        request.loads = spec.loads.iter().map(Into::into).collect();
        request.record_steps = spec.record_steps;
        Ok(request)
    }

    /// Waits for the reply to the pending window, if there is one, and ignores its result.
    fn settle(&mut self, py: Python<'_>) -> PyResult<()> {
        if self.pending.is_none() {
            return Ok(());
        }
        match self.finish_pending(py) {
            // A refused window has changed nothing.
            Err(error) if self.pending.is_some() || !error.is_instance_of::<Error>(py) => {
                Err(error)
            }
            _ => Ok(()),
        }
    }

    /// Requests the pending window until its reply arrives, and follows its effect.
    fn finish_pending(&mut self, py: Python<'_>) -> PyResult<Py<PyWindowResult>> {
        let Some(PendingWindow { kind, request, zones }) = self.pending.clone() else {
            return Err(errors::error::<Error>(py, "failed", "no window is pending"));
        };
        let begin = Instant::now();
        let send = |client: &mut Client| client.send(kind, Arc::clone(&request));
        let (result, raised) = self.client.run(py, send)?;
        let mut reply = match result {
            Ok(reply) => reply,
            Err(error) => {
                // A refused window was not computed; one of a diverged run will never be answered.
                if !self.client.client().has_pending() {
                    self.pending = None;
                }
                return Err(raised.unwrap_or_else(|| failed(py, error)));
            }
        };
        self.pending = None;
        *lock(&self.last_result) = None;
        self.follow(py, kind, &request, &reply)?;
        // Checks the values of the reply.
        reply.outcome().map_err(|e| bad_reply(py, RequestKind::Window(kind).name(), &e))?;
        if !zones {
            reply.zones.clear();
        }
        let names = Arc::clone(&self.names);
        let wall_time_s = begin.elapsed().as_secs_f64();
        let result = PyWindowResult::new(py, reply, names, wall_time_s, request.record_steps)?;
        let result = Py::new(py, result)?;
        *lock(&self.last_result) = Some(result.clone_ref(py));
        raised.map_or(Ok(result), Err)
    }

    /// Updates the commanded motion with an answered window.
    fn follow(
        &mut self,
        py: Python<'_>,
        kind: WindowKind,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
    ) -> PyResult<()> {
        if matches!(reply.status, ReplyStatus::Error | ReplyStatus::Fatal) {
            self.has_failed = true;
            return Err(errors::internal(py, format!("{}; restore a saved state", reply.message)));
        }
        let inputs = request.inputs().map_err(|e| errors::fault(py, &e.into()))?;
        let before = match (kind, &self.last_window) {
            (WindowKind::Redo, Some((_, before))) => Arc::clone(before),
            _ => Arc::clone(&self.commanded),
        };
        self.commanded = match reply.status {
            ReplyStatus::Discard => Arc::clone(&before),
            _ => {
                let end = core_ns(reply.t1_ns);
                motion_starts_after(&before, &self.names, &inputs.motions, end).into()
            }
        };
        let start = core_ns(request.t0_ns);
        self.last_window = Some(([start, inputs.t1_ns], before));
        Ok(())
    }
}

impl Backend for RemoteBackend {
    fn window(&mut self, py: Python<'_>, spec: &WindowSpec) -> PyResult<Py<PyWindowResult>> {
        if let Some(PendingWindow { kind, request, .. }) = &self.pending {
            // A repeated call collects the reply; any other call waits for it first.
            let repeated = self.request(py, *kind, spec);
            if !repeated.is_ok_and(|repeated| repeated == **request) {
                self.settle(py)?;
            }
        }
        let request = match self.pending.take() {
            Some(PendingWindow { request, .. }) => request,
            None => self.request(py, spec.kind(), spec)?.into(),
        };
        self.pending = Some(PendingWindow { kind: spec.kind(), request, zones: spec.zones });
        self.finish_pending(py)
    }

    fn save(&mut self, py: Python<'_>) -> PyResult<PyState> {
        self.settle(py)?;
        let stored = self.stored.clone();
        let (name, place) = self.client.request(py, |client| stored.save(client))?;
        Ok(PyState(StateStorage::Remote(RemoteState {
            component: self.client.client().connection().keys().name().into(),
            place,
            name,
            bodies: Arc::clone(&self.names),
            commanded: Arc::clone(&self.commanded),
            stored: Mutex::new(Some(stored)),
        })))
    }

    fn restore(&mut self, py: Python<'_>, state: &PyState) -> PyResult<()> {
        let invalid = |expected: String, found: String| {
            Err(errors::request(py, "state_invalid", "state", expected, found))
        };
        let state = match &state.0 {
            StateStorage::Remote(state) => state,
            StateStorage::Local(_) => {
                let component = self.client.client().connection().keys().name();
                let expected = format!("a state of the remote component {component}");
                return invalid(expected, "one of this process".into());
            }
        };
        self.settle(py)?;
        let is_own = match &*lock(&state.stored) {
            Some(stored) => stored.is_same(&self.stored),
            None => {
                let connection = self.client.client().connection();
                state.component == connection.keys().name()
                    && state.place.run_id == self.client.client().position().run_id
            }
        };
        if !is_own {
            let expected = "one that this simulation has saved, or a pickled one of its run".into();
            return invalid(expected, format!("one saved at {}", state.component));
        }
        let restore = |client: &mut Client| client.restore(&state.name).cloned();
        let (restored, raised) = self.client.run(py, restore)?;
        let found = match restored {
            Ok(place) => place.hash,
            Err(error) => return Err(raised.unwrap_or_else(|| failed(py, error))),
        };
        if found != state.place.hash {
            return invalid(format!("the hash {}", state.place.hash), found);
        }
        *lock(&state.stored) = Some(self.stored.clone());
        self.commanded = Arc::clone(&state.commanded);
        self.last_window = None;
        self.has_failed = false;
        *lock(&self.last_result) = None;
        raised.map_or(Ok(()), Err)
    }

    fn set_parameters(&mut self, py: Python<'_>, parameters: &ParameterUpdate) -> PyResult<()> {
        self.settle(py)?;
        self.client.request(py, |client| client.set_parameters(parameters).map(|_| ()))
    }

    fn now_ns(&self) -> u64 {
        self.client.client().position().now_ns
    }

    fn has_failed(&self) -> bool {
        self.has_failed
    }

    fn stop_recording(&mut self, _py: Python<'_>) -> PyResult<()> {
        Ok(())
    }

    /// Detaches. The run stays where it is; the states that the component stores for this simulation are released, except
    /// pickled ones.
    fn close(mut self: Box<Self>, py: Python<'_>) -> PyResult<()> {
        self.client.detach(py, &self.stored)
    }
}

/// Checks that messages can hold all times of a request.
fn check_times(py: Python<'_>, spec: &WindowSpec) -> PyResult<()> {
    let motions = spec.motions.iter().flat_map(|input| &input.waveform.knots).map(|k| k.time_ns);
    let loads = spec.loads.iter().flat_map(|input| &input.waveform.knots).map(|k| k.time_ns);
    let times = motions.chain(loads).map(|time_ns| ("times_ns", time_ns));
    let mut times = spec.t1_ns.map(|time_ns| ("t1_ns", time_ns)).into_iter().chain(times);
    let expected =
        "ns since the start of the run, from 0 to 2^63 - 1 (the largest time of a message)";
    match times.find(|(_, time_ns)| i64::try_from(*time_ns).is_err()) {
        Some((place, time_ns)) => Err(errors::invalid(py, place, expected, time_ns)),
        None => Ok(()),
    }
}

/// Returns the exception for a refusal of a component or a missing reply.
fn failed(py: Python<'_>, error: ballast_zenoh::Error) -> PyErr {
    let code = error.code();
    match error.request_error() {
        Some(fault) if code == "error_state" => errors::internal(py, fault),
        Some(fault) => errors::fault(py, fault),
        None => errors::error::<RemoteError>(py, &code, error),
    }
}

/// Returns the exception for a reply that cannot be used.
fn bad_reply(py: Python<'_>, request: &str, fault: &MessageError) -> PyErr {
    failed(py, ballast_zenoh::Error::bad_reply(request, fault))
}
