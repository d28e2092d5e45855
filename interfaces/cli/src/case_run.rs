//! The run of a case from its bed or from a checkpoint, or the replay of a recording: steps, records,
//! checkpoints.
//!
//! Contract: what is written depends on the case and the step alone, never on where the run was
//! interrupted; so a resumed run leaves the same records as one in a single go. What is written beside
//! them never ends a run, see [`NonFatalErrors`].

use crate::case::{self, Case, CaseOverrides};
use crate::checkpoint_timer::CheckpointTimer;
use crate::console::Console;
use crate::files::{replace_text, shell_word};
use crate::interrupt;
use crate::nonfatal_errors::NonFatalErrors;
use crate::problem_dump::ProblemDump;
use crate::progress::ConsoleProgress;
use crate::recorder::Recorder;
use crate::summary_text;
use crate::table::on_threads;
use ballast::component::{DrivenWindow, measure_zones};
use ballast::model::Schedule;
use ballast::step::StepReport;
use ballast::track::{TampingCycle, TampingPhase};
use ballast::workspace::Workspace;
use ballast_hdf5::checkpoint::{self, Checkpoint, Kind};
use ballast_mcap::Drive;
use ballast_protocol::lockstep::WindowKind;
use ballast_session::case_stepper::CaseStepper;
use ballast_session::driver::{RunDriver, RunObserver, tamping_driver};
use ballast_session::run_files::RunFiles;
use ballast_session::run_recorder::RunRecorder;
use ballast_session::{Failure, ProgressLabel, ProgressMeter, Reporter, Result};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A run in progress.
pub struct CaseRun {
    console: Console,
    case: Case,
    files: RunFiles,
    run: CaseStepper,
    recorder: Recorder,
    recording: Option<RunRecorder>,
    /// The recording, once it is whole.
    recorded: Option<PathBuf>,
    /// Phase of the cycle in the last step.
    phase: TampingPhase,
    dump: Option<ProblemDump>,
    /// Errors of the recording and of the problem dump, which do not end the run.
    errors: NonFatalErrors,
    observer: RunObserver,
    /// Step at which this process took over.
    first: u64,
    /// True if the replayed recording has no further step.
    is_over: bool,
    /// Wall time since the last checkpoint; `None` writes none between those of the case.
    checkpoint_timer: Option<CheckpointTimer>,
}

impl CaseRun {
    /// Starts a run or a replay, recorded to the file `record` if there is one: what an earlier one left
    /// in the folder is replaced. What cannot take a step, is over already or cannot be recorded is to be refused before.
    pub fn begin(
        case: Case,
        run: CaseStepper,
        files: RunFiles,
        record: Option<&Path>,
        console: Console,
    ) -> Result<Self> {
        let recording = record.map(|path| begin_recording(path, &case, &run)).transpose()?;
        if recording.is_some() {
            warn_unless_repeatable(&case, console);
        }
        files.remove_all()?;
        let mut recorder = Recorder::create(&files, &case, run.model(), run.state())?;
        recorder.observe(run.model(), run.state(), &Workspace::default())?;
        Ok(Self::assemble(case, run, files, recorder, recording, console))
    }

    /// Resumes a run from its checkpoint, up to step `last` if one is given.
    pub fn resume(path: &Path, last: Option<u64>, console: Console) -> Result<Self> {
        // What is no checkpoint of a run leaves nothing in its folder.
        resumable(path)?;
        let files = RunFiles::beside(path).locked("wait for it")?;
        // Again: up to here another process may have gone on with it.
        let saved = resumable(path)?;
        let choices = CaseOverrides::from_notes(&saved.extra)?;
        let case = case::parse(saved.case_text, &saved.case_name, &choices, &console)?;
        let (model, state) = (saved.model, saved.state);
        expect_ahead(last, state.step)?;
        let driver = RunDriver::Cycle(tamping_driver(&case, &model, &state)?);
        let recorder = Recorder::reopen(&files, &case, &model, &state)?;
        let run = CaseStepper::new(&case, model, state, driver)?;
        Ok(Self::assemble(case, run, files, recorder, None, console))
    }

    fn assemble(
        case: Case,
        run: CaseStepper,
        files: RunFiles,
        recorder: Recorder,
        recording: Option<RunRecorder>,
        console: Console,
    ) -> Self {
        let (first, phase) = (run.state().step, run.phase());
        let (recorded, dump, errors) = (None, None, NonFatalErrors::new(console));
        Self {
            console,
            case,
            files,
            run,
            recorder,
            recording,
            recorded,
            phase,
            dump,
            errors,
            observer: RunObserver::start(),
            first,
            is_over: false,
            checkpoint_timer: None,
        }
    }

