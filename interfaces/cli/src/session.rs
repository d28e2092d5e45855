//! The run of a case from its bed or from a checkpoint, or the replay of a recording: steps, records,
//! checkpoints.
//!
//! Contract: what is written depends on the case and the step alone, never on where the run was
//! interrupted; so a resumed run leaves the same records as one in a single go. What is written beside
//! them never ends a run, see [`Aside`].

use crate::aside::Aside;
use crate::case::{self, Case, CaseOverrides};
use crate::console::Console;
use crate::dump::Dump;
use crate::engine::Engine;
use crate::exit::{Failure, Outcome};
use crate::files::{replace_text, shell_word};
use crate::interrupt;
use crate::profile::Profile;
use crate::progress::{Mark, Progress};
use crate::recorder::Recorder;
use crate::summary_text;
use crate::table::on_threads;
use crate::taping::{self, Taping};
use ballast::component;
use ballast::step::StepReport;
use ballast::workspace::Workspace;
use ballast_hdf5::checkpoint::{self, Checkpoint, Kind};
use ballast_session::machine;
use ballast_session::run_files::RunFiles;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A run in progress.
pub struct Session {
    console: Console,
    case: Case,
    files: RunFiles,
    engine: Engine,
    recorder: Recorder,
    taping: Option<Taping>,
    /// The recording, once it is whole.
    recorded: Option<PathBuf>,
    dump: Option<Dump>,
    /// Of recording and problems.
    aside: Aside,
    profile: Profile,
    /// Step at which this process took over.
    first: u64,
    /// Whether the recording that is replayed had no further step.
    is_over: bool,
}

impl Session {
    /// Starts a run or a replay, recorded to the file `record` if there is one: what an earlier one left
    /// in the folder is replaced. What cannot take a step, is over already or cannot be recorded is to be refused before.
    pub fn begin(
        case: Case,
        engine: Engine,
        files: RunFiles,
        record: Option<&Path>,
        console: Console,
    ) -> Outcome<Self> {
        let taping = record.map(|path| Taping::create(path, &case, &engine)).transpose()?;
        if taping.is_some() {
            taping::warn_unless_repeatable(&case, console);
        }
        files.remove_all()?;
        let mut recorder = Recorder::create(&files, &case, engine.model(), engine.state())?;
        recorder.observe(engine.model(), engine.state(), &Workspace::default())?;
        Ok(Self::assemble(case, engine, files, recorder, taping, console))
    }

    /// Takes a run up at its checkpoint, to go on up to step `last`, if one is given.
    pub fn resume(path: &Path, last: Option<u64>, console: Console) -> Outcome<Self> {
        // What is no checkpoint of a run leaves nothing in its folder.
        resumable(path)?;
        let files = RunFiles::beside(path).locked("wait for it")?;
        // Again: up to here another process may have gone on with it.
        let kept = resumable(path)?;
        let choices = CaseOverrides::from_notes(&kept.extra)?;
        let case = case::parse(kept.case_text, &kept.case_name, &choices, &console)?;
        let (model, state) = (kept.model, kept.state);
        expect_ahead(last, state.step)?;
        let cycle = machine::cycle(&case, &model, &state)?;
        let recorder = Recorder::reopen(&files, &case, &model, &state)?;
        let engine = Engine::machine(model, state, cycle);
        Ok(Self::assemble(case, engine, files, recorder, None, console))
    }

    fn assemble(
        case: Case,
        engine: Engine,
        files: RunFiles,
        recorder: Recorder,
        taping: Option<Taping>,
        console: Console,
    ) -> Self {
        let (profile, first) = (Profile::start(), engine.state().step);
        let (recorded, dump, aside) = (None, None, Aside::new(console));
        Self {
            console,
            case,
            files,
            engine,
            recorder,
            taping,
            recorded,
            dump,
            aside,
            profile,
            first,
            is_over: false,
        }
    }

    /// The same session, which keeps contact problems.
    pub fn dumping(self, dump: Option<Dump>) -> Self {
        Self { dump, ..self }
    }

