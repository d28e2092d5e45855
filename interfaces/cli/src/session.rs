//! The run of a case from its bed or from a checkpoint: steps, records, checkpoints.
//!
//! Contract: what is written depends on the case and the step alone, never on where the run was
//! interrupted; so a resumed run leaves the same records as one in a single go.

use crate::case::{self, Case, Choices};
use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::files::{RunFiles, replace_text};
use crate::interrupt;
use crate::profile::Profile;
use crate::progress::{Mark, Progress};
use crate::recorder::Recorder;
use crate::summary_text;
use ballast::drive::Inputs;
use ballast::model::Model;
use ballast::state::State;
use ballast::step::{StepReport, step};
use ballast::track::TampingCycle;
use ballast::workspace::Workspace;
use ballast_hdf5::checkpoint::{self, Checkpoint, Kind};
use serde_json::{Value, json};
use std::path::Path;

/// A run in progress.
pub struct Session {
    console: Console,
    case: Case,
    files: RunFiles,
    model: Model,
    state: State,
    cycle: TampingCycle,
    workspace: Workspace,
    recorder: Recorder,
    profile: Profile,
    /// Step at which this process took over.
    first: u64,
}

impl Session {
    /// Starts a run: what an earlier one left in the folder is replaced.
    pub fn begin(
        case: Case,
        model: Model,
        state: State,
        files: RunFiles,
        console: Console,
    ) -> Outcome<Self> {
        let cycle = cycle(&case, &model, &state)?;
        files.create_folder()?;
        files.remove_all()?;
        let mut recorder = Recorder::create(&files, &case, &model)?;
        recorder.observe(&model, &state, &Workspace::default())?;
        Ok(Self::assemble(case, model, state, cycle, files, recorder, console))
    }

    /// Takes a run up at its checkpoint.
    pub fn resume(path: &Path, console: Console) -> Outcome<Self> {
        let kept = checkpoint::read(path)?;
        if kept.kind != Kind::Run {
            let what = format!(
                "it is a {}, not the checkpoint of a run; start from it with `ballast run CASE`",
                kept.kind.name()
            );
            return Err(Failure::at(path, what));
        }
        let choices = Choices::from_notes(&kept.extra)?;
        let case = case::parse(kept.case_text, &kept.case_name, &choices, console)?;
        let (model, state) = (kept.model, kept.state);
        let cycle = cycle(&case, &model, &state)?;
        let files = RunFiles::beside(path);
        let recorder = Recorder::reopen(&files, &case, &model, state.step)?;
        Ok(Self::assemble(case, model, state, cycle, files, recorder, console))
    }

    fn assemble(
        case: Case,
        model: Model,
        state: State,
        cycle: TampingCycle,
        files: RunFiles,
        recorder: Recorder,
        console: Console,
    ) -> Self {
        let (workspace, profile, first) = (Workspace::default(), Profile::start(), state.step);
        Self { console, case, files, model, state, cycle, workspace, recorder, profile, first }
    }

    /// Runs up to step `last` of the run, or the case's end, and sums up.
    pub fn run(mut self, last: Option<u64>, expected: Option<&str>) -> Outcome {
        let last = last.unwrap_or(u64::MAX).min(self.case.steps());
        self.announce(last);
        let whole = self.case.steps().max(1) as f64;
        let start = self.state.step as f64 / whole;
        let mut progress = Progress::start(self.console, &self.case.plan.name, start);
        let mut targets = Vec::new();
        while self.state.step < last {
            self.profile.output();
            let report = self.step(&mut targets)?;
            let phase = self.cycle.phase(self.state.time());
            self.recorder.step(&self.model, &self.state, &self.workspace, &report, phase)?;
            if self.is_due(self.case.plan.run.output_ns) {
                self.recorder.observe(&self.model, &self.state, &self.workspace)?;
            }
            progress.advance(
                self.state.step as f64 / whole,
                &self.mark(phase.name(), &report, &progress),
            );
            if interrupt::requested() && self.state.step < last {
                progress.finish();
                return self.stop();
            }
            if self.state.step < last && self.is_due(self.case.plan.run.checkpoint_ns) {
                self.checkpoint()?;
            }
        }
        progress.finish();
        self.finish(expected)
    }

    fn step(&mut self, targets: &mut Vec<ballast::math::Pose>) -> Outcome<StepReport> {
        self.cycle.targets(&self.model, &self.state, targets);
        let inputs = Inputs { targets, loads: &[] };
        let watch = &mut self.profile;
        let report = step(&self.model, &mut self.state, &inputs, &mut self.workspace, watch)
            .map_err(|e| {
                Failure::Failed(format!(
                    "{e}; the records up to step {} are kept in {}",
                    self.state.step,
                    self.files.folder.display()
                ))
            })?;
        self.cycle.observe(&self.model, &report, &mut self.state);
        Ok(report)
    }

    /// Whether something that happens every `interval` (ns) of simulated time is due. The end of
    /// the case is always due: what it shows must not depend on the interval.
    fn is_due(&self, interval: u64) -> bool {
        let ended = self.state.step == self.case.steps();
        ended || (interval > 0 && self.state.time_ns.is_multiple_of(interval))
    }

