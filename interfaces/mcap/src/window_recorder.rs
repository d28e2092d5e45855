//! Recorder of the windows of a run, any of which may be redone.

use crate::error::{Error, Result};
use crate::metadata::{RecordingMetadata, START_ATTACHMENT};
use crate::recording;
use crate::window;
use crate::writer::McapWriter;
use ballast::component;
use ballast::math::Vec3;
use ballast::model::{Model, Solver};
use ballast::state::State;
use ballast::track::plan::Plan;
use ballast_protocol::lockstep::WindowKind;
use ballast_protocol::messages::{
    AdvanceReply, AdvanceRequest, BodyMotion, Log, ReplyStatus, SolverParameters, StepSeries,
    core_ns,
};
use ballast_protocol::{MessageError, TopicMessage, topics, visualization};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Number of pictures of points for each picture of polyhedra, which are many times larger.
const POINTS_PER_SCENE: u64 = 10;

/// Recorder of windows, the last of which is written when nothing can change it any more.
///
/// Contract: the file holds the windows as they were in the end, so that a computation from its beginning gives them
/// again. A redone window is written once, one that was cut short as the shorter window that it was, a discarded one
/// not at all. Dropping the recorder ends the file as [`WindowRecorder::finish`] does, without its errors.
pub struct WindowRecorder {
    path: PathBuf,
    /// `None` once the file is finished.
    writer: Option<McapWriter>,
    /// Process that began the file: a fork of it must not write to it.
    process: u32,
    run_id: String,
    /// Number of the last window written.
    seq: u64,
    /// Parameters of the solver that were written last.
    parameters: SolverParameters,
    pending: Option<UnsettledWindow>,
    /// Simulated time between pictures, ns; 0: no pictures.
    picture_ns: u64,
    /// Number of pictures so far.
    pictures: u64,
}

/// Window that may still be redone.
struct UnsettledWindow {
    request: AdvanceRequest,
    reply: AdvanceReply,
    model: Arc<Model>,
    state: Arc<State>,
    /// Lines of the log at its end.
    notes: Vec<String>,
}

/// Returns the parameters that decide how steps are solved; limits decide only which windows are kept.
fn solver_parameters(model: &Model) -> SolverParameters {
    let solver = &model.solver;
    component::Parameters {
        iterations: solver.max_iterations,
        tolerance: solver.tolerance,
        penetration: f64::INFINITY,
    }
    .into()
}

/// Returns true if a run of a case is at its beginning and solved as the case says: such a recording needs the case
/// alone.
fn is_at_start(plan: &Plan, model: &Model, state: &State) -> bool {
    let how = |solver: &Solver| (solver.max_iterations, solver.tolerance);
    state.step == 0 && how(&model.solver) == how(&plan.run.solver)
}

/// Refuses a path that holds anything else than a Ballast recording, so that a typing error costs no other file.
///
/// # Errors
/// [`Error::Unsuitable`], or the system refuses.
pub fn may_become_a_recording(path: &Path) -> Result<()> {
    let refused = |found: &str| {
        let expected = "a new file, or a Ballast recording to replace";
        Err(Error::unsuitable(path, "recording", expected, found))
    };
    match path.metadata() {
        Ok(what) if what.is_file() => {}
        Ok(what) if what.is_dir() => return refused("a folder"),
        // A pipe would be waited for, and a device cannot be emptied.
        Ok(_) => return refused("a device or a pipe"),
        // There is no file, or opening it reports the error.
        Err(_) => return Ok(()),
    }
    let mut start = vec![];
    let read =
        File::open(path).and_then(|f| f.take(mcap::MAGIC.len() as u64).read_to_end(&mut start));
    read.map_err(|e| Error::io(path, "open", e))?;
    match &start[..] {
        [] => Ok(()),
        // An unreadable recording may be one that a killed process has left.
        mcap if mcap == mcap::MAGIC => match recording::is_recording(path) {
            Ok(false) => refused("one of another program"),
            _ => Ok(()),
        },
        _ => refused("another file"),
    }
}

/// Returns a window as it can be computed again: up to its end, without a deadline or a series.
fn repeatable(
    run_id: &str,
    request: &AdvanceRequest,
    reply: &AdvanceReply,
) -> (AdvanceRequest, AdvanceReply) {
    let request = AdvanceRequest {
        run_id: run_id.into(),
        t1_ns: reply.t1_ns,
        deadline_ms: 0,
        deadline_policy: Default::default(),
        record_steps: false,
        ..request.clone()
    };
    let status = match reply.status {
        ReplyStatus::Early if reply.solver.steps_not_converged > 0 => ReplyStatus::Warn,
        ReplyStatus::Early => ReplyStatus::Ok,
        other => other,
    };
    // Up to its end nothing was wrong with it.
    let (code, message) = match reply.status {
        ReplyStatus::Early => Default::default(),
        _ => (reply.code.clone(), reply.message.clone()),
    };
    let (run_id, step_series) = (run_id.into(), StepSeries::default());
    (request, AdvanceReply { run_id, status, code, message, step_series, ..reply.clone() })
}

