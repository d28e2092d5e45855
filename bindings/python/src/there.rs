//! The simulation elsewhere: another process computes, `ballast serve`, and is asked over Zenoh.
//!
//! Contract: the same windows give the same outcomes and state hashes as in this process. A window whose answer
//! did not come, or was not waited for, is asked for again before anything else: it counts once.

use crate::compute::{Crew, Turn, attend};
use crate::errors::{self, Error, Lost, Unreachable};
use crate::lock::enter;
use crate::outcome::{Outcome, Series, Trouble};
use crate::simulation::Asked;
use ballast::math::Pose;
use ballast_protocol::Malformed;
use ballast_protocol::description::Body;
use ballast_protocol::lockstep::{Place, Verb, WindowKind};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest, Status, core_ns};
use ballast_zenoh::{Client, Description, Link, Patience};
use pyo3::prelude::*;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Where the next motion of each driven body begins `[nd]`.
type Targets = Arc<[Pose]>;

/// A component elsewhere, driven from here.
pub struct There {
    client: Client,
    /// One worker: it waits for answers while the calling thread listens for Ctrl-C.
    crew: Crew,
    names: Arc<[String]>,
    targets: Targets,
    /// The last window's ends, ns, and the targets at its beginning.
    last: Option<([u64; 2], Targets)>,
    /// Asked, and not answered yet.
    pending: Option<(WindowKind, Arc<AdvanceRequest>)>,
    /// It has failed inside, over there.
    is_lost: bool,
    /// How many states were kept, and the names of those that nobody here holds any more.
    kept: u64,
    forgotten: Arc<Mutex<Vec<String>>>,
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
        let crew = Crew::apart();
        let attached = py.detach(|| {
            let client = Client::attach(name, &link, "python", None, Patience::default())?;
            let about = client.describe()?;
            Ok((client, about))
        });
        let (client, about) = attached.map_err(|e| failed(py, e))?;
        let target = |body: &Body| {
            let orientation = body.orientation.try_into()?;
            Ok(Pose { position: body.position.into(), orientation })
        };
        let targets: Result<_, Malformed> = about.bodies.iter().map(target).collect();
        let there = Self {
            client,
            crew,
            names: about.bodies.iter().map(|b| b.name.clone()).collect(),
            targets: targets.map_err(|e| unusable(py, "describe", &e))?,
            last: None,
            pending: None,
            is_lost: false,
            kept: 0,
            forgotten: Arc::default(),
        };
        Ok((there, about))
    }

    pub fn now_ns(&self) -> u64 {
        self.client.place().now_ns
    }

    pub fn is_lost(&self) -> bool {
        self.is_lost
    }

    pub fn window(&mut self, py: Python<'_>, asked: &Asked) -> PyResult<Outcome> {
        if let Some((kind, request)) = &self.pending {
            // The same once more is what was asked before; anything else comes after it.
            let again = self.request(py, *kind, asked);
            if again.is_ok_and(|again| again == **request) {
                return self.pending_window(py, asked);
            }
            self.settle(py)?;
        }
        let kind = asked.kind();
        self.pending = Some((kind, self.request(py, kind, asked)?.into()));
        self.pending_window(py, asked)
    }

    fn request(&self, py: Python<'_>, kind: WindowKind, asked: &Asked) -> PyResult<AdvanceRequest> {
        let mut request = match (kind, asked.t1_ns, &self.last) {
            (WindowKind::Advance, Some(t1_ns), _) => self.client.next(t1_ns),
            (WindowKind::Redo, None, Some((ends, _))) => self.client.again(*ends),
            _ => {
                let expected = "a window before this one";
                return Err(errors::refused(py, "nothing_to_redo", "redo", expected, "none"));
            }
        };
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
            Ok(_) => Ok(()),
            // It was refused: nothing has changed, and that is all that matters now.
            Err(_) if self.pending.is_none() => Ok(()),
            Err(error) => Err(error),
        }
    }

    fn pending_window(&mut self, py: Python<'_>, asked: &Asked) -> PyResult<Outcome> {
        let begin = Instant::now();
        let reply = self.answer(py)?;
        let wall_s = begin.elapsed().as_secs_f64();
        let inner = reply.outcome();
        let verb = Verb::Window(asked.kind()).word();
        let mut inner = inner.map_err(|e| unusable(py, verb, &e))?;
        if !asked.zones {
            inner.zones.clear();
        }
        let trouble = (!reply.message.is_empty())
            .then(|| Trouble { code: reply.code.clone(), text: reply.message.clone() });
        let names = Arc::clone(&self.names);
        let series = asked.series.then(|| Py::new(py, Series::new(reply.series, &names)));
        Ok(Outcome { inner, trouble, wall_s, names, series: series.transpose()? })
    }

    /// Asks for the pending window until there is an answer, and takes up where it leads.
    fn answer(&mut self, py: Python<'_>) -> PyResult<AdvanceReply> {
        let Some((kind, request)) = self.pending.clone() else {
            return Err(errors::error::<Error>(py, "failed", "no window is pending"));
        };
        let client = &mut self.client;
        let is_given_up = Arc::clone(&client.line().is_given_up);
        let turn = Turn::until(Arc::clone(&is_given_up));
        let done = attend(py, &self.crew, &turn, |_| client.send(kind, Arc::clone(&request)));
        is_given_up.store(false, Ordering::Relaxed);
        let (result, raised) = done?;
        let reply = match result {
            Ok(reply) => reply,
            Err(error) => {
                // What was refused was not done; after another run than this one nothing is to be waited for.
                if !self.client.is_waiting() {
                    self.pending = None;
                }
                return Err(raised.unwrap_or_else(|| failed(py, error)));
            }
        };
        self.pending = None;
        self.take(py, kind, &request, &reply)?;
        raised.map_or(Ok(reply), Err)
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
            for input in &asked.motions {
                if let Some(d) = self.names.iter().position(|n| *n == input.body) {
                    targets[d] = input.waveform.pose(end);
                }
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
        self.kept += 1;
        let name = format!("{}-{}", self.client.id(), self.kept);
        let client = &mut self.client;
        let place = py.detach(|| client.save(&name).cloned()).map_err(|e| failed(py, e))?;
        Ok(Kept {
            component: self.client.line().keys().name().into(),
            place,
            name,
            names: Arc::clone(&self.names),
            targets: Arc::clone(&self.targets),
            forgotten: Arc::clone(&self.forgotten),
        })
    }

    /// States that nobody here holds any more need not be kept over there.
    fn forget(&mut self, py: Python<'_>) -> PyResult<()> {
        let forgotten = || enter(&self.forgotten);
        let mut names = std::mem::take(&mut *forgotten());
        let client = &mut self.client;
        let done = py.detach(|| {
            while let Some(name) = names.last() {
                match client.drop_state(name) {
                    // A component that was started anew has none of them.
                    Err(error) if error.fault().is_none() => return Err(error),
                    _ => names.pop(),
                };
            }
            Ok(())
        });
        // Those that it did not hear of are for the next time.
        forgotten().append(&mut names);
        done.map_err(|e| failed(py, e))
    }

    pub fn restore(&mut self, py: Python<'_>, kept: &Kept) -> PyResult<()> {
        self.settle(py)?;
        if !Arc::ptr_eq(&self.forgotten, &kept.forgotten) {
            let expected = "one that this simulation has saved";
            let found = format!("one saved at {}", kept.component);
            return Err(errors::refused(py, "state_invalid", "state", expected, found));
        }
        let client = &mut self.client;
        py.detach(|| client.restore(&kept.name).map(|_| ())).map_err(|e| failed(py, e))?;
        (self.targets, self.last, self.is_lost) = (Arc::clone(&kept.targets), None, false);
        Ok(())
    }

    /// Leaves; the run stays where it is.
    pub fn close(self, py: Python<'_>) {
        // One that does not hear of it notices that the owner is gone.
        let _ = py.detach(|| self.client.detach());
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
