//! `ballast replay FILE`: run of a case whose bodies follow a recording.

use crate::args::{ReplayArgs, TimeName};
use crate::case::{self, Case, CaseOverrides};
use crate::case_run::{self, CaseRun};
use crate::console::Console;
use crate::files::expect_different;
use crate::{beds, interrupt, recording_start};
use ballast::component::TampingDriver;
use ballast::model::Model;
use ballast::state::State;
use ballast_mcap::motion::{self, RecordedMotion, TimeSource};
use ballast_mcap::recording::{self, WindowReader};
use ballast_session::body_overlap;
use ballast_session::case_stepper::CaseStepper;
use ballast_session::driver::{RunDriver, tamping_driver};
use ballast_session::recording_driver::RecordingDriver;
use ballast_session::run_files::RunFiles;
use ballast_session::{Failure, Reporter, Result};
use std::path::Path;

pub fn replay(args: ReplayArgs, console: Console) -> Result {
    interrupt::install()?;
    expect_different(&[("the recording", Some(&args.file)), ("--record", args.record.as_deref())])?;
    // Before the bed is prepared, so that a wrong file is reported at once.
    let is_ours = recording::is_recording(&args.file)?;
    let ours = is_ours.then(|| WindowReader::open(&args.file)).transpose()?;
    let (windows, posed) = if args.map.is_empty() { (ours, None) } else { (None, ours) };
    if windows.is_some() && (args.allow_jump || args.time.is_some()) {
        let text = format!(
            "{}: --time and --allow-jump apply to poses; this recording contains the windows of a run (use its poses \
             with --map TOPIC=BODY)",
            args.file.display()
        );
        return Err(Failure::Usage(text));
    }
    let choices = CaseOverrides::from(&args.overrides);
    let case = match (&windows, &posed, args.case.as_deref()) {
        (Some(windows), _, given) => case::recorded(windows, given, choices, &console)?,
        (None, _, Some(given)) => case::load(given, &choices, &console)?,
        (None, Some(posed), None) => case::recorded(posed, None, choices, &console)?,
        (None, None, None) => {
            let text = "--case: expected the case with the bodies, found none";
            return Err(Failure::Usage(format!("{}: {text}", args.file.display())));
        }
    };
    let folder = format!("{}-replay", case.plan.name);
    let folder = args.out.clone().unwrap_or(Path::new("runs").join(folder));
    let files = RunFiles::create_in(folder)?;
    if !args.force {
        files.refuse_unfinished("choose another folder with --out, or replace it with --force")?;
        files.refuse_another(&case.text)?;
        files.refuse_run()?;
    }
    files.refuse_own(&args.file)?;
    files.check_recording(args.record.as_deref())?;
    let source = match windows {
        Some(windows) => {
            check_windows(&args, &case, &windows)?;
            ReplaySource::Windows(Box::new(windows))
        }
        None => ReplaySource::Poses(poses(&args, &case, posed.is_some(), console)?),
    };
    let (model, state) = beds::scene(&case, &args.beds.bed_cache, &console)?;
    // Cycle at the beginning of the case, wherever the recording starts.
    let cycle = tamping_driver(&case, &model, &state)?;
    let (model, state, recording) = match source {
        ReplaySource::Windows(windows) => {
            let (model, state) = recording_start::initial_scene(&windows, &case, model, state)?;
            let recording = own(*windows, &model, &state, console);
            (model, state, recording)
        }
        ReplaySource::Poses(motion) => {
            let recording = RecordingDriver::from_motion(&args.file, motion, args.allow_jump);
            (model, state, recording)
        }
    };
    // Before an earlier replay is removed.
    let run = replay_session(&args, &case, (model, state), cycle, recording)?;
    let session = CaseRun::begin(case, run, files, args.record.as_deref(), console)?;
    session.run(args.stop.steps, args.stop.expect_hash)
}

/// Source of the motions.
enum ReplaySource {
    Windows(Box<WindowReader>),
    Poses(RecordedMotion),
}

