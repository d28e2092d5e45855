//! `ballast report RUN`: HTML report of a run.

use crate::console::Console;
use crate::files::{PAGE_START, begins_with, check_replaceable, replace_text};
use ballast_report::{self as report, ReportSource};
use ballast_session::{Failure, Reporter, Result};
use clap::Args;
use serde_json::json;
use std::path::PathBuf;

#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Folder of a run, or a file in it; needs the checkpoint, which a replay does not leave
    pub run: PathBuf,
    /// Page to write (default: report.html in the folder of the run)
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Add the bed in 3D, to be turned and played in a browser (28 bytes per body and frame)
    #[arg(long)]
    pub scene: bool,
}

pub fn report(args: ReportArgs, console: Console) -> Result {
    let files = report::run_files(&args.run)?;
    let path = args.out.unwrap_or_else(|| files.report());
    check_replaceable(&path, "a page", || begins_with(&path, PAGE_START.as_bytes()))
        .map_err(|e| Failure::at(&path, e))?;
    let source = ReportSource::open(&files, &console).map_err(|e| files.explain_read_failure(e))?;
    let html = report::page(&source, args.scene)?.html();
    replace_text(&path, &html)?;
    console.event("report", json!({ "path": path, "bytes": html.len() }));
    console.result(&format!("report of {}: {}", source.case.plan.name, path.display()));
    Ok(())
}
