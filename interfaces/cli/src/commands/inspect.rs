//! `ballast inspect FILE`: what a bed, checkpoint or results file holds.

use super::given::Expected;
use crate::args::InspectArgs;
use crate::console::Console;
use crate::files::RunFiles;
use ballast_session::Result;

pub fn inspect(args: InspectArgs, console: Console) -> Result {
    let file = Expected::Any.file(&args.file)?;
    let summary = ballast_hdf5::inspect::inspect(&file);
    let summary = summary.map_err(|e| RunFiles::beside(&file).unread(e.into()))?;
    console.result(&summary.to_string());
    console.event("file", summary.to_json());
    Ok(())
}
