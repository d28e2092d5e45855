//! Side tasks of a served run: checkpoints, the recording and messages on the terminal.

use super::args::ServeArgs;
use super::served_checkpoint;
use super::served_recording::ServedRecording;
use crate::case::{self, Case, CaseOverrides};
use crate::console::Console;
use crate::nonfatal_errors::NonFatalErrors;
use crate::{beds, case_run, interrupt};
use ballast::component::Component;
use ballast::track::{self, TampingCycle};
use ballast_foxglove::LiveViewServer;
use ballast_protocol::description::TineDescription;
use ballast_protocol::lockstep::{ErrorCode, InitRequest, Lockstep, RequestError, WindowKind};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest};
use ballast_session::{Failure, Reporter, Result};
use ballast_zenoh::ServerHooks;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A case as it is served: stepped, and its zones measured.
pub fn served(case: &Case, beds: &Path, console: Console) -> Result<Component> {
    let (model, state) = beds::scene(case, beds, &console)?;
    Ok(case::component(case, Arc::new(model), state)?.with_zones(track::zones(&case.plan)))
}

/// Least time between two checkpoints, or tries, while no window is asked for.
const REST: Duration = Duration::from_secs(1);

pub struct ServedRun {
    pub console: Console,
    pub case: Case,
    /// Overrides from the command line of the server, on which `init` is based.
    choices: CaseOverrides,
    /// Folder of prepared beds.
    pub beds: PathBuf,
    pub checkpoint: PathBuf,
    pub every: Duration,
    pub recording: Option<ServedRecording>,
    live_view: Option<LiveViewServer>,
    /// When the last checkpoint was written, or tried to be.
    written: Instant,
    /// Run, window and time of the checkpoint that lies on the disk, as far as this process has written it.
    durable: Option<(String, u64, u64)>,
    /// Nothing has changed since it was written.
    is_current: bool,
    /// The run does not lead through it any more: the next one is due.
    is_due: bool,
    /// Partners are served whatever goes wrong beside it.
    pub errors: NonFatalErrors,
}

impl ServedRun {
    pub fn new(
        args: &ServeArgs,
        case: Case,
        checkpoint: PathBuf,
        recording: Option<ServedRecording>,
        live_view: Option<LiveViewServer>,
        console: Console,
    ) -> Self {
        Self {
            console,
            case,
            choices: CaseOverrides::from(&args.overrides),
            beds: args.beds.bed_cache.clone(),
            checkpoint,
            every: args.checkpoint_interval,
            recording,
            live_view,
            written: Instant::now(),
            durable: None,
            // Nothing has been computed here yet.
            is_current: true,
            is_due: false,
            errors: NonFatalErrors::new(console),
        }
    }

    /// The case with other choices, and its bed.
    fn prepare_bed(&self, ask: &InitRequest) -> Result<(Case, Component)> {
        let asked = CaseOverrides::from_names(ask.seed, ask.schedule.as_deref())
            .map_err(|e| Failure::Usage(e.to_string()))?;
        let choices = asked.or(self.choices);
        let (text, name) = (self.case.text.clone(), &self.case.plan.name);
        let case = case::parse(text, name, &choices, &self.console)?;
        let component = served(&case, &self.beds, self.console)?;
        Ok((case, component))
    }

    /// Returns true if the last window of the checkpoint is the requested one.
    fn holds(&self, request: &AdvanceRequest) -> bool {
        self.durable
            .as_ref()
            .is_some_and(|(run, seq, _)| (run, *seq) == (&request.run_id, request.seq))
    }

    /// Marks the checkpoint as outdated: the run continues from another state.
    fn outdate(&mut self) {
        (self.is_current, self.is_due) = (false, true);
    }

    fn restart_live_view(&self, lockstep: &Lockstep) {
        if let Some(live_view) = &self.live_view {
            live_view.restart(lockstep.component());
        }
    }