    /// Runs up to step `last` of the run, or the end of case or recording, and sums up.
    pub fn run(mut self, last: Option<u64>, expected: Option<u128>) -> Outcome {
        let last = last.unwrap_or(u64::MAX).min(self.end().unwrap_or(u64::MAX));
        let goal = last.min(self.whole());
        self.announce(goal);
        let steps = goal.saturating_sub(self.first).max(1) as f64;
        let mut progress = Progress::start(self.console, &self.case.plan.name);
        while self.engine.state().step < last {
            self.profile.output();
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
            let step = self.engine.state().step;
            if step == self.first + 1 {
                // It is about the steps before.
                self.files.remove_end()?;
            }
            let share = ((step - self.first) as f64 / steps).min(1.0);
            progress.advance(share, &self.mark(&report, &progress));
            if interrupt::requested() && step < last {
                progress.finish();
                return self.stop();
            }
            let due = self.is_due(self.case.plan.run.checkpoint_ns);
            if step < last && due && self.engine.playback().is_none() {
                self.checkpoint()?;
            }
        }
        progress.finish();
        self.finish(expected)
    }

    /// Steps of the whole: of the recording, where its end is known or told, or of the case.
    fn whole(&self) -> u64 {
        let told = || Some(self.step_at(self.engine.playback()?.told_end_ns()?));
        self.end().or_else(told).unwrap_or(self.case.steps())
    }

    /// The last step of case or recording, where it is known.
    fn end(&self) -> Option<u64> {
        match self.engine.playback() {
            None => Some(self.case.steps()),
            Some(_) if self.is_over => Some(self.engine.state().step),
            Some(playback) => Some(self.step_at(playback.end_ns()?)),
        }
    }

    /// The last step that ends by a time that is not over.
    fn step_at(&self, time_ns: u64) -> u64 {
        let (state, step_ns) = (self.engine.state(), self.engine.model().stepping.step_ns);
        state.step + time_ns.saturating_sub(state.time_ns) / step_ns.max(1)
    }

    /// Takes a step and records it; `None` where the recording that is replayed ends.
    fn step(&mut self) -> Outcome<Option<StepReport>> {
        let stepped = self.engine.step(&mut self.profile).map_err(|e| {
            let (step, folder) = (self.engine.state().step, self.files.folder.display());
            e.with(&format!("; the records up to step {step} are kept in {folder}"))
        })?;
        let Some(stepped) = stepped else { return Ok(None) };
        let engine = &self.engine;
        let (model, state, workspace) = (engine.model(), engine.state(), engine.workspace());
        self.recorder.step(model, state, &stepped.report, engine.phase())?;
        let due = self.is_due(self.case.plan.run.output_ns);
        if due {
            self.recorder.observe(model, state, workspace)?;
        }
        if let Some(dump) = &self.dump {
            let kept = dump.step(&self.case.plan.name, engine);
            if !self.aside.went_well("problems", kept) {
                self.dump = None;
            }
        }
        if let Some(taping) = &mut self.taping {
            let zones = due.then(|| self.recorder.zones());
            let recorded = taping.step(&self.engine, &stepped, zones);
            if !self.aside.went_well("recording", recorded) {
                self.taping = None;
            }
        }
        Ok(Some(stepped.report))
    }

    /// Whether something that happens every `interval` (ns) of simulated time is due. The end of
    /// the case is always due: what it shows must not depend on the interval.
    fn is_due(&self, interval: u64) -> bool {
        let state = self.engine.state();
        let ended = state.step == self.case.steps();
        ended || (interval > 0 && state.time_ns.is_multiple_of(interval))
    }

    fn mark(&self, report: &StepReport, progress: &Progress) -> RunMark {
        let state = self.engine.state();
        let simulated = (state.step - self.first) as f64 * self.engine.model().stepping.h();
        RunMark {
            step: state.step,
            time: state.time(),
            phase: self.engine.phase().name().to_string(),
            contacts: report.contacts,
            iterations: report.iterations,
            residual: report.residuals.qm16(),
            pace: progress.elapsed().as_secs_f64() / simulated,
        }
    }

