//! `ballast inspect FILE`: what a bed, checkpoint or results file holds.

use crate::args::Inspect;
use crate::console::Console;
use crate::exit::Outcome;

pub fn inspect(args: Inspect, console: Console) -> Outcome {
    let summary = ballast_hdf5::inspect::inspect(&args.file)?;
    console.result(&summary.to_string());
    console.event("file", summary.to_json());
    Ok(())
}
