//! `ballast report RUN`: a page about a run.

use crate::args::Report;
use crate::console::Console;
use crate::exit::Outcome;
use crate::files::{RunFiles, replace_text};
use crate::report::{self, Source};
use serde_json::json;

pub fn report(args: Report, console: Console) -> Outcome {
    let source = Source::open(&args.run, console)?;
    let html = report::page(&source)?.html();
    let files = if args.run.is_dir() {
        RunFiles::in_folder(&args.run)
    } else {
        RunFiles::beside(&args.run)
    };
    let path = args.out.unwrap_or_else(|| files.folder.join("report.html"));
    replace_text(&path, &html)?;
    console.event("report", json!({ "path": path, "bytes": html.len() }));
    console.result(&format!("report of {}: {}", source.case.plan.name, path.display()));
    Ok(())
}
