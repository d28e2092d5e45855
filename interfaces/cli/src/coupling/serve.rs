//! `ballast serve CASE --key SITE/ID`: serves a bed whose bodies are moved by another program.

use super::args::ServeArgs;
use super::host::{ServedRun, served};
use super::served_checkpoint;
use super::served_recording::{self, ServedRecording};
use crate::case::{self, CaseOverrides};
use crate::case_run;
use crate::console::{self, Console};
use crate::interrupt;
use ballast_foxglove::{LiveViewServer, ViewerAddress};
use ballast_protocol::lockstep::Lockstep;
use ballast_session::run_files::RunFiles;
use ballast_session::{Failure, Reporter, Result};
use ballast_zenoh::{Keys, Server, ServerHooks, SessionConfig};
use serde_json::json;
use std::path::Path;

pub fn serve(args: ServeArgs, console: Console) -> Result {
    super::log::install();
    interrupt::install()?;
    console::stop_blocking(console);
    // Checked before a folder is created.
    Keys::of(&args.key)?;
    let config = args.endpoints.to_listen();
    config.listen_endpoints()?;
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
    // Opened before the bed is prepared: a port or key in use is reported at once, and clients may be waiting.
    let mut server = Server::open(&args.key, &config)?;
    server.ensure_unique()?;
    if let Some(endpoint) = &args.viewer {
        // Viewers connect to this endpoint; a client of a router would not listen on it.
        let viewers = SessionConfig { listen: vec![endpoint.clone()], router: None, ..config };
        server = server.with_viewer(&viewers, args.viewer_interval)?;
    }
    let endpoints = server.endpoints();
    console.note(&format!("{}: {}", args.key, listening_text(endpoints)));
    let live_view = args.foxglove.as_ref().map(|at| start_live_view(at, &args.key, console));
    let live_view = live_view.transpose()?;
    let url = live_view.as_ref().map(LiveViewServer::url);
    console.event("serving", json!({ "key": args.key, "endpoints": endpoints, "foxglove": url }));
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
    // Checked again before files are replaced: preparing the bed may have taken long.
    server.ensure_unique()?;
    if server.is_isolated_by_router() {
        console.warning(
            "connected to a router, which forwards nothing between two peers: only its clients find this component; use \
             --router instead of --connect",
        );
    }
    let recording = ServedRecording::create(args.record.as_deref(), resumes, &case, &lockstep)?;
    if recording.is_some() {
        case_run::warn_unless_repeatable(&case, console);
    }
    let mut served_run = ServedRun::new(&args, case, checkpoint, recording, live_view, console);
    // A component that is killed before its first checkpoint resumes as the same run.
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

fn start_live_view(address: &ViewerAddress, key: &str, console: Console) -> Result<LiveViewServer> {
    let live_view = LiveViewServer::start(address, key);
    let live_view = live_view.map_err(|e| Failure::Transport(e.to_string()))?;
    console.note(&format!("live view for Foxglove: {}", live_view.url()));
    if !address.is_loopback() {
        console.warning(
            "--foxglove: other computers can watch the run, without password or encryption; to keep it private, use \
             127.0.0.1 and a tunnel",
        );
    }
    Ok(live_view)
}

fn listening_text(endpoints: &[String]) -> String {
    match endpoints {
        [] => "connected as client; not listening".into(),
        all => format!("listening on {}", all.join(", ")),
    }
}

fn finish(lockstep: &Lockstep, served_run: &ServedRun, console: Console) -> Result {
    let position = lockstep.position();
    if !lockstep.is_configured() {
        console.result("no bed was prepared: no client has requested `init`");
        return if interrupt::requested() {
            Err(Failure::Interrupted("stopped before a bed was prepared".into()))
        } else {
            Ok(())
        };
    }
    let time_s = position.now_ns as f64 / 1e9;
    console.event(
        "done",
        json!({
            "run_id": position.run_id, "seq": position.seq, "time_s": time_s, "state_hash": position.hash,
            "windows": lockstep.computed_windows(),
        }),
    );
    let checkpoint = served_run.checkpoint.display();
    console.result(&format!(
        "run {}: window {}, {time_s:.4} s\nstate hash  {}\ncheckpoint  {checkpoint}",
        position.run_id, position.seq, position.hash
    ));
    if interrupt::requested() {
        let text = "stopped cleanly; continue with the same command and --resume";
        return Err(Failure::Interrupted(text.into()));
    }
    Ok(())
}