impl WindowRecorder {
    /// Starts the recording of a run of the case `plan` at `state`, with pictures at the case's output interval.
    ///
    /// Where the case does not begin there, the file holds the run's `checkpoint`, from which it can be computed again.
    ///
    /// # Errors
    /// As for [`may_become_a_recording`]; [`Error::Start`] where there is no checkpoint.
    pub fn begin<E: Into<Box<dyn std::error::Error + Send + Sync>>>(
        path: &Path,
        plan: &Plan,
        meta: &RecordingMetadata,
        model: &Model,
        state: &State,
        checkpoint: impl FnOnce() -> std::result::Result<Vec<u8>, E>,
    ) -> Result<Self> {
        may_become_a_recording(path)?;
        let start = if is_at_start(plan, model, state) {
            None
        } else {
            Some(checkpoint().map_err(|e| Error::Start(e.into()))?)
        };
        let mut writer = McapWriter::create(path, Some(meta))?;
        if let Some(start) = start {
            writer.attach(START_ATTACHMENT, state.time_ns, &start)?;
        }
        let mut recorder = Self {
            path: path.into(),
            writer: Some(writer),
            process: std::process::id(),
            // The same run leaves the same bytes.
            run_id: meta.initial_hash.to_string(),
            seq: 0,
            parameters: solver_parameters(model),
            pending: None,
            picture_ns: plan.run.output_ns,
            pictures: 0,
        };
        recorder.write_all(topics::start_messages(model, state))?;
        if recorder.picture_ns > 0 {
            recorder.picture(model, state, &[])?;
        }
        Ok(recorder)
    }

    /// Returns true if this process began the recording, and not one that it was forked from.
    pub fn is_of_this_process(&self) -> bool {
        self.process == std::process::id()
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the request of the next window.
    pub fn request(&self, t0_ns: u64, t1_ns: u64, motions: Vec<BodyMotion>) -> AdvanceRequest {
        let request = AdvanceRequest::of(&self.run_id, self.seq + 1, [t0_ns, t1_ns]);
        AdvanceRequest { motions, ..request }
    }

    /// Takes a window of `model` that has led to `state`; a redo replaces the last window.
    ///
    /// # Errors
    /// The system refuses to write the window before.
    pub fn window(
        &mut self,
        model: Arc<Model>,
        kind: WindowKind,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
        state: Arc<State>,
    ) -> Result<()> {
        if kind == WindowKind::Advance {
            self.settle()?;
        }
        self.pending = reply.status.is_kept().then(|| {
            let (request, reply) = repeatable(&self.run_id, request, reply);
            UnsettledWindow { request, reply, model, state, notes: Vec::new() }
        });
        Ok(())
    }

    /// Adds a line to the log: at the end of the last window, or at `time_ns` if there is none.
    ///
    /// # Errors
    /// The system refuses.
    pub fn log(&mut self, time_ns: u64, text: &str) -> Result<()> {
        match &mut self.pending {
            Some(pending) => pending.notes.push(text.into()),
            None => self.write_log(time_ns, text)?,
        }
        Ok(())
    }

    /// Writes the last window, which can no longer be redone.
    ///
    /// # Errors
    /// The system refuses.
    pub fn settle(&mut self) -> Result<()> {
        let Some(window) = self.pending.take() else { return Ok(()) };
        let UnsettledWindow { request, reply, model, state, notes } = window;
        self.seq = request.seq;
        let parameters = solver_parameters(&model);
        if parameters != self.parameters {
            self.parameters = parameters;
            let begin = core_ns(request.t0_ns);
            let entry = TopicMessage::of(window::PARAMETERS, begin, &parameters);
            self.write_all(entry.map(|entry| vec![entry]))?;
        }
        self.write_all(window::window_messages(&model, &state, &request, &reply))?;
        for note in &notes {
            self.write_log(state.time_ns, note)?;
        }
        let frame = |time_ns: i64| u64::try_from(time_ns).ok()?.checked_div(self.picture_ns);
        if frame(reply.t1_ns) > frame(reply.t0_ns) {
            self.picture(&model, &state, &visualization::forces(&reply))?;
        }
        Ok(())
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// The system refuses.
    pub fn finish(mut self) -> Result<()> {
        self.settle()?;
        self.end()
    }

    fn write_log(&mut self, time_ns: u64, text: &str) -> Result<()> {
        let log = Log::info(time_ns, "ballast", text);
        self.write_all(TopicMessage::of("/log", time_ns, &log).map(|entry| vec![entry]))
    }

    fn picture(&mut self, model: &Model, state: &State, forces: &[Vec3]) -> Result<()> {
        let has_scene = self.pictures.is_multiple_of(POINTS_PER_SCENE);
        self.pictures += 1;
        self.write_all(topics::stones_message(model, state).map(|entry| vec![entry]))?;
        if has_scene {
            let scene = topics::scene_message(model, state, forces, true);
            self.write_all(scene.map(|entry| vec![entry]))?;
        }
        Ok(())
    }

    fn write_all(
        &mut self,
        entries: std::result::Result<Vec<TopicMessage>, MessageError>,
    ) -> Result<()> {
        let entries = entries.map_err(|e| Error::Refused(e, self.path.clone()))?;
        let Some(writer) = &mut self.writer else { return Ok(()) };
        entries.iter().try_for_each(|entry| writer.write(entry))
    }

    fn end(&mut self) -> Result<()> {
        self.writer.take().map_or(Ok(()), McapWriter::finish)
    }
}

impl Drop for WindowRecorder {
    fn drop(&mut self) {
        if self.is_of_this_process() {
            // Errors have no receiver here.
            let _ = self.settle().and_then(|()| self.end());
        } else {
            // Dropping the writer would write the end of the file.
            std::mem::forget(self.writer.take());
        }
    }
}
