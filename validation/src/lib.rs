//! Validation suite: checks with known answers that take longer than unit tests.
//!
//! Contract: expected values come from exact laws or publications, never from this program. Everything but times is equal
//! in every run.

mod box_test;
mod case_run;
mod check;
mod collapse;
mod cycle;
mod exact_laws;
mod heaps;
mod lmgc90_samples;
mod packing;
mod samples_progress;
mod shear_box;
mod specimen;
mod suite_size;
mod triaxial;
mod world;

pub use check::{CheckVerdict, KnownDeviation, ValidationCheck};
pub use suite_size::SuiteSize;

use ballast_report::plot::HtmlPage;
use ballast_session::Reporter;
use ballast_session::interrupt;
use ballast_session::table::{TextTable, figure, on_threads};
use ballast_session::{Failure, Result};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Instant;

/// ValidationCheck without further inputs.
type CheckFn = fn(&SuiteSize, &dyn Reporter) -> Result<ValidationCheck>;

/// Checks that need no folders, by name.
const CHECKS: [(&str, CheckFn); 9] = [
    ("incline", exact_laws::incline),
    ("column", exact_laws::column),
    ("arch", exact_laws::arch),
    ("packing", packing::packing),
    ("collapse", collapse::collapse),
    ("repose", heaps::repose),
    ("silo", heaps::silo),
    ("shear", shear_box::shear),
    ("triaxial", triaxial::triaxial),
];
const BOX: &str = "box";
const CYCLE: &str = "cycle";
const SAMPLES: &str = "samples";

/// Names of all checks.
pub fn names() -> impl Iterator<Item = &'static str> {
    CHECKS.into_iter().map(|(name, _)| name).chain([BOX, CYCLE, SAMPLES])
}

/// Checks that the folder of samples is given if the check `samples` is requested.
///
/// # Errors
/// A missing folder.
pub fn check_inputs(only: &[String], samples: Option<&Path>) -> Result {
    if samples.is_none() && only.iter().any(|name| name == SAMPLES) {
        let text = "--only samples: expected a folder of samples (--samples), found none";
        return Err(Failure::Usage(text.into()));
    }
    Ok(())
}

/// Findings of all checks.
pub struct ValidationReport {
    size: SuiteSize,
    /// Checks that have been run.
    pub checks: Vec<ValidationCheck>,
    /// True if all requested checks are in it.
    complete: bool,
}

/// Runs the checks named in `only`, or all if it is empty.
///
/// `samples` is the folder of LMGC90's states. `on_check` receives the report after each check.
///
/// # Errors
/// A check that cannot be computed, an interrupt, or an error of `on_check`.
pub fn checks(
    size: SuiteSize,
    only: &[String],
    beds: &Path,
    samples: Option<&Path>,
    console: &dyn Reporter,
    mut on_check: impl FnMut(&ValidationReport) -> Result,
) -> Result<ValidationReport> {
    type CheckTask<'a> = Box<dyn Fn() -> Result<Vec<ValidationCheck>> + 'a>;
    let size = &size;
    let mut all: Vec<(&str, CheckTask)> = Vec::new();
    for (name, check) in CHECKS {
        all.push((name, Box::new(move || Ok(vec![check(size, console)?]))));
    }
    all.push((BOX, Box::new(|| Ok(vec![box_test::box_test(size, beds, console)?]))));
    all.push((CYCLE, Box::new(|| Ok(cycle::cycle(size, beds, console)?.to_vec()))));
    if let Some(folder) = samples {
        all.push((SAMPLES, Box::new(|| Ok(vec![lmgc90_samples::compare(folder)?]))));
    }
    all.retain(|(name, _)| only.is_empty() || only.iter().any(|n| n == name));
    let mut report = ValidationReport { size: *size, checks: vec![], complete: false };
    for (k, (_, work)) in all.iter().enumerate() {
        report.checks.extend(timed(console, work)?);
        report.complete = k + 1 == all.len();
        on_check(&report)?;
    }
    Ok(report)
}