/// Creates the session, and checks that the recording covers the first step if one is requested.
fn replay_session(
    args: &ReplayArgs,
    case: &Case,
    (model, state): (Model, State),
    cycle: TampingDriver,
    recording: RecordingDriver,
) -> Result<CaseStepper> {
    let driver = RunDriver::Recording { recording: Box::new(recording), cycle };
    let mut run = CaseStepper::new(case, model, state, driver)?;
    case_run::expect_ahead(args.stop.steps, run.state().step)?;
    if args.stop.steps != Some(run.state().step) {
        run.check_first_step()?;
    }
    Ok(run)
}

fn own(windows: WindowReader, model: &Model, state: &State, console: Console) -> RecordingDriver {
    let found = format!("{:032x}", ballast_hdf5::state_hash(model, state));
    if windows.meta().initial_hash.to_string() != found {
        console.note(
            "the recording belongs to another case, bed or solver: its motions are replayed, results will \
             differ",
        );
    }
    RecordingDriver::from_windows(windows)
}

/// Checks the start of a recording of windows on the scene without grains, so that a refusal costs no bed.
fn check_windows(args: &ReplayArgs, case: &Case, windows: &WindowReader) -> Result {
    let (model, state) = ballast_beds::empty_scene(&case.plan)?;
    if windows.start().is_some() {
        return recording_start::check_case(windows, case, &model);
    }
    // Only the prepared bed shows whether damage has cut off the start, and where a lowered plate is.
    if windows.truncation().is_some() || case.plan.has_lowered_plates() {
        return Ok(());
    }
    let cycle = tamping_driver(case, &model, &state)?;
    let recording = RecordingDriver::from_windows(WindowReader::open(&args.file)?);
    replay_session(args, case, (model, state), cycle, recording).map(drop)
}

/// Warns if poses of mounted bodies are replayed: they include the deflection of the mounts.
fn warn_of_mounts(args: &ReplayArgs, model: &Model, console: Console) {
    let yields =
        |name: &String| model.driven.iter().any(|body| body.name == *name && body.mount.is_some());
    let bent: Vec<&str> = args
        .map
        .iter()
        .map(|map| &map.body)
        .filter(|body| yields(body))
        .map(String::as_str)
        .collect();
    if !bent.is_empty() {
        console.warning(&format!(
            "{}: expected prescribed motions, found poses of {} that include the deflection of their mounts; omit \
             --map to replay the motions of the mounts",
            args.file.display(),
            bent.join(", ")
        ));
    }
}

/// Reads the motions of a recording of poses; reports errors that do not depend on the bed before its preparation.
fn poses(
    args: &ReplayArgs,
    case: &Case,
    of_ours: bool,
    console: Console,
) -> Result<RecordedMotion> {
    let (model, state) = ballast_beds::empty_scene(&case.plan)?;
    if of_ours {
        warn_of_mounts(args, &model, console);
    }
    let bodies: Vec<String> = model.driven.iter().map(|d| d.name.clone()).collect();
    let time = match args.time {
        None | Some(TimeName::Stamp) => TimeSource::Stamp,
        Some(TimeName::Log) => TimeSource::Log,
    };
    let motion = motion::read(&args.file, &bodies, &args.map, time, state.time_ns)?;
    for note in &motion.notes {
        console.note(note);
    }
    for warning in &motion.warnings {
        console.warning(&format!("{}: {warning}", args.file.display()));
    }
    // Only the prepared bed shows where a lowered plate is.
    if case.plan.has_lowered_plates() {
        return Ok(motion);
    }
    let overlap = body_overlap::overlap_warning(&model, &state, &motion.inputs, motion.end_ns);
    if let Some(warning) = overlap {
        console.warning(&format!("{}: {warning}", args.file.display()));
    }
    let recording = RecordingDriver::from_motion(&args.file, motion.clone(), args.allow_jump);
    let cycle = tamping_driver(case, &model, &state)?;
    replay_session(args, case, (model, state), cycle, recording)?;
    Ok(motion)
}