    /// Returns the session with a checkpoint after every `interval` of wall time.
    pub fn with_checkpoint_interval(self, interval: Duration) -> Self {
        Self { checkpoint_timer: Some(CheckpointTimer::start(interval)), ..self }
    }

    /// Returns the session with `dump`, which writes contact problems to files.
    pub fn dumping(self, dump: Option<ProblemDump>) -> Self {
        Self { dump, ..self }
    }

    /// Runs up to step `last` of the run, or the end of case or recording, and sums up.
    pub fn run(mut self, last: Option<u64>, expected: Option<u128>) -> Result {
        let last = last.unwrap_or(u64::MAX).min(self.end().unwrap_or(u64::MAX));
        let goal = last.min(self.whole());
        self.announce(goal);
        let steps = goal.saturating_sub(self.first).max(1) as f64;
        let mut progress = ConsoleProgress::start(self.console, &self.case.plan.name);
        while self.run.state().step < last {
            self.observer.profile.output();
            let report = match self.step() {
                Ok(Some(report)) => report,
                Ok(None) => {
                    self.is_over = true;
                    break;
                }
                Err(Failure::Interrupted(_)) => {
                    progress.finish();
                    return self.stop();
                }
                Err(failure) => return Err(failure),
            };
            let step = self.run.state().step;
            if step == self.first + 1 {
                // It is about the steps before.
                self.files.remove_end()?;
            }
            let share = ((step - self.first) as f64 / steps).min(1.0);
            progress.advance(share, &self.progress_label(&report, &progress));
            if interrupt::requested() && step < last {
                progress.finish();
                return self.stop();
            }
            let is_old = self.checkpoint_timer.as_ref().is_some_and(CheckpointTimer::is_due);
            let due = is_old || self.is_due(self.case.plan.run.checkpoint_ns);
            if step < last && due && self.run.recording().is_none() {
                self.checkpoint()?;
            }
        }
        progress.finish();
        self.finish(expected)
    }

    /// Returns the number of steps of the recording if its end is known or stated, otherwise that of the case.
    fn whole(&self) -> u64 {
        let stated = || Some(self.step_at(self.run.recording()?.stated_end_ns()?));
        self.end().or_else(stated).unwrap_or(self.case.steps())
    }

    /// The last step of case or recording, where it is known.
    fn end(&self) -> Option<u64> {
        match self.run.recording() {
            None => Some(self.case.steps()),
            Some(_) if self.is_over => Some(self.run.state().step),
            Some(recording) => Some(self.step_at(recording.end_ns()?)),
        }
    }

    /// The last step that ends by a time that is not over.
    fn step_at(&self, time_ns: u64) -> u64 {
        let (state, step_ns) = (self.run.state(), self.run.model().stepping.step_ns);
        state.step + time_ns.saturating_sub(state.time_ns) / step_ns.max(1)
    }

    /// Takes a step and records it; `None` where the recording that is replayed ends.
    fn step(&mut self) -> Result<Option<StepReport>> {
        let stepped = self.run.step(&mut self.observer).map_err(|e| {
            let (step, folder) = (self.run.state().step, self.files.folder.display());
            e.with(&format!("; the records up to step {step} are kept in {folder}"))
        })?;
        let Some((window, report)) = stepped else { return Ok(None) };
        let run = &self.run;
        let (model, state, workspace) = (run.model(), run.state(), run.component().workspace());
        let phase = run.phase();
        self.recorder.step(model, state, &report, phase)?;
        let due = self.is_due(self.case.plan.run.output_ns);
        if due {
            self.recorder.observe(model, state, workspace)?;
        }
        if let Some(dump) = &self.dump {
            let saved = dump.step(&self.case.plan.name, run);
            if !self.errors.report("problems", saved) {
                self.dump = None;
            }
        }
        if let Some(recording) = &mut self.recording {
            let DrivenWindow { inputs, mut result } = window;
            if due {
                result.zones = measure_zones(model, state, self.recorder.zones());
            }
            let component = run.component();
            let recorded = recording.window(component, WindowKind::Advance, &inputs, &result);
            let recorded = recorded.and_then(|()| {
                if phase == self.phase {
                    return Ok(());
                }
                recording.log(state.time_ns, &format!("phase: {}", phase.name()))
            });
            if !self.errors.report("recording", recorded.map_err(Failure::from)) {
                self.recording = None;
            }
        }
        self.phase = phase;
        Ok(Some(report))
    }