fn timed(
    console: &dyn Reporter,
    work: impl FnOnce() -> Result<Vec<ValidationCheck>>,
) -> Result<Vec<ValidationCheck>> {
    let start = Instant::now();
    let mut found = work()?;
    // Checks of one run share its time.
    let seconds = start.elapsed().as_secs_f64() / found.len().max(1) as f64;
    for check in &mut found {
        check.seconds = seconds;
        console.event("check", check.json());
        let [failed, known] =
            [CheckVerdict::Failed, CheckVerdict::KnownDeviation].map(|v| check.count(v));
        let verdict = match (failed, known) {
            (0, 0) => "passed".to_string(),
            (0, n) => format!("passed, {n} known deviations"),
            (n, _) => format!("{n} figures FAILED"),
        };
        console.note(&format!("{}: {verdict}, {seconds:.1} s", check.name));
    }
    Ok(found)
}

/// Returns an error if a stop was requested; called in each step of a check.
fn check_interrupt() -> Result {
    if interrupt::requested() {
        return Err(Failure::Interrupted(
            "stopped inside a check; the results of earlier checks are kept".into(),
        ));
    }
    Ok(())
}

/// Joins items with commas and "and".
fn listed<T: ToString>(items: &[T]) -> String {
    let words: Vec<String> = items.iter().map(T::to_string).collect();
    match &words[..] {
        [first @ .., last] if !first.is_empty() => format!("{} and {last}", first.join(", ")),
        _ => words.concat(),
    }
}

/// Returns the findings of a check as a table.
pub fn table(check: &ValidationCheck) -> TextTable {
    let mut table = TextTable::new(&check.name, ["measured", "expected", "tolerance", "verdict"]);
    for finding in &check.findings {
        table.row([
            finding.quantity.clone(),
            figure(finding.measured, finding.digits),
            finding.expected.clone(),
            finding.tolerance.clone(),
            match (&finding.known, finding.verdict) {
                (Some(known), CheckVerdict::KnownDeviation) => {
                    format!("known deviation, up to {}", figure(known.largest, 2))
                }
                (_, verdict) => verdict.word().into(),
            },
        ]);
    }
    table
}

impl ValidationReport {
    /// Returns the number of findings with a verdict.
    pub fn count(&self, verdict: CheckVerdict) -> usize {
        self.checks.iter().map(|check| check.count(verdict)).sum()
    }

    /// Returns the report as JSON.
    pub fn json(&self) -> Value {
        json!({
            "program": concat!("ballast ", env!("CARGO_PKG_VERSION")),
            "quick": self.size.quick, "complete": self.complete,
            "passed": self.count(CheckVerdict::Passed), "failed": self.count(CheckVerdict::Failed),
            "known_deviations": self.count(CheckVerdict::KnownDeviation),
            "checks": self.checks.iter().map(ValidationCheck::json).collect::<Vec<_>>(),
        })
    }

    /// Returns the report as a page.
    pub fn page(&self) -> HtmlPage {
        let mut page = HtmlPage::new("Validation of Ballast");
        let extent = if self.size.quick { "quick" } else { "full" };
        let seconds: f64 = self.checks.iter().map(|c| c.seconds).sum();
        let number = |verdict| self.count(verdict).to_string();
        page.text(concat!("ballast ", env!("CARGO_PKG_VERSION"), ": checks with known answers."));
        if !self.complete {
            page.text("Unfinished: further checks have not been run.");
        }
        page.cards(&[
            [
                "passed".into(),
                number(CheckVerdict::Passed),
                "figures within their tolerance".into(),
            ],
            [
                "known deviations".into(),
                number(CheckVerdict::KnownDeviation),
                "figures beyond their tolerance by no more than is documented".into(),
            ],
            [
                "failed".into(),
                number(CheckVerdict::Failed),
                "figures beyond their tolerance and what is documented".into(),
            ],
            [
                "informational".into(),
                number(CheckVerdict::Informational),
                "figures without a bound".into(),
            ],
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
            for finding in
                check.findings.iter().filter(|f| f.verdict == CheckVerdict::KnownDeviation)
            {
                let reason = finding.known.as_ref().map_or("", |known| &known.reason);
                page.note(&format!("Known deviation, {}: {reason}", finding.quantity));
            }
            check.charts.iter().for_each(|chart| page.figure(chart));
            page.note(&check.remark);
            page.note(&format!("{:.1} s", check.seconds));
        }
        page
    }
}
