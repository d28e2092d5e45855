//! `ballast report RUN`: a page about a run.

use crate::args::Report;
use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::files::{begins_with, replace_text};
use crate::plot::BEGINNING;
use crate::report::{self, Source};
use serde_json::json;
use std::path::Path;

/// Refuses a path where something else than a page lies: a slip of the command line is not to cost results.
fn may_become_a_page(path: &Path) -> Outcome {
    let Ok(what) = path.metadata() else { return Ok(()) };
    if what.is_file() && (what.len() == 0 || begins_with(path, BEGINNING.as_bytes())?) {
        return Ok(());
    }
    Err(Failure::at(path, "expected a new file, or a page to replace, found something else"))
}

pub fn report(args: Report, console: Console) -> Outcome {
    let files = report::of_run(&args.run)?;
    let path = args.out.unwrap_or_else(|| files.folder.join("report.html"));
    may_become_a_page(&path)?;
    let source = Source::open(&files, console)?;
    let html = report::page(&source)?.html();
    replace_text(&path, &html)?;
    console.event("report", json!({ "path": path, "bytes": html.len() }));
    console.result(&format!("report of {}: {}", source.case.plan.name, path.display()));
    Ok(())
}
