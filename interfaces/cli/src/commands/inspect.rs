//! `ballast inspect FILE`: summary of a bed, checkpoint or results file.

use super::expected_file::ExpectedFile;
use crate::console::Console;
use ballast_hdf5::checkpoint::{self, Checkpoint};
use ballast_hdf5::inspect::{FileSummary, inspect as inspect_file, is_results};
use ballast_session::run_files::RunFiles;
use ballast_session::stones::{stones_json, stones_text};
use ballast_session::{Reporter, Result, zones};
use clap::Args;
use std::path::{Path, PathBuf};

#[derive(Debug, Args)]
pub struct InspectArgs {
    /// Bed, checkpoint or results file, or the folder of a run
    pub file: PathBuf,
}

pub fn inspect(args: InspectArgs, console: Console) -> Result {
    let file = ExpectedFile::Any.find(&args.file)?;
    let found = read(&file).map_err(|e| RunFiles::beside(&file).explain_read_failure(e.into()));
    let (summary, checkpoint) = found?;
    console.result(&summary.to_string());
    let mut fields = summary.to_json();
    if let Some(stones) = &summary.stones {
        console.result(&stones_text(stones));
        fields["stones"] = stones_json(stones);
    }
    if let Some(checkpoint) = checkpoint {
        let zones = zones::measure_stored_zones(&checkpoint).unwrap_or_else(|failure| {
            console.warning(&format!("zones are not measured: {failure}"));
            vec![]
        });
        if !zones.is_empty() {
            console.result(&zones::zones_table(&zones).text());
            fields["zones"] = zones::zones_json(&zones);
        }
    }
    console.event("file", fields);
    Ok(())
}

/// Returns the summary of a file, and its content if it is a bed or checkpoint.
fn read(file: &Path) -> Result<(FileSummary, Option<Checkpoint>), ballast_hdf5::Error> {
    if is_results(file)? {
        return Ok((inspect_file(file)?, None));
    }
    let checkpoint = checkpoint::read(file)?;
    Ok((FileSummary::of_checkpoint(file, &checkpoint), Some(checkpoint)))
}
