//! `ballast inspect FILE`: what a bed, checkpoint or results file holds.

use crate::args::Inspect;
use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::files::{RunFiles, begins_with};
use std::path::Path;

pub fn inspect(args: Inspect, console: Console) -> Outcome {
    if let Some(how) = of_another_kind(&args.file, "a bed, a checkpoint or results") {
        return Err(Failure::at(&args.file, how));
    }
    let summary = ballast_hdf5::inspect::inspect(&args.file);
    let summary = summary.map_err(|e| RunFiles::beside(&args.file).unread(e.into()))?;
    console.result(&summary.to_string());
    console.event("file", summary.to_json());
    Ok(())
}

/// What a file is that Ballast writes, too, but that is not what is `expected`, which HDF5 holds.
pub fn of_another_kind(path: &Path, expected: &str) -> Option<String> {
    let begins = |words: &[u8]| begins_with(path, words);
    let found = match () {
        () if begins(b"\x89MCAP0") => "a recording; `ballast verify` and `ballast replay` read it",
        () if begins(b"{") => "text (JSON), such as a summary or a sample",
        () => return None,
    };
    Some(format!("expected {expected}, found {found}"))
}
