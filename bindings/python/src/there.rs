//! The simulation elsewhere: another process computes, `ballast serve`, and is asked over Zenoh.
//!
//! Contract: the same windows give the same outcomes and state hashes as in this process. A window whose answer
//! did not come, or was not waited for, is asked for again before anything else: it counts once.

use crate::compute::{Crew, Turn, attend};
use crate::errors::{self, Error, Lost, Unreachable};
use crate::lock::enter;
use crate::outcome::{Outcome, Series, Trouble};
use crate::simulation::{Asked, LastOutcome};
use crate::work::Work;
use ballast::component::Twist;
use ballast::math::Pose;
use ballast_protocol::Malformed;
use ballast_protocol::description::Body;
use ballast_protocol::lockstep::{Place, SetParameters, Verb, WindowKind};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, Status, core_ns};
use ballast_zenoh::{Client, Description, Link, Patience};
use pyo3::prelude::*;
use std::collections::BTreeSet;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Instant;

/// Where the next motion of each driven body begins `[nd]`, and with which twist, if that is not free.
type Targets = Arc<[(Pose, Option<Twist>)]>;

/// The process that was the first to open a session. Zenoh has threads that every session of a process shares, and a
/// fork of it has none of them: there nothing would ever be answered.
static FIRST: OnceLock<u32> = OnceLock::new();

/// It leaves when its simulation is closed, which is the last that is done with it.
const PRESENT: &str = "a client that has not left";

/// The client, in the process that has the threads of its session.
struct Driver {
    process: u32,
    /// `None` when it has left.
    client: Option<Client>,
    /// One worker: it waits for answers while the calling thread listens for Ctrl-C.
    crew: Crew,
}

impl Driver {
    fn attach(
        py: Python<'_>,
        name: &str,
        link: &Link,
        is_given_up: Arc<AtomicBool>,
    ) -> PyResult<(Self, Description)> {
        let process = std::process::id();
        check_process(py, *FIRST.get_or_init(|| process))?;
        let crew = Crew::apart();
        let turn = Turn::until(Arc::clone(&is_given_up));
        let attached = attend(py, &crew, &turn, |_| {
            let patience = Patience::default();
            let client = Client::attach_until(name, link, "python", None, patience, is_given_up)?;
            let about = client.describe()?;
            Ok((client, about))
        });
        let (attached, raised) = attached?;
        if let Some(raised) = raised {
            py.detach(|| drop(attached));
            return Err(raised);
        }
        let (client, about) = attached.map_err(|e| failed(py, e))?;
        Ok((Self { process, client: Some(client), crew }, about))
    }

    fn client(&self) -> &Client {
        self.client.as_ref().expect(PRESENT)
    }

    /// Does `work` with the client; Ctrl-C ends every call of it within a moment, up to the end of the call that asks for
    /// it ([`Work::begin`]), and is given back beside what came of it.
    fn ask<T: Send>(
        &mut self,
        py: Python<'_>,
        work: impl FnOnce(&mut Client) -> T + Send,
    ) -> PyResult<(T, Option<PyErr>)> {
        check_process(py, self.process)?;
        let turn = Turn::until(Arc::clone(&self.client().line().is_given_up));
        let Self { client, crew, .. } = self;
        attend(py, crew, &turn, |_| work(client.as_mut().expect(PRESENT)))
    }

    /// The same for what has no effect that is to be taken note of when Ctrl-C came in between.
    fn tell<T: Send>(
        &mut self,
        py: Python<'_>,
        work: impl FnOnce(&mut Client) -> Result<T, ballast_zenoh::Error> + Send,
    ) -> PyResult<T> {
        match self.ask(py, work)? {
            (_, Some(raised)) => Err(raised),
            (result, None) => result.map_err(|e| failed(py, e)),
        }
    }

    /// Has these states forgotten, and leaves. Who does not hear of it notices that the owner is gone.
    fn leave(&mut self, py: Python<'_>, kept: &BTreeSet<String>) -> PyResult<()> {
        let here = self.process == std::process::id();
        let Some(mut client) = self.client.take_if(|_| here) else { return Ok(()) };
        let turn = Turn::until(Arc::clone(&client.line().is_given_up));
        // One that computes would not answer before it has done.
        let hears = !client.is_waiting();
        let left = attend(py, &self.crew, &turn, |_| {
            let is_answered = |name: &String| match client.drop_state(name) {
                Ok(_) => true,
                Err(error) => error.fault().is_some(),
            };
            if hears && kept.iter().all(is_answered) {
                let _ = client.detach();
            }
        });
        left?.1.map_or(Ok(()), Err)
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            // To end a session is to wait for its threads.
            std::mem::forget(self.client.take());
        }
    }
}