    fn announce(&self, last: u64) {
        let (name, grains) = (&self.case.plan.name, self.engine.model().grains.len());
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
    fn checkpoint(&mut self) -> Outcome {
        self.recorder.secure()?;
        let (model, state) = (self.engine.model(), self.engine.state());
        let kept = self.case.checkpoint(model, state, BTreeMap::new());
        let path = self.files.checkpoint();
        checkpoint::write(&path, &kept)?;
        crate::panic_hook::set_checkpoint(path.clone());
        self.console.event("checkpoint", json!({ "step": self.engine.state().step, "path": path }));
        Ok(())
    }

    fn stop(mut self) -> Outcome {
        self.end_recording();
        let (step, all) = (self.engine.state().step, self.case.steps());
        let text = if self.engine.playback().is_some() {
            self.recorder.secure()?;
            format!("stopped after step {step}; a replay starts from the beginning again")
        } else {
            self.checkpoint()?;
            let path = shell_word(self.files.checkpoint());
            format!("stopped cleanly after step {step} of {all}; go on with: ballast resume {path}")
        };
        Err(match self.aside.trouble() {
            Some(failure) => failure.with(&format!("; {text}")),
            None => Failure::Interrupted(text),
        })
    }

    fn end_recording(&mut self) {
        if let Some(taping) = self.taping.take() {
            let ended = taping.finish().map(|path| self.recorded = Some(path));
            self.aside.went_well("recording", ended);
        }
    }

    fn finish(mut self, expected: Option<u128>) -> Outcome {
        self.recorder.observe_end(self.engine.model(), self.engine.state());
        let mut damage = None;
        match self.engine.playback() {
            None => self.checkpoint()?,
            Some(playback) => {
                // No checkpoint: `resume` would hand the bodies over to the machine of the case.
                if let Some(lost) = playback.lost() {
                    let path = playback.path();
                    match lost.is_cut {
                        true => self.console.warning(&format!("{}: {lost}", path.display())),
                        false => damage = Some(Failure::at(path, format!("it is damaged: {lost}"))),
                    }
                }
                self.recorder.secure()?;
            }
        }
        self.end_recording();
        self.profile.output();
        let state = self.engine.hash();
        let hash = format!("{state:032x}");
        let summary = self.summary(&hash);
        replace_text(&self.files.summary(), &format!("{summary:#}\n"))?;
        if self.engine.state().step == self.first {
            self.console.note("nothing was left to be computed");
        }
        self.console.event("done", summary);
        self.console.result(&self.text(&hash));
        match expected {
            Some(expected) if expected != state => Err(Failure::Mismatch(format!(
                "the final state has hash {hash}, expected {expected:032x}"
            ))),
            _ => damage.or(self.aside.trouble()).map_or(Ok(()), Err),
        }
    }

    /// Whether this is the end of the case, or of a recording that is whole.
    fn is_complete(&self) -> bool {
        let lost = self.engine.playback().and_then(|playback| playback.lost());
        lost.is_none() && self.engine.state().step == self.whole()
    }

    fn summary(&self, hash: &str) -> Value {
        let mut summary = json!({
            "case": self.case.plan.name, "grains": self.engine.model().grains.len(),
            "state_hash": hash, "complete": self.is_complete(),
        });
        let timing = self.timing_of_before(hash).unwrap_or_else(|| {
            json!({
                "from_step": self.first, "threads": rayon::current_num_threads(),
                "wall_s": self.profile.steps().wall.as_secs_f64(), "phases": self.profile.json(),
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

    /// What the summary that is there says of the time this state took, where nothing was computed since.
    fn timing_of_before(&self, hash: &str) -> Option<Value> {
        if self.engine.state().step > self.first {
            return None;
        }
        let mut summary = self.files.read_summary()?;
        (summary["state_hash"] == hash).then(|| summary["timing"].take())
    }

    fn text(&self, hash: &str) -> String {
        let figures = summary_text::text(self.recorder.summary());
        let (step, time) = (self.engine.state().step, self.engine.state().time());
        let profile = match step - self.first {
            0 => String::new(),
            steps => summary_text::profile(&self.profile, steps),
        };
        let is_resumable = self.engine.playback().is_none();
        let (frames, recorded) = (self.case.plan.run.output_ns > 0, self.recorded.as_deref());
        let files = summary_text::pointers(&self.files, frames, is_resumable, recorded);
        let (name, grains) = (&self.case.plan.name, self.engine.model().grains.len());
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
fn resumable(path: &Path) -> Outcome<Checkpoint> {
    let kept = checkpoint::read(path)?;
    if kept.kind != Kind::Run {
        let what = format!(
            "it is a {}, not the checkpoint of a run; start from it with `ballast run CASE`",
            kept.kind.name()
        );
        return Err(Failure::at(path, what));
    }
    if case::is_served(&kept) {
        let what = "it is of a run that others drive; go on with `ballast serve CASE --resume`";
        return Err(Failure::at(path, what));
    }
    if component::is_remembered(&kept.state) {
        let what = format!(
            "its run was stepped through the component (from Python); go on there with `ballast.resume({:?})`",
            path.display().to_string()
        );
        return Err(Failure::at(path, what));
    }
    Ok(kept)
}

/// Refuses to end at step `last`, if one is given, where more are `done`: before anything of them is replaced or cut.
pub fn expect_ahead(last: Option<u64>, done: u64) -> Outcome {
    match last {
        Some(last) if last < done => Err(Failure::Usage(format!(
            "--steps {last}: expected at least {done}, the steps that are done"
        ))),
        _ => Ok(()),
    }
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
