//! `ballast export`: tables and shapes of results, or a case as a co-simulation unit.

use super::expected_file::ExpectedFile;
use crate::args::{ExportArgs, ExportCommand, ExportFmuArgs, ExportTablesArgs, FmiName};
use crate::beds;
use crate::case::{self, CaseOverrides};
use crate::console::Console;
#[cfg(feature = "zenoh")]
use crate::coupling::args::Endpoints;
use crate::files::{begins_with, check_replaceable};
use crate::interrupt;
use ballast_fmu::bed::UnitBed;
use ballast_fmu::package::{FmiVersion, LIBRARY_FILE, served_unit_bytes, unit_bytes};
use ballast_fmu::served_unit::{ServedEndpoints, ServedUnit};
use ballast_hdf5::Error;
use ballast_session::run_files::RunFiles;
use ballast_session::{Failure, Reporter, Result};
use serde_json::json;
use std::path::{Path, PathBuf};

pub fn export(args: ExportArgs, console: Console) -> Result {
    match (args.command, args.tables) {
        (Some(ExportCommand::Fmu(args)), _) => export_units(&args, console),
        (None, Some(args)) => export_tables(&args, console),
        (None, None) => Err(Failure::Usage("export: expected a results file, found none".into())),
    }
}

fn export_tables(args: &ExportTablesArgs, console: Console) -> Result {
    let results = ExpectedFile::Results.find(&args.results)?;
    let run = RunFiles::beside(&results);
    let files = ballast_hdf5::export::export(&results, &args.out);
    let files = files.map_err(|e| match e {
        Error::Io { .. } => e.into(),
        _ => run.explain_read_failure(e.into()),
    })?;
    let count = files.len();
    console.result(&format!("{count} files written to {}", args.out.display()));
    console.event("exported", json!({ "folder": args.out, "files": files }));
    Ok(())
}

fn export_units(args: &ExportFmuArgs, console: Console) -> Result {
    interrupt::install()?;
    let units = units(args);
    // Checked before the bed is prepared, which may take long.
    for (path, _) in &units {
        let is_archive = || begins_with(path, b"PK");
        check_replaceable(path, "a unit (.fmu)", is_archive).map_err(|e| Failure::at(path, e))?;
    }
    let server = server(args)?;
    let library = library(args.library.as_deref())?;
    let choices = CaseOverrides::from(&args.overrides);
    let case = case::load(&args.case, &choices, &console)?;
    let (model, state) = beds::scene(&case, &args.beds.bed_cache, &console)?;
    let bed = UnitBed::new(model, state, case.text.clone(), case.overrides);
    let bed = bed.map_err(|e| case::invalid(&case, e))?;
    let served = server.map(|(component, endpoints)| ServedUnit::new(&bed, component, endpoints));
    for (path, version) in &units {
        let bytes = match &served {
            Some(served) => served_unit_bytes(&bed, served, &library, *version),
            None => unit_bytes(&bed, &library, *version),
        };
        let bytes = bytes.map_err(|e| Failure::at(path, e))?;
        ballast_hdf5::replace(path, &[&bytes])?;
        console.result(&format!("written: {}", path.display()));
    }
    let files: Vec<&Path> = units.iter().map(|(path, _)| path.as_path()).collect();
    console.event("exported", json!({ "files": files }));
    Ok(())
}

/// Returns name and endpoints of the component that computes the bed; `None` for a unit with its bed inside.
#[cfg(feature = "zenoh")]
fn server(args: &ExportFmuArgs) -> Result<Option<(String, ServedEndpoints)>> {
    use ballast_zenoh::{Keys, SessionConfig};

    let Endpoints { connect, router, listen, config } = args.server.endpoints.clone();
    let Some(component) = &args.server.served else {
        let is_without = connect.is_empty() && listen.is_empty() && router.is_none();
        return match config {
            None if is_without => Ok(None),
            _ => Err(Failure::Usage(
                "export fmu: expected --served SITE/ID beside endpoints, found none; name the component".into(),
            )),
        };
    };
    Keys::of(component)?;
    // The file may only exist where the importer runs; the endpoints are checked.
    let session = SessionConfig { config: None, ..args.server.endpoints.to_connect() };
    session.listen_endpoints()?;
    // The importer runs in another folder.
    let config = config.map(std::path::absolute).transpose();
    let config = config.map_err(|e| Failure::Usage(format!("--config: {e}")))?;
    Ok(Some((component.clone(), ServedEndpoints { connect, listen, router, config })))
}

/// Returns no component: this program has no network.
#[cfg(not(feature = "zenoh"))]
fn server(_args: &ExportFmuArgs) -> Result<Option<(String, ServedEndpoints)>> {
    Ok(None)
}

/// Returns the units to write with their versions.
fn units(args: &ExportFmuArgs) -> Vec<(PathBuf, FmiVersion)> {
    let named = |suffix: &str| {
        let stem = args.out.file_stem().unwrap_or_default().to_string_lossy();
        args.out.with_file_name(format!("{stem}{suffix}.fmu"))
    };
    match args.fmi {
        FmiName::Two => vec![(args.out.clone(), FmiVersion::Two)],
        FmiName::Three => vec![(args.out.clone(), FmiVersion::Three)],
        FmiName::Both => {
            vec![(named("_fmi2"), FmiVersion::Two), (named("_fmi3"), FmiVersion::Three)]
        }
    }
}

/// Reads the library of units: the given one, or the newest of those installed or built with the program.
fn library(given: Option<&Path>) -> Result<Vec<u8>> {
    let path = match given {
        Some(path) => path.to_path_buf(),
        None => {
            let program = std::env::current_exe().unwrap_or_default();
            let folder = program.parent().unwrap_or(Path::new("."));
            // Cargo leaves libraries that it builds for other packages in `deps`; wheels install to `bin` and `lib/ballast`.
            let folders = [folder.into(), folder.join("deps"), folder.join("../lib/ballast")];
            let places = folders.map(|folder| folder.join(LIBRARY_FILE));
            let built =
                |path: &PathBuf| Some((path.metadata().ok()?.modified().ok()?, path.clone()));
            let newest = places.iter().filter_map(built).max();
            newest.ok_or_else(|| no_library(&places[0]))?.1
        }
    };
    std::fs::read(&path).map_err(|e| Failure::at(&path, e))
}

fn no_library(expected: &Path) -> Failure {
    let expected = expected.display();
    Failure::Failed(format!(
        "expected the library of units at {expected}, found none; build it with `cargo build --release --locked -p ballast-fmi` \
         and give it with --library target/release/{LIBRARY_FILE}"
    ))
}