/// Refuses a process other than the one that has the session.
fn check_process(py: Python<'_>, process: u32) -> PyResult<()> {
    if process == std::process::id() {
        return Ok(());
    }
    let expected = "the process that was the first to open a simulation elsewhere, or one that was not forked from it \
                    (multiprocessing's \"spawn\" or \"forkserver\")";
    Err(errors::refused(py, "elsewhere", "zenoh", expected, "a fork of it"))
}

/// A component elsewhere, driven from here.
pub struct There {
    driver: Driver,
    names: Arc<[String]>,
    targets: Targets,
    /// The last window's ends, ns, and the targets at its beginning.
    last: Option<([u64; 2], Targets)>,
    /// Asked, and not answered yet.
    pending: Option<Pending>,
    work: Arc<Work>,
    told: LastOutcome,
    /// It has failed inside, over there.
    is_lost: bool,
    /// How many states were kept, which still are, and those of them that nobody here holds any more.
    count: u64,
    kept: BTreeSet<String>,
    forgotten: Arc<Mutex<Vec<String>>>,
}

/// A window that was asked for.
#[derive(Clone)]
struct Pending {
    kind: WindowKind,
    request: Arc<AdvanceRequest>,
    /// Its zones are asked for, too.
    zones: bool,
}

/// A state that is kept elsewhere; it is forgotten there when nobody here holds it any more.
pub struct Kept {
    pub component: String,
    pub place: Place,
    name: String,
    pub names: Arc<[String]>,
    pub targets: Targets,
    forgotten: Arc<Mutex<Vec<String>>>,
}

impl Drop for Kept {
    fn drop(&mut self) {
        let name = std::mem::take(&mut self.name);
        enter(&self.forgotten).push(name);
    }
}

impl There {
    /// Becomes the owner of the component `site/id`.
    pub fn attach(py: Python<'_>, name: &str, link: Link) -> PyResult<(Self, Description)> {
        let work = Arc::<Work>::default();
        let (driver, about) = Driver::attach(py, name, &link, Arc::clone(&work.is_over))?;
        let target = |body: &Body| {
            let orientation = body.orientation.try_into()?;
            let pose = Pose { position: body.position.into(), orientation };
            Ok((pose, body.twist.map(Into::into)))
        };
        let targets: Result<_, Malformed> = about.bodies.iter().map(target).collect();
        let there = Self {
            driver,
            names: about.bodies.iter().map(|b| b.name.clone()).collect(),
            targets: targets.map_err(|e| unusable(py, "describe", &e))?,
            last: None,
            pending: None,
            work,
            told: LastOutcome::default(),
            is_lost: false,
            count: 0,
            kept: BTreeSet::new(),
            forgotten: Arc::default(),
        };
        Ok((there, about))
    }

    pub fn now_ns(&self) -> u64 {
        self.driver.client().place().now_ns
    }

    pub fn is_lost(&self) -> bool {
        self.is_lost
    }

    pub fn work(&self) -> &Arc<Work> {
        &self.work
    }

    pub fn told(&self) -> &LastOutcome {
        &self.told
    }

    pub fn window(&mut self, py: Python<'_>, asked: &Asked) -> PyResult<Py<Outcome>> {
        if let Some(Pending { kind, request, .. }) = &self.pending {
            // The same once more is what was asked before; anything else comes after it.
            let again = self.request(py, *kind, asked);
            if !again.is_ok_and(|again| again == **request) {
                self.settle(py)?;
            }
        }
        let request = match self.pending.take() {
            Some(Pending { request, .. }) => request,
            None => self.request(py, asked.kind(), asked)?.into(),
        };
        self.pending = Some(Pending { kind: asked.kind(), request, zones: asked.zones });
        self.answer(py)
    }

