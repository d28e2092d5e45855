//! `ballast serve CASE --key SITE/ID`: the case's bed, moved by another program.

use super::args::ServeArgs;
use super::host::{ServedRun, served};
use super::served_checkpoint;
use super::served_recording::{self, ServedRecording};
use crate::case::{self, CaseOverrides};
use crate::case_run;
use crate::console::{self, Console};
use crate::exit::{Failure, Outcome};
use crate::interrupt;
use ballast_protocol::lockstep::Lockstep;
use ballast_session::run_files::RunFiles;
use ballast_zenoh::{Keys, Server, ServerHooks, SessionConfig};
use serde_json::json;
use std::path::Path;

pub fn serve(args: ServeArgs, console: Console) -> Outcome {
    interrupt::install()?;
    console::stop_blocking(console);
    // Before a folder is made.
    Keys::of(&args.key)?;
    let link = args.endpoints.to_listen();
    link.listen_endpoints()?;
    let given = CaseOverrides::from(&args.overrides);
    let mut case = case::load(&args.case, &given, &console)?;
    let folder = format!("{}-serve", case.plan.name);
    let folder = args.out.clone().unwrap_or(Path::new("runs").join(folder));
    let files = RunFiles::create_in(folder)?;
    args.record.as_deref().map(|path| files.refuse_own(path)).transpose()?;
    let checkpoint = files.checkpoint();
    let resumes = args.resume && checkpoint.exists();
    if resumes {
        case = served_checkpoint::of_the_run(&checkpoint, case, given)?;
    } else {
        served_checkpoint::check_free(&checkpoint, args.force)?;
    }
    let first = args.record.as_deref().map(|path| served_recording::first_part(path, resumes));
    files.check_recording(first.as_deref())?;
    // Before the bed is prepared: a port or a key that is taken is to be told at once, and partners may be waiting.
    let mut server = Server::open(&args.key, &link)?;
    server.ensure_unique()?;
    if let Some(endpoint) = &args.viewer {
        // Those who look come to this endpoint, to which a client of a router does not listen.
        let viewers = SessionConfig { listen: vec![endpoint.clone()], router: None, ..link };
        server = server.with_viewer(&viewers, args.viewer_interval)?;
    }
    let endpoints = server.endpoints();
    console.note(&format!("{}: {}", args.key, told(endpoints)));
    console.event("serving", json!({ "key": args.key, "endpoints": endpoints }));
    let waits = args.defer_init && !resumes;
    let mut lockstep = if waits {
        Lockstep::unconfigured(ballast_hdf5::state_hash).map_err(ballast_zenoh::Error::from)?
    } else {
        let component = served(&case, &args.beds.bed_cache, console)?;
        Lockstep::new(component, served_checkpoint::fresh_run()?, ballast_hdf5::state_hash)
    };
    if resumes {
        served_checkpoint::resume(&checkpoint, &mut lockstep)?;
    }
    // Again before anything is replaced: the bed may have taken its time.
    server.ensure_unique()?;
    if server.is_isolated_by_router() {
        console.warning(
            "connected to a router, which passes on nothing between two peers: only its clients find this component; \
             --router instead of --connect makes it one of them",
        );
    }
    let recording = ServedRecording::create(args.record.as_deref(), resumes, &case, &lockstep)?;
    if recording.is_some() {
        case_run::warn_unless_repeatable(&case, console);
    }
    let mut served_run = ServedRun::new(&args, case, checkpoint, recording, console);
    // A component that dies before its first checkpoint comes back as the same run.
    if !resumes && served_run.write_checkpoint(&lockstep) {
        lockstep.note_durable();
    }
    let lockstep = server.run(lockstep, &mut served_run)?;
    if let Some(recording) = served_run.recording.take() {
        let ended = recording.finish();
        served_run.errors.report("recording", ended);
    }
    let ended = finish(&lockstep, &served_run, console);
    served_run.errors.first_error().map_or(ended, Err)
}

fn told(endpoints: &[String]) -> String {
    match endpoints {
        [] => "connected as client; not listening".into(),
        all => format!("listening on {}", all.join(", ")),
    }
}

fn finish(lockstep: &Lockstep, served_run: &ServedRun, console: Console) -> Outcome {
    let place = lockstep.position();
    if !lockstep.is_configured() {
        console.result("nothing was prepared: nobody has asked for `init`");
        return if interrupt::requested() {
            Err(Failure::Interrupted("stopped before anything was done".into()))
        } else {
            Ok(())
        };
    }
    let time_s = place.now_ns as f64 / 1e9;
    console.event(
        "done",
        json!({
            "run_id": place.run_id, "seq": place.seq, "time_s": time_s, "state_hash": place.hash,
            "windows": lockstep.computed_windows(),
        }),
    );
    let checkpoint = served_run.checkpoint.display();
    console.result(&format!(
        "run {}: window {}, {time_s:.4} s\nstate hash  {}\ncheckpoint  {checkpoint}",
        place.run_id, place.seq, place.hash
    ));
    if interrupt::requested() {
        let text = "stopped cleanly; the same command with --resume goes on";
        return Err(Failure::Interrupted(text.into()));
    }
    Ok(())
}