    /// Returns true if an output with `interval` (ns) of simulated time is due. Each output is due at the end of the
    /// case, so that the final results do not depend on the interval.
    fn is_due(&self, interval: u64) -> bool {
        let state = self.run.state();
        let ended = state.step == self.case.steps();
        ended || (interval > 0 && state.time_ns.is_multiple_of(interval))
    }

    fn progress_label(&self, report: &StepReport, progress: &ConsoleProgress) -> RunProgressLabel {
        let state = self.run.state();
        let simulated = (state.step - self.first) as f64 * self.run.model().stepping.h();
        RunProgressLabel {
            step: state.step,
            time: state.time(),
            phase: self.run.phase().name().to_string(),
            contacts: report.contacts,
            iterations: report.iterations,
            residual: report.residuals.qm16(),
            pace: progress.elapsed().as_secs_f64() / simulated,
        }
    }

    fn announce(&self, last: u64) {
        let (name, grains) = (&self.case.plan.name, self.run.model().grains.len());
        let threads = rayon::current_num_threads();
        let workers = on_threads(threads);
        self.console
            .note(&format!("{name}: {grains} grains, steps {} to {last}, {workers}", self.first));
        self.console.event(
            "start",
            json!({
                "case": name, "grains": grains, "step": self.first, "last_step": last,
                "threads": threads, "folder": self.files.folder,
            }),
        );
    }

    /// Writes the checkpoint; all records that it relies on are handed over first.
    fn checkpoint(&mut self) -> Result {
        self.recorder.secure()?;
        let (model, state) = (self.run.model(), self.run.state());
        let saved = self.case.checkpoint(model, state, BTreeMap::new());
        let path = self.files.checkpoint();
        checkpoint::write(&path, &saved)?;
        self.checkpoint_timer.iter_mut().for_each(CheckpointTimer::restart);
        crate::panic_hook::set_checkpoint(path.clone());
        self.console.event("checkpoint", json!({ "step": self.run.state().step, "path": path }));
        Ok(())
    }

    fn stop(mut self) -> Result {
        self.end_recording();
        let (step, all) = (self.run.state().step, self.case.steps());
        let text = if self.run.recording().is_some() {
            self.recorder.secure()?;
            format!("stopped after step {step}; a replay starts from the beginning again")
        } else {
            self.checkpoint()?;
            let path = shell_word(self.files.checkpoint());
            format!(
                "stopped cleanly after step {step} of {all}; continue with: ballast resume {path}"
            )
        };
        Err(match self.errors.first_error() {
            Some(failure) => failure.with(&format!("; {text}")),
            None => Failure::Interrupted(text),
        })
    }

    fn end_recording(&mut self) {
        if let Some(recording) = self.recording.take() {
            let ended = recording.finish().map(|path| self.recorded = Some(path));
            self.errors.report("recording", ended.map_err(Failure::from));
        }
    }

    fn finish(mut self, expected: Option<u128>) -> Result {
        self.recorder.observe_end(self.run.model(), self.run.state());
        let mut damage = None;
        match self.run.recording() {
            None => self.checkpoint()?,
            Some(recording) => {
                // No checkpoint: `resume` would hand the bodies over to the machine of the case.
                if let Some(lost) = recording.lost() {
                    let path = recording.path();
                    match lost.is_cut {
                        true => self.console.warning(&format!("{}: {lost}", path.display())),
                        false => damage = Some(Failure::at(path, format!("it is damaged: {lost}"))),
                    }
                }
                self.recorder.secure()?;
            }
        }
        self.end_recording();
        self.observer.profile.output();
        let state = self.run.hash();
        let hash = format!("{state:032x}");
        let summary = self.summary(&hash);
        replace_text(&self.files.summary(), &format!("{summary:#}\n"))?;
        if self.run.state().step == self.first {
            self.console.note("nothing was left to be computed");
        }
        self.console.event("done", summary);
        self.console.result(&self.text(&hash));
        if let Some(text) = summary_text::tine_depth_warning(self.recorder.summary()) {
            self.console.warning(&text);
        }
        match expected {
            Some(expected) if expected != state => Err(Failure::Mismatch(format!(
                "the final state has hash {hash}, expected {expected:032x}"
            ))),
            _ => damage.or(self.errors.first_error()).map_or(Ok(()), Err),
        }
    }

