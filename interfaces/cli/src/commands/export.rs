//! `ballast export RESULTS --out DIR`: tables and shapes that need no HDF5.

use crate::args::Export;
use crate::console::Console;
use crate::exit::Outcome;
use serde_json::json;

pub fn export(args: Export, console: Console) -> Outcome {
    let files = ballast_hdf5::export::export(&args.results, &args.out)?;
    let count = files.len();
    console.result(&format!("{count} files written to {}", args.out.display()));
    console.event("exported", json!({ "folder": args.out, "files": files }));
    Ok(())
}
