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

use ballast_report::plot::Page;
use ballast_session::Reporter;
use ballast_session::interrupt;
use ballast_session::table::{Table, figure, on_threads};
use ballast_session::{Failure, Outcome};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

type Simple = fn(&Size, &dyn Reporter) -> Outcome<Check>;

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

/// What the checks found.
pub struct Report {
    size: Size,
    pub checks: Vec<Check>,
    /// Whether all that were wanted are in it.
    complete: bool,
}

/// Runs the checks of the names `only`, all if there are none; `samples`: the folder of LMGC90's states; `keep` is
/// given what there is after each of them.
pub fn checks(
    size: Size,
    only: &[String],
    beds: &Path,
    samples: Option<&Path>,
    console: &dyn Reporter,
    mut keep: impl FnMut(&Report) -> Outcome,
) -> Outcome<Report> {
    type Work<'a> = Box<dyn Fn() -> Outcome<Vec<Check>> + 'a>;
    let size = &size;
    let mut all: Vec<(&str, Work)> = Vec::new();
    for (name, check) in SIMPLE {
        all.push((name, Box::new(move || Ok(vec![check(size, console)?]))));
    }
    all.push((CYCLE, Box::new(|| Ok(cycle::cycle(size, beds, console)?.to_vec()))));
    if let Some(folder) = samples {
        all.push((SAMPLES, Box::new(|| Ok(vec![samples::samples(folder)?]))));
    }
    all.retain(|(name, _)| only.is_empty() || only.iter().any(|n| n == name));
    let mut report = Report { size: *size, checks: vec![], complete: false };
    for (k, (_, work)) in all.iter().enumerate() {
        report.checks.extend(timed(console, work)?);
        report.complete = k + 1 == all.len();
        keep(&report)?;
    }
    Ok(report)
}

fn timed(
    console: &dyn Reporter,
    work: impl FnOnce() -> Outcome<Vec<Check>>,
) -> Outcome<Vec<Check>> {
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
    Ok(found)
}

/// To be called in each step of a check: ends it if the person asked to stop.
fn heed_interrupts() -> Outcome {
    if interrupt::requested() {
        return Err(Failure::Interrupted(
            "stopped inside a check; those before it are kept".into(),
        ));
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

impl Report {
    /// Number of figures with a verdict.
    pub fn count(&self, verdict: Verdict) -> usize {
        self.checks.iter().flat_map(|c| &c.findings).filter(|f| f.verdict == verdict).count()
    }

    /// Everything, for programs.
    pub fn json(&self) -> Value {
        json!({
            "program": concat!("ballast ", env!("CARGO_PKG_VERSION")),
            "quick": self.size.quick, "complete": self.complete,
            "passed": self.count(Verdict::Passed), "failed": self.count(Verdict::Failed),
            "checks": self.checks.iter().map(Check::json).collect::<Vec<_>>(),
        })
    }

    /// Everything, for people.
    pub fn page(&self) -> Page {
        let mut page = Page::new("Validation of Ballast");
        let extent = if self.size.quick { "quick" } else { "full" };
        let seconds: f64 = self.checks.iter().map(|c| c.seconds).sum();
        let number = |verdict| self.count(verdict).to_string();
        page.text(concat!("ballast ", env!("CARGO_PKG_VERSION"), ": checks with known answers."));
        if !self.complete {
            page.text("Unfinished: the checks that follow these are not done.");
        }
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
        for check in &self.checks {
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
}
