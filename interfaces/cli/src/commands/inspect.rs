//! `ballast inspect FILE`: summary of a bed, checkpoint or results file.

use super::expected_file::ExpectedFile;
use crate::args::InspectArgs;
use crate::console::Console;
use ballast_session::run_files::RunFiles;
use ballast_session::{Reporter, Result};

pub fn inspect(args: InspectArgs, console: Console) -> Result {
    let file = ExpectedFile::Any.find(&args.file)?;
    let summary = ballast_hdf5::inspect::inspect(&file);
    let summary = summary.map_err(|e| RunFiles::beside(&file).explain_read_failure(e.into()))?;
    console.result(&summary.to_string());
    console.event("file", summary.to_json());
    Ok(())
}