    fn request(&self, py: Python<'_>, kind: WindowKind, asked: &Asked) -> PyResult<AdvanceRequest> {
        let mut request = match (kind, asked.t1_ns, &self.last) {
            (WindowKind::Advance, Some(t1_ns), _) => self.driver.client().next(t1_ns),
            (WindowKind::Redo, None, Some((ends, _))) => self.driver.client().again(*ends),
            _ => {
                let expected = "a window before this one";
                return Err(errors::refused(py, "nothing_to_redo", "redo", expected, "none"));
            }
        };
        check_times(py, asked)?;
        request.motions = asked.motions.iter().map(Into::into).collect();
        request.loads = asked.loads.iter().map(Into::into).collect();
        request.series = asked.series;
        Ok(request)
    }

    /// Waits for the answer to what is pending, for those who no longer want it.
    fn settle(&mut self, py: Python<'_>) -> PyResult<()> {
        if self.pending.is_none() {
            return Ok(());
        }
        match self.answer(py) {
            // Where it was refused, nothing has changed, and that is all that matters now.
            Err(error) if self.pending.is_some() || !error.is_instance_of::<Error>(py) => {
                Err(error)
            }
            _ => Ok(()),
        }
    }

    /// Asks for the pending window until there is an answer, and takes up where it leads.
    fn answer(&mut self, py: Python<'_>) -> PyResult<Py<Outcome>> {
        let Some(Pending { kind, request, zones }) = self.pending.clone() else {
            return Err(errors::error::<Error>(py, "failed", "no window is pending"));
        };
        let begin = Instant::now();
        let send = |client: &mut Client| client.send(kind, Arc::clone(&request));
        let (result, raised) = self.driver.ask(py, send)?;
        let reply = match result {
            Ok(reply) => reply,
            Err(error) => {
                // What was refused was not done; after another run than this one nothing is to be waited for.
                if !self.driver.client().is_waiting() {
                    self.pending = None;
                }
                return Err(raised.unwrap_or_else(|| failed(py, error)));
            }
        };
        self.pending = None;
        *enter(&self.told) = None;
        self.take(py, kind, &request, &reply)?;
        let mut inner = reply.outcome().map_err(|e| unusable(py, Verb::Window(kind).word(), &e))?;
        if !zones {
            inner.zones.clear();
        }
        let trouble = (!reply.message.is_empty())
            .then(|| Trouble { code: reply.code.clone(), text: reply.message.clone() });
        let names = Arc::clone(&self.names);
        let series = request.series.then(|| Py::new(py, Series::new(reply.series, &names)));
        let (wall_s, series) = (begin.elapsed().as_secs_f64(), series.transpose()?);
        let outcome = Py::new(py, Outcome { inner, trouble, wall_s, names, series })?;
        *enter(&self.told) = Some(outcome.clone_ref(py));
        raised.map_or(Ok(outcome), Err)
    }

    /// Where the answered window has led.
    fn take(
        &mut self,
        py: Python<'_>,
        kind: WindowKind,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
    ) -> PyResult<()> {
        if matches!(reply.status, Status::Error | Status::Fatal) {
            self.is_lost = true;
            let text = format!("{}; restore a saved state", reply.message);
            return Err(errors::error::<Lost>(py, "lost", text));
        }
        let asked = request.inputs().map_err(|e| errors::fault(py, &e.into()))?;
        let before = match (kind, &self.last) {
            (WindowKind::Redo, Some((_, before))) => Arc::clone(before),
            _ => Arc::clone(&self.targets),
        };
        let mut targets = before.to_vec();
        if reply.status != Status::Discard {
            let end = core_ns(reply.t1_ns);
            for (name, target) in self.names.iter().zip(&mut targets) {
                let motion = asked.motions.iter().find(|input| input.body == *name);
                *target = match motion {
                    Some(input) => (input.waveform.pose(end), input.waveform.twist(end)),
                    None => (target.0, Some(Twist::default())),
                };
            }
        }
        let begin = core_ns(request.t0_ns);
        (self.targets, self.last) = (targets.into(), Some(([begin, asked.t1_ns], before)));
        Ok(())
    }

    /// Keeps the state, over there.
    pub fn save(&mut self, py: Python<'_>) -> PyResult<Kept> {
        self.settle(py)?;
        self.forget(py)?;
        self.count += 1;
        let name = format!("{}-{}", self.driver.client().id(), self.count);
        self.kept.insert(name.clone());
        let place = self.driver.tell(py, |client| client.save(&name).cloned())?;
        Ok(Kept {
            component: self.driver.client().line().keys().name().into(),
            place,
            name,
            names: Arc::clone(&self.names),
            targets: Arc::clone(&self.targets),
            forgotten: Arc::clone(&self.forgotten),
        })
    }