    fn mark(&self, phase: &str, report: &StepReport, progress: &Progress) -> RunMark {
        let simulated = (self.state.step - self.first) as f64 * self.model.stepping.h();
        RunMark {
            step: self.state.step,
            time: self.state.time(),
            phase: phase.to_string(),
            contacts: report.contacts,
            iterations: report.iterations,
            residual: report.residuals.qm16(),
            pace: progress.elapsed().as_secs_f64() / simulated,
        }
    }

    fn announce(&self, last: u64) {
        let (name, grains) = (&self.case.plan.name, self.model.grains.len());
        let threads = rayon::current_num_threads();
        self.console.note(&format!(
            "{name}: {grains} grains, steps {} to {last}, {threads} threads",
            self.first
        ));
        self.console.event(
            "start",
            json!({
                "case": name, "grains": grains, "step": self.first, "last_step": last,
                "threads": threads, "folder": self.files.folder,
            }),
        );
    }

    /// Writes the checkpoint; all records that it relies on are handed over first.
    fn checkpoint(&mut self) -> Outcome {
        self.recorder.flush()?;
        let kept = Checkpoint {
            model: self.model.clone(),
            state: self.state.clone(),
            kind: Kind::Run,
            case_name: self.case.plan.name.clone(),
            case_text: self.case.text.clone(),
            key: self.case.bed_key(),
            extra: self.case.choices.notes(),
        };
        let path = self.files.checkpoint();
        checkpoint::write(&path, &kept)?;
        self.console.event("checkpoint", json!({ "step": self.state.step, "path": path }));
        Ok(())
    }

    fn stop(mut self) -> Outcome {
        self.checkpoint()?;
        let path = self.files.checkpoint();
        Err(Failure::Interrupted(format!(
            "stopped cleanly after step {} of {}; go on with: ballast resume {}",
            self.state.step,
            self.case.steps(),
            path.display()
        )))
    }

    fn finish(mut self, expected: Option<&str>) -> Outcome {
        self.recorder.observe_end(&self.model, &self.state)?;
        self.checkpoint()?;
        self.profile.output();
        let hash = format!("{:032x}", ballast_hdf5::state_hash(&self.model, &self.state));
        let summary = self.summary(&hash);
        replace_text(&self.files.summary(), &format!("{summary:#}\n"))?;
        self.console.event("done", summary);
        self.console.result(&self.text(&hash));
        match expected {
            Some(expected) if !expected.eq_ignore_ascii_case(&hash) => Err(Failure::Mismatch(
                format!("the final state has hash {hash}, expected {expected}"),
            )),
            _ => Ok(()),
        }
    }

    fn summary(&self, hash: &str) -> Value {
        let mut summary = json!({
            "case": self.case.plan.name, "grains": self.model.grains.len(),
            "state_hash": hash, "complete": self.state.step == self.case.steps(),
        });
        let timing = json!({
            "from_step": self.first, "threads": rayon::current_num_threads(),
            "wall_s": self.profile.steps().wall.as_secs_f64(), "phases": self.profile.json(),
        });
        if let (Some(all), Value::Object(figures)) =
            (summary.as_object_mut(), self.recorder.summary().json())
        {
            all.extend(figures);
            // Apart, because it is the only part that differs between equal runs.
            all.insert("timing".into(), timing);
        }
        summary
    }

    fn text(&self, hash: &str) -> String {
        let figures = summary_text::text(self.recorder.summary());
        let profile = summary_text::profile(&self.profile, self.state.step - self.first);
        let files = summary_text::pointers(&self.files);
        let (name, grains, step) = (&self.case.plan.name, self.model.grains.len(), self.state.step);
        let time = self.state.time();
        format!(
            "{name}: {grains} grains, {step} of {} steps, {time:.4} s\n\n{figures}\n{profile}\n\
             state hash  {hash}\n\n{files}",
            self.case.steps()
        )
    }
}

/// The case's cycle, and whether the state belongs to it.
fn cycle(case: &Case, model: &Model, state: &State) -> Outcome<TampingCycle> {
    let invalid = |e: ballast::Error| Failure::InvalidCase(format!("{}: {e}", case.plan.name));
    let cycle = TampingCycle::new(&case.plan, model).map_err(invalid)?;
    cycle.check_memory(state).map_err(invalid)?;
    Ok(cycle)
}

/// Where a run stands.
struct RunMark {
    step: u64,
    time: f64,
    phase: String,
    contacts: usize,
    iterations: u32,
    residual: f64,
    /// Wall seconds per simulated second.
    pace: f64,
}

impl Mark for RunMark {
    fn text(&self) -> String {
        let Self { step, time, phase, contacts, iterations, residual, pace } = self;
        format!(
            "step {step} · {time:.4} s · {phase} · {contacts} contacts · {iterations} iterations · \
             residual {residual:.1e} · {pace:.0} s per simulated s"
        )
    }

    fn fields(&self) -> Value {
        json!({
            "step": self.step, "time_s": self.time, "phase": self.phase,
            "contacts": self.contacts, "iterations": self.iterations, "residual": self.residual,
            "wall_per_simulated": self.pace,
        })
    }
}
