//! What is done beside answering: checkpoints, the recording, a word to the person at the terminal.

use super::args::Serve;
use super::kept;
use super::tape::Recording;
use crate::aside::Aside;
use crate::case::{self, Case, Choices};
use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::{beds, interrupt};
use ballast::component::Component;
use ballast::track;
use ballast_protocol::lockstep::{Code, Fault, Init, Lockstep, WindowKind};
use ballast_protocol::messages::{AdvanceReply, AdvanceRequest};
use ballast_zenoh::Host;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A case as it is served: stepped, and its zones measured.
pub fn served(case: &Case, beds: &Path, console: Console) -> Outcome<Component> {
    let (model, state) = beds::scene(case, beds, console)?;
    Ok(case::component(case, Arc::new(model), state)?.with_zones(track::zones(&case.plan)))
}

pub struct Keeper {
    pub console: Console,
    pub case: Case,
    /// What was chosen where the component was started: what `init` goes out from.
    choices: Choices,
    /// Folder of prepared beds.
    pub beds: PathBuf,
    pub checkpoint: PathBuf,
    pub every: Duration,
    pub recording: Option<Recording>,
    /// When the last checkpoint was written, and after which window of which run.
    written: Instant,
    durable: Option<(String, u64, u64)>,
    /// Partners are served whatever goes wrong beside it.
    pub aside: Aside,
}

impl Keeper {
    pub fn new(
        args: &Serve,
        case: Case,
        checkpoint: PathBuf,
        recording: Option<Recording>,
        console: Console,
    ) -> Self {
        Self {
            console,
            case,
            choices: Choices::from(&args.overrides),
            beds: args.beds.beds.clone(),
            checkpoint,
            every: args.checkpoint_every,
            recording,
            written: Instant::now(),
            durable: None,
            aside: Aside::new(console),
        }
    }

    /// The case with other choices, and its bed.
    fn prepare(&self, ask: &Init) -> Outcome<(Case, Component)> {
        let asked = Choices::named(ask.seed, ask.schedule.as_deref())
            .map_err(|e| Failure::Usage(e.to_string()))?;
        let choices = asked.or(self.choices);
        let (text, name) = (self.case.text.clone(), &self.case.plan.name);
        let case = case::parse(text, name, &choices, self.console)?;
        let component = served(&case, &self.beds, self.console)?;
        Ok((case, component))
    }

    fn recorded(&mut self, act: impl FnOnce(&mut Recording) -> Outcome) {
        let Some(recording) = &mut self.recording else { return };
        let result = act(recording);
        if !self.aside.went_well("recording", result) {
            self.recording = None;
        }
    }
}

impl Host for Keeper {
    fn keep(&mut self, lockstep: &Lockstep) -> bool {
        if !lockstep.is_configured() {
            return false;
        }
        let place = lockstep.place();
        let at = (place.run_id, place.seq, place.now_ns);
        if self.durable.as_ref() == Some(&at) {
            return true;
        }
        let result = kept::write(&self.checkpoint, &self.case, lockstep);
        self.written = Instant::now();
        let kept = self.aside.went_well("checkpoint", result);
        if kept {
            let path = &self.checkpoint;
            self.console.event("checkpoint", json!({ "seq": at.1, "time_ns": at.2, "path": path }));
            self.durable = Some(at);
        }
        kept
    }

    fn computed(
        &mut self,
        lockstep: &Lockstep,
        kind: WindowKind,
        request: &AdvanceRequest,
        reply: &AdvanceReply,
    ) -> bool {
        // A redo leads elsewhere with the same number.
        self.durable = None;
        self.recorded(|recording| recording.window(lockstep, kind, request, reply));
        self.written.elapsed() >= self.every && self.keep(lockstep)
    }

    fn changed(&mut self) {
        self.durable = None;
    }

    fn taken_elsewhere(&mut self, lockstep: &Lockstep) {
        self.durable = None;
        let case = self.case.clone();
        self.recorded(|recording| recording.part(&case, lockstep));
    }

    fn init(&mut self, ask: &Init) -> Result<Component, Fault> {
        let prepared = self.prepare(ask).map_err(|failure| {
            let code = if interrupt::requested() { Code::Quitting } else { Code::InitFailed };
            Fault::new(code, format!("init: {failure}"))
        });
        let (case, component) = prepared?;
        (self.case, self.durable) = (case, None);
        Ok(component)
    }

    fn note(&mut self, text: &str) {
        self.console.note(text);
        self.console.event("note", json!({ "text": text }));
    }

    fn is_stopped(&self) -> bool {
        interrupt::requested()
    }
}