    /// Returns true at the end of the case, or at the end of a complete recording.
    fn is_complete(&self) -> bool {
        let lost = self.run.recording().and_then(|recording| recording.lost());
        lost.is_none() && self.run.state().step == self.whole()
    }

    fn summary(&self, hash: &str) -> Value {
        let mut summary = json!({
            "case": self.case.plan.name, "grains": self.run.model().grains.len(),
            "state_hash": hash, "complete": self.is_complete(),
        });
        let timing = self.timing_of_before(hash).unwrap_or_else(|| {
            json!({
                "from_step": self.first, "threads": rayon::current_num_threads(),
                "wall_s": self.observer.profile.steps().wall.as_secs_f64(), "phases": self.observer.profile.json(),
            })
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

    /// Returns the timing of the existing summary if it describes this state and no step was computed since.
    fn timing_of_before(&self, hash: &str) -> Option<Value> {
        if self.run.state().step > self.first {
            return None;
        }
        let mut summary = self.files.read_summary()?;
        (summary["state_hash"] == hash).then(|| summary["timing"].take())
    }

    fn text(&self, hash: &str) -> String {
        let figures = summary_text::text(self.recorder.summary());
        let (step, time) = (self.run.state().step, self.run.state().time());
        let profile = match step - self.first {
            0 => String::new(),
            steps => summary_text::profile(&self.observer.profile, steps),
        };
        let is_resumable = self.run.recording().is_none();
        let (frames, recorded) = (self.case.plan.run.output_ns > 0, self.recorded.as_deref());
        let files = summary_text::pointers(&self.files, frames, is_resumable, recorded);
        let (name, grains) = (&self.case.plan.name, self.run.model().grains.len());
        // A replay may begin within a run.
        let since = match self.recorder.summary().from_step {
            0 => String::new(),
            from => format!(" (figures from step {} on)", from + 1),
        };
        format!(
            "{name}: {grains} grains, {step} of {} steps, {time:.4} s{since}\n\n{figures}\n{profile}\n\
             state hash  {hash}\n\n{files}",
            self.whole()
        )
    }
}

/// The checkpoint of a run that the case's machine drives.
fn resumable(path: &Path) -> Result<Checkpoint> {
    let saved = checkpoint::read(path)?;
    if saved.kind != Kind::Run {
        let what = format!(
            "it is a {}, not the checkpoint of a run; start from it with `ballast run CASE`",
            saved.kind.name()
        );
        return Err(Failure::at(path, what));
    }
    if case::is_served(&saved) {
        let what = "it is of a run that others drive; continue with `ballast serve CASE --resume`";
        return Err(Failure::at(path, what));
    }
    if saved.state.step > 0 && saved.state.driver.kind != TampingCycle::KIND {
        let what = format!(
            "expected a run that the case's tamping cycle moved, found another driver; continue it in Python with `ballast.resume({:?})`",
            path.display().to_string()
        );
        return Err(Failure::at(path, what));
    }
    Ok(saved)
}

/// Refuses to end at step `last`, if one is given, where more are `done`: before anything of them is replaced or cut.
pub fn expect_ahead(last: Option<u64>, done: u64) -> Result {
    match last {
        Some(last) if last < done => Err(Failure::Usage(format!(
            "--steps {last}: expected at least {done}, the steps that are done"
        ))),
        _ => Ok(()),
    }
}

/// Starts the recording of a session.
fn begin_recording(path: &Path, case: &Case, run: &CaseStepper) -> Result<RunRecorder> {
    let drive = match run.recording() {
        Some(recording) if !recording.is_of_the_cycle() => Drive::Inputs,
        _ => Drive::Case,
    };
    let mut recording = RunRecorder::create(path, case, run.component(), drive)?;
    let text = format!("{}: {} grains", case.plan.name, run.model().grains.len());
    recording.log(run.state().time_ns, &text)?;
    Ok(recording)
}

/// Warns where a recording cannot be computed again to the same bytes.
pub fn warn_unless_repeatable(case: &Case, console: Console) {
    if case.plan.run.solver.schedule == Schedule::Asynchronous {
        console.warning("--record: steps are solved asynchronously: `ballast verify` cannot repeat the recording");
    }
}

/// Progress of a run after a step.
struct RunProgressLabel {
    step: u64,
    time: f64,
    phase: String,
    contacts: usize,
    iterations: u32,
    residual: f64,
    /// Wall seconds per simulated second.
    pace: f64,
}

impl ProgressLabel for RunProgressLabel {
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