    /// States that nobody here holds any more need not be kept over there.
    fn forget(&mut self, py: Python<'_>) -> PyResult<()> {
        let mut names = std::mem::take(&mut *enter(&self.forgotten));
        let result = self.drop_there(py, &mut names);
        // Those that it did not hear of are for the next time.
        enter(&self.forgotten).append(&mut names);
        result
    }

    /// Forgets states over there, and takes those that it has heard of off the list.
    fn drop_there(&mut self, py: Python<'_>, names: &mut Vec<String>) -> PyResult<()> {
        let kept = &mut self.kept;
        self.driver.tell(py, |client| {
            while let Some(name) = names.last() {
                match client.drop_state(name) {
                    // A component that was started anew has none of them.
                    Err(error) if error.fault().is_none() => return Err(error),
                    _ => kept.remove(name),
                };
                names.pop();
            }
            Ok(())
        })
    }

    pub fn restore(&mut self, py: Python<'_>, kept: &Kept) -> PyResult<()> {
        self.settle(py)?;
        if !Arc::ptr_eq(&self.forgotten, &kept.forgotten) {
            let expected = "one that this simulation has saved";
            let found = format!("one saved at {}", kept.component);
            return Err(errors::refused(py, "state_invalid", "state", expected, found));
        }
        let restore = |client: &mut Client| client.restore(&kept.name).map(|_| ());
        let (restored, raised) = self.driver.ask(py, restore)?;
        if let Err(error) = restored {
            return Err(raised.unwrap_or_else(|| failed(py, error)));
        }
        (self.targets, self.last, self.is_lost) = (Arc::clone(&kept.targets), None, false);
        *enter(&self.told) = None;
        raised.map_or(Ok(()), Err)
    }

    /// Sets parameters for all windows from now on, and for a redo of the last one.
    pub fn set_parameters(&mut self, py: Python<'_>, ask: &SetParameters) -> PyResult<()> {
        self.settle(py)?;
        self.driver.tell(py, |client| client.set_parameters(ask).map(|_| ()))
    }

    /// Leaves; the run stays where it is, and what was kept of it for this simulation is forgotten.
    pub fn close(mut self, py: Python<'_>) -> PyResult<()> {
        self.driver.leave(py, &self.kept)
    }
}

/// Refuses times that messages do not hold.
fn check_times(py: Python<'_>, asked: &Asked) -> PyResult<()> {
    let motions = asked.motions.iter().flat_map(|input| &input.waveform.knots).map(|k| k.time_ns);
    let loads = asked.loads.iter().flat_map(|input| &input.waveform.knots).map(|k| k.time_ns);
    let times = motions.chain(loads).map(|time_ns| ("times_ns", time_ns));
    let mut times = asked.t1_ns.map(|time_ns| ("t1_ns", time_ns)).into_iter().chain(times);
    let expected = "ns since the start of the run, from 0 to 2^63 - 1: messages hold no more";
    match times.find(|(_, time_ns)| i64::try_from(*time_ns).is_err()) {
        Some((place, time_ns)) => Err(errors::invalid(py, place, expected, time_ns)),
        None => Ok(()),
    }
}

/// What a component elsewhere has refused, or why there is no answer.
fn failed(py: Python<'_>, error: ballast_zenoh::Error) -> PyErr {
    let code = error.code();
    match error.fault() {
        Some(fault) if code == "in_error" => errors::error::<Lost>(py, "lost", fault),
        Some(fault) => errors::fault(py, fault),
        None => errors::error::<Unreachable>(py, &code, error),
    }
}

/// An answer that cannot be used.
fn unusable(py: Python<'_>, request: &str, fault: &Malformed) -> PyErr {
    failed(py, ballast_zenoh::Error::answer(request, fault))
}

/// A simulation that the component `site/id` computes.
#[pyfunction]
pub fn attach(
    py: Python<'_>,
    component: &str,
    connect: Option<Vec<String>>,
    listen: Option<Vec<String>>,
    config: Option<std::path::PathBuf>,
) -> PyResult<crate::simulation::Simulation> {
    let (connect, listen) = (connect.unwrap_or_default(), listen.unwrap_or_default());
    let link = Link { config, listen, connect, ..Link::default() }.or_connecting();
    let (there, about) = There::attach(py, component, link)?;
    Ok(crate::simulation::Simulation::there(there, about))
}