    fn recorded(&mut self, act: impl FnOnce(&mut ServedRecording) -> Result) {
        let Some(recording) = &mut self.recording else { return };
        let result = act(recording);
        if !self.errors.report("recording", result) {
            self.recording = None;
        }
    }
}

impl ServerHooks for ServedRun {
    fn tines(&self, lockstep: &Lockstep) -> Vec<TineDescription> {
        let model = lockstep.component().model();
        // A partner needs no cycle that the program could drive.
        let cycle = TampingCycle::new(&self.case.plan, model);
        cycle.map_or_else(|_| Vec::new(), |cycle| TineDescription::of(&cycle, model))
    }

    fn opened(&mut self, lockstep: &Lockstep) {
        let place = lockstep.position();
        self.console.note(&match lockstep.is_configured() {
            false => "waits for `init`".to_string(),
            true => format!(
                "run {} is ready after window {}, at {:.4} s",
                place.run_id,
                place.seq,
                place.now_ns as f64 / 1e9
            ),
        });
        let ready = json!({ "run_id": place.run_id, "seq": place.seq, "time_ns": place.now_ns });
        self.console.event("ready", ready);
        if lockstep.is_configured() {
            self.restart_live_view(lockstep);
        }
    }

    fn write_checkpoint(&mut self, lockstep: &Lockstep) -> bool {
        if !lockstep.is_configured() {
            return false;
        }
        let place = lockstep.position();
        let at = (place.run_id, place.seq, place.now_ns);
        if self.is_current && self.durable.as_ref() == Some(&at) {
            return true;
        }
        let result = served_checkpoint::write(&self.checkpoint, &self.case, lockstep);
        self.written = Instant::now();
        let saved = self.errors.report("checkpoint", result);
        if saved {
            let path = &self.checkpoint;
            self.console.event("checkpoint", json!({ "seq": at.1, "time_ns": at.2, "path": path }));
            self.durable = Some(at);
            (self.is_current, self.is_due) = (true, false);
        }
        saved
    }

    fn window_computed(
        &mut self,
        lockstep: &Lockstep,
        kind: WindowKind,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
    ) -> bool {
        self.is_current = false;
        if let Some(live_view) = &self.live_view {
            // A discarded window has led to the state before it.
            live_view.show(lockstep.component(), reply.status.is_kept().then_some(reply));
        }
        // A redo leads elsewhere with the same number.
        self.is_due |= kind == WindowKind::Redo && self.holds(request);
        self.recorded(|recording| recording.window(lockstep, kind, request, reply));
        (self.is_due || self.written.elapsed() >= self.every) && self.write_checkpoint(lockstep)
    }

    fn idle(&mut self, lockstep: &Lockstep) -> bool {
        // Not as often as it is asked: one that cannot be written is not tried at every turn.
        let every = self.every.max(REST);
        !self.is_current && self.written.elapsed() >= every && self.write_checkpoint(lockstep)
    }

    fn parameters_changed(&mut self) {
        self.outdate();
    }

    fn state_replaced(&mut self, lockstep: &Lockstep) {
        self.outdate();
        self.restart_live_view(lockstep);
        let case = self.case.clone();
        self.recorded(|recording| recording.start_new_file(&case, lockstep));
    }

    fn prepare(&mut self, ask: &InitRequest) -> Result<Component, RequestError> {
        let prepared = self.prepare_bed(ask).map_err(|failure| {
            let code = if interrupt::requested() {
                ErrorCode::ShuttingDown
            } else {
                ErrorCode::InitFailed
            };
            RequestError::new(code, format!("init: {failure}"))
        });
        let (case, component) = prepared?;
        self.case = case;
        self.outdate();
        if self.recording.is_some() {
            case_run::warn_unless_repeatable(&self.case, self.console);
        }
        Ok(component)
    }

    fn log(&mut self, text: &str) {
        self.console.note(text);
        self.console.event("note", json!({ "text": text }));
    }

    fn is_stopped(&self) -> bool {
        interrupt::requested()
    }
}
