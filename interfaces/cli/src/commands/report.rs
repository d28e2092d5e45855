//! `ballast report RUN`: a page about a run.

use crate::args::Report;
use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::files::{PAGE_START, begins_with, may_replace, replace_text};
use ballast_report::{self as report, Source};
use serde_json::json;

pub fn report(args: Report, console: Console) -> Outcome {
    let files = report::of_run(&args.run)?;
    let path = args.out.unwrap_or_else(|| files.report());
    may_replace(&path, "a page", || begins_with(&path, PAGE_START.as_bytes()))
        .map_err(|e| Failure::at(&path, e))?;
    let source = Source::open(&files, &console).map_err(|e| files.unread(e))?;
    let html = report::page(&source)?.html();
    replace_text(&path, &html)?;
    console.event("report", json!({ "path": path, "bytes": html.len() }));
    console.result(&format!("report of {}: {}", source.case.plan.name, path.display()));
    Ok(())
}
