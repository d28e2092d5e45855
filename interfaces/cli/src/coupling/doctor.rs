//! `ballast doctor`: diagnoses problems that would keep a served component from working, with remedies.

use super::args::DoctorArgs;
use crate::case::{self, CaseOverrides};
use crate::console::Console;
use crate::table::on_threads;
use ballast_hdf5::checkpoint;
use ballast_protocol::lockstep::{ComponentState, empty_model};
use ballast_session::{Failure, Reporter, Result};
use ballast_zenoh::session::free_endpoint;
use ballast_zenoh::{Connection, Server, SessionConfig, Timeouts};
use serde_json::json;
use std::path::Path;
use std::sync::Arc;

pub fn doctor(args: DoctorArgs, console: Console) -> Result {
    super::log::install();
    let mut checks: Vec<(&str, Result<String, String>)> = vec![
        ("processors", Ok(on_threads(rayon::current_num_threads()))),
        ("loopback", loopback()),
        ("endpoint", endpoint(&args)),
        ("beds", writable(&args.beds.bed_cache)),
    ];
    if let Some(path) = &args.case {
        checks.push(("case", case_and_bed(path, &args.beds.bed_cache, console)));
    }
    if let Some(key) = &args.key {
        checks.push(("component", component(key, &args)));
    }
    let bad = checks.iter().filter(|(_, result)| result.is_err()).count();
    for (what, result) in &checks {
        let (word, text) = match result {
            Ok(text) => ("ok", text),
            Err(text) => ("FAILED", text),
        };
        console.event("check", json!({ "what": what, "ok": result.is_ok(), "text": text }));
        console.result(&format!("{what:<12}{word:<8}{text}"));
    }
    match bad {
        0 => Ok(()),
        n => Err(Failure::Failed(format!("{n} of {} checks failed", checks.len()))),
    }
}

/// Checks that two sessions find each other on this machine.
fn loopback() -> Result<String, String> {
    let hint = "a firewall may block connections on the loopback";
    let named = |e: ballast_zenoh::Error| format!("{e}; {hint}");
    let endpoint = free_endpoint().map_err(named)?;
    let _server =
        Server::open("doctor/local", &SessionConfig::listen_on(&endpoint)).map_err(named)?;
    let connection =
        Connection::open("doctor/local", &SessionConfig::connect_to(endpoint), Timeouts::default())
            .map_err(named)?;
    connection.status().map_err(named)?;
    Ok("two Zenoh sessions exchange messages".into())
}

/// Checks that `serve` can listen on its endpoints.
fn endpoint(args: &DoctorArgs) -> Result<String, String> {
    if args.key.is_some() {
        return Ok("not opened: the component to check listens there".into());
    }
    let config = args.endpoints.to_listen();
    let hint = match args.endpoints.router {
        Some(_) => "check that a Zenoh router runs there",
        None => {
            "another component or a Zenoh router may use it; choose another one with `--listen`"
        }
    };
    let server = Server::open("doctor/local", &config).map_err(|e| format!("{e}; {hint}"))?;
    Ok(match server.endpoints() {
        [] => "a session opens".into(),
        all => format!("free: {}", all.join(", ")),
    })
}

/// Checks that HDF5 files can be written and read.
fn writable(folder: &Path) -> Result<String, String> {
    crate::files::create_folder(folder).map_err(|e| e.to_string())?;
    let path = folder.join(format!("doctor-{}.h5", std::process::id()));
    let saved = checkpoint::Checkpoint {
        model: empty_model(),
        state: ballast::state::State::default(),
        kind: checkpoint::Kind::Bed,
        case_name: "doctor".into(),
        case_text: String::new(),
        key: String::new(),
        extra: Default::default(),
    };
    let result = checkpoint::write(&path, &saved).and_then(|()| checkpoint::read(&path));
    let _ = std::fs::remove_file(&path);
    match result {
        Ok(read) if read == saved => Ok(format!("HDF5 files can be saved to {}", folder.display())),
        Ok(_) => Err("an HDF5 file differs after reading".into()),
        Err(e) => Err(e.to_string()),
    }
}

/// Checks that the case is valid and whether its bed is prepared.
fn case_and_bed(path: &Path, beds: &Path, console: Console) -> Result<String, String> {
    let case = case::load(path, &CaseOverrides::default(), &console).map_err(|e| e.to_string())?;
    if !ballast_beds::BedStore::new(beds).path(&case.plan).exists() {
        return Ok(format!("{}: the bed is not prepared yet", case.plan.name));
    }
    let (model, state) = crate::beds::scene(&case, beds, &console).map_err(|e| e.to_string())?;
    let (grains, bodies) = (model.grains.len(), model.driven.len());
    case::component(&case, Arc::new(model), state).map_err(|e| e.to_string())?;
    Ok(format!("{}: {grains} grains, {bodies} driven bodies, bed prepared", case.plan.name))
}

/// Checks that a component replies.
fn component(key: &str, args: &DoctorArgs) -> Result<String, String> {
    let config = args.endpoints.to_connect();
    let connection =
        Connection::open(key, &config, Timeouts::default()).map_err(|e| e.to_string())?;
    let status = connection.status().map_err(|e| {
        format!("{e}; check that `ballast serve` runs with this key and that the endpoints match")
    })?;
    let waits = status.waiting_for.map_or(String::new(), |what| format!(", waiting for {what}"));
    let text = format!("{}{waits}", status.state);
    if status.state == ComponentState::Error { Err(text) } else { Ok(text) }
}
