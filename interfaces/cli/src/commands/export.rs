//! `ballast export RESULTS --out DIR`: tables and shapes for other programs.

use super::expected_file::ExpectedFile;
use crate::args::ExportArgs;
use crate::console::Console;
use ballast_hdf5::Error;
use ballast_session::run_files::RunFiles;
use ballast_session::{Reporter, Result};
use serde_json::json;

pub fn export(args: ExportArgs, console: Console) -> Result {
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
