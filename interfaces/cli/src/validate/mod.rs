//! Checks with known answers that take longer than unit tests do.
//!
//! Contract: expected values come from exact laws or publications, never from this program; a check that fails
//! is told as failed. Everything but times is the same in every run.

mod check;
mod collapse;
mod cycle;
mod dice;
mod exact;
mod heaps;
mod samples;
mod several;
mod size;
mod world;

pub use check::{Check, Verdict};
pub use size::Size;

use crate::console::Console;
use crate::exit::{Failure, Outcome};
use crate::interrupt;
use crate::plot::Page;
use crate::table::{Table, figure, on_threads};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

type Simple = fn(&Size, Console) -> Outcome<Check>;

/// The checks that need no folders, by the names that choose them.
const SIMPLE: [(&str, Simple); 7] = [
    ("incline", exact::incline),
    ("column", exact::column),
    ("arch", exact::arch),
    ("dice", dice::dice),
    ("collapse", collapse::collapse),
    ("repose", heaps::repose),
    ("silo", heaps::silo),
];
const CYCLE: &str = "cycle";
const SAMPLES: &str = "samples";

/// The names of all checks.
pub fn names() -> impl Iterator<Item = &'static str> {
    SIMPLE.into_iter().map(|(name, _)| name).chain([CYCLE, SAMPLES])
}

/// Refuses names that are of no check, or of one that lacks its `samples`.
pub fn expect_known(only: &[String], samples: Option<&Path>) -> Outcome {
    if let Some(name) = only.iter().find(|name| !names().any(|n| n == *name)) {
        let known: Vec<&str> = names().collect();
        let expected = known.join(", ");
        return Err(Failure::Usage(format!("--only: expected one of {expected}, found {name}")));
    }
    if samples.is_none() && only.iter().any(|name| name == SAMPLES) {
        let text =
            "--only samples: expected a folder of samples to compare with (--samples), found none";
        return Err(Failure::Usage(text.into()));
    }
    Ok(())
}

/// Runs the checks of the names `only`, all if there are none; `samples`: the folder of LMGC90's states.
pub fn checks(
    size: Size,
    only: &[String],
    beds: &Path,
    samples: Option<&Path>,
    console: Console,
) -> Outcome<Vec<Check>> {
    let wanted = |name: &str| only.is_empty() || only.iter().any(|n| n == name);
    let mut done: Vec<Check> = Vec::new();
    for (_, check) in SIMPLE.into_iter().filter(|(name, _)| wanted(name)) {
        timed(&mut done, console, || Ok(vec![check(&size, console)?]))?;
    }
    if wanted(CYCLE) {
        timed(&mut done, console, || Ok(cycle::cycle(&size, beds, console)?.to_vec()))?;
    }
    if let Some(folder) = samples.filter(|_| wanted(SAMPLES)) {
        timed(&mut done, console, || Ok(vec![samples::samples(folder)?]))?;
    }
    Ok(done)
}

fn timed(
    done: &mut Vec<Check>,
    console: Console,
    work: impl FnOnce() -> Outcome<Vec<Check>>,
) -> Outcome {
    let start = Instant::now();
    let mut found = work()?;
    // Checks of one run share its time.
    let seconds = start.elapsed().as_secs_f64() / found.len().max(1) as f64;
    for check in &mut found {
        check.seconds = seconds;
        console.event("check", check.json());
        let verdict = match check.failed() {
            0 => "passed".to_string(),
            n => format!("{n} figures FAILED"),
        };
        console.note(&format!("{}: {verdict}, {seconds:.1} s", check.name));
    }
    done.extend(found);
    Ok(())
}

/// To be called in each step of a check: ends it if the person asked to stop.
fn heed_interrupts() -> Outcome {
    if interrupt::requested() {
        return Err(Failure::Interrupted("stopped inside a check; nothing is kept".into()));
    }
    Ok(())
}

/// Names or numbers in a sentence.
fn listed<T: ToString>(items: &[T]) -> String {
    let words: Vec<String> = items.iter().map(T::to_string).collect();
    match &words[..] {
        [first @ .., last] if !first.is_empty() => format!("{} and {last}", first.join(", ")),
        _ => words.concat(),
    }
}

/// Number of figures with a verdict.
pub fn count(checks: &[Check], verdict: Verdict) -> usize {
    checks.iter().flat_map(|c| &c.findings).filter(|f| f.verdict == verdict).count()
}

/// Everything, for programs.
pub fn json(size: Size, checks: &[Check]) -> Value {
    json!({
        "program": concat!("ballast ", env!("CARGO_PKG_VERSION")), "quick": size.quick,
        "passed": count(checks, Verdict::Passed), "failed": count(checks, Verdict::Failed),
        "checks": checks.iter().map(Check::json).collect::<Vec<_>>(),
    })
}

/// The figures of a check.
pub fn table(check: &Check) -> Table {
    let mut table = Table::new(&check.name, ["measured", "expected", "tolerance", "verdict"]);
    for finding in &check.findings {
        table.row([
            finding.quantity.clone(),
            figure(finding.measured, finding.digits),
            finding.expected.clone(),
            finding.tolerance.clone(),
            finding.verdict.word().into(),
        ]);
    }
    table
}

/// Everything, for people.
pub fn page(size: Size, checks: &[Check]) -> Page {
    let mut page = Page::new("Validation of Ballast");
    let extent = if size.quick { "quick" } else { "full" };
    let seconds: f64 = checks.iter().map(|c| c.seconds).sum();
    let number = |verdict| count(checks, verdict).to_string();
    page.text(concat!("ballast ", env!("CARGO_PKG_VERSION"), ": checks with known answers."));
    page.cards(&[
        ["passed".into(), number(Verdict::Passed), "figures within their tolerance".into()],
        ["failed".into(), number(Verdict::Failed), "figures beyond it".into()],
        ["told".into(), number(Verdict::Told), "figures without a bound".into()],
        [
            "time".into(),
            format!("{seconds:.0} s"),
            format!("{extent}, wall, {}", on_threads(rayon::current_num_threads())),
        ],
    ]);
    for check in checks {
        page.heading(&check.name);
        page.text(&check.what);
        page.note(&format!("Expected: {}.", check.origin));
        page.table(&table(check));
        check.charts.iter().for_each(|chart| page.figure(chart));
        page.note(&check.remark);
        page.note(&format!("{:.1} s", check.seconds));
    }
    page
}
