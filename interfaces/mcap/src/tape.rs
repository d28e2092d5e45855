//! The recording of a run while it goes.

use crate::entry::Entry;
use crate::error::{Error, Result};
use crate::meta::Meta;
use crate::recording::{self, START};
use crate::window;
use crate::writer::Writer;
use ballast::component;
use ballast::model::{Model, Solver};
use ballast::state::State;
use ballast::track::plan::Plan;
use ballast_protocol::MessageError;
use ballast_protocol::messages::{
    AdvanceReply, AdvanceRequest, BodyMotion, Log, ReplyStatus, SolverParameters, StepSeries,
    core_ns,
};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// A recording that windows are added to.
pub struct Tape {
    path: PathBuf,
    writer: Writer,
    run_id: String,
    /// Number of the last window.
    seq: u64,
    /// What was said last of how steps are solved.
    parameters: SolverParameters,
}

/// What decides how the steps of a model are solved; limits only decide what is kept, and what is kept is recorded.
fn parameters(model: &Model) -> SolverParameters {
    let solver = &model.solver;
    component::Parameters {
        iterations: solver.max_iterations,
        tolerance: solver.tolerance,
        penetration: f64::INFINITY,
    }
    .into()
}

/// Whether a run of a case is at its beginning, solved as the case says: what a recording from there on needs is
/// the case alone.
fn is_the_beginning(plan: &Plan, model: &Model, state: &State) -> bool {
    let how = |solver: &Solver| (solver.max_iterations, solver.tolerance);
    state.step == 0 && how(&model.solver) == how(&plan.run.solver)
}

/// Refuses a path where something else than a recording of ours lies: a slip of the command line is not to cost a case,
/// results, or what somebody has measured.
///
/// # Errors
/// [`Error::Unsuitable`], or the system refuses.
pub fn may_become_a_recording(path: &Path) -> Result<()> {
    let refused = |found: &str| {
        let expected = "a new file, or a recording of ours to replace";
        Err(Error::unsuitable(path, "recording", expected, found))
    };
    match path.metadata() {
        Ok(what) if what.is_file() => {}
        Ok(what) if what.is_dir() => return refused("a folder"),
        // A pipe would be waited for, and a device cannot be emptied.
        Ok(_) => return refused("a device or a pipe"),
        // Nothing is there, or what is there is told when it is opened.
        Err(_) => return Ok(()),
    }
    let mut start = vec![];
    let read =
        File::open(path).and_then(|f| f.take(mcap::MAGIC.len() as u64).read_to_end(&mut start));
    read.map_err(|e| Error::io(path, "open", e))?;
    match &start[..] {
        [] => Ok(()),
        // One that cannot be read may be what a kill has left of ours.
        mcap if mcap == mcap::MAGIC => match recording::is_ours(path) {
            Ok(false) => refused("one of another program"),
            _ => Ok(()),
        },
        _ => refused("another file"),
    }
}

impl Tape {
    /// Starts the recording of a run of the case `plan` that is at `state`. Where the case does not begin there, it
    /// holds the run's `checkpoint`, from which it can be computed again.
    ///
    /// # Errors
    /// As for [`may_become_a_recording`]; [`Error::Start`] where there is no checkpoint.
    pub fn begin<E: Into<Box<dyn std::error::Error + Send + Sync>>>(
        path: &Path,
        plan: &Plan,
        meta: &Meta,
        model: &Model,
        state: &State,
        checkpoint: impl FnOnce() -> std::result::Result<Vec<u8>, E>,
    ) -> Result<Self> {
        may_become_a_recording(path)?;
        let start = match is_the_beginning(plan, model, state) {
            true => None,
            false => Some(checkpoint().map_err(|e| Error::Start(e.into()))?),
        };
        let mut writer = Writer::create(path, Some(meta))?;
        if let Some(start) = start {
            writer.attach(START, state.time_ns, &start)?;
        }
        // Not fresh for every run: the same run leaves the same bytes.
        let run_id = meta.initial_hash.to_string();
        let parameters = parameters(model);
        let mut tape = Self { path: path.into(), writer, run_id, seq: 0, parameters };
        tape.write_all(window::start(model, state))?;
        Ok(tape)
    }

    /// The request of the window that comes next.
    pub fn request(&self, t0_ns: u64, t1_ns: u64, motions: Vec<BodyMotion>) -> AdvanceRequest {
        let bare = AdvanceRequest::of(&self.run_id, self.seq + 1, [t0_ns, t1_ns]);
        AdvanceRequest { motions, ..bare }
    }

    /// A window as it can be computed again: up to where it ended, without a deadline or a
    /// series, in the run of this recording.
    pub(crate) fn repeatable(
        &self,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
    ) -> (AdvanceRequest, AdvanceReply) {
        let request = AdvanceRequest {
            run_id: self.run_id.clone(),
            t1_ns: reply.t1_ns,
            deadline_ms: 0,
            deadline_policy: Default::default(),
            // A way of telling; what was computed does not depend on it.
            record_steps: false,
            ..request.clone()
        };
        let status = match reply.status {
            ReplyStatus::Early if reply.solver.steps_not_converged > 0 => ReplyStatus::Warn,
            ReplyStatus::Early => ReplyStatus::Ok,
            other => other,
        };
        let (run_id, step_series) = (self.run_id.clone(), StepSeries::default());
        // As far as it came, nothing was wrong.
        let (code, message) = match reply.status {
            ReplyStatus::Early => Default::default(),
            _ => (reply.code.clone(), reply.message.clone()),
        };
        (request, AdvanceReply { run_id, status, code, message, step_series, ..reply.clone() })
    }

    /// Adds a window that has led to `state`.
    ///
    /// # Errors
    /// The system refuses.
    pub fn window(
        &mut self,
        model: &Model,
        state: &State,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
    ) -> Result<()> {
        self.seq = request.seq;
        let parameters = parameters(model);
        if parameters != self.parameters {
            self.parameters = parameters;
            let begin = core_ns(request.t0_ns);
            let entry = Entry::of(window::PARAMETERS, begin, &parameters);
            self.write_all(entry.map(|entry| vec![entry]))?;
        }
        self.write_all(window::entries(model, state, request, reply))
    }

    /// Adds a line to the log, at a time of the run (ns).
    ///
    /// # Errors
    /// The system refuses.
    pub fn log(&mut self, time_ns: u64, text: &str) -> Result<()> {
        let log = Log::info(time_ns, "ballast", text);
        self.write_all(Entry::of("/log", time_ns, &log).map(|entry| vec![entry]))
    }

    /// Adds other messages, such as pictures.
    ///
    /// # Errors
    /// The system refuses; messages that cannot be written.
    pub fn write_all(
        &mut self,
        entries: std::result::Result<Vec<Entry>, MessageError>,
    ) -> Result<()> {
        let entries = entries.map_err(|e| Error::Refused(e, self.path.clone()))?;
        entries.iter().try_for_each(|entry| self.writer.write(entry))
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// The system refuses.
    pub fn finish(self) -> Result<()> {
        self.writer.finish()
    }
}
