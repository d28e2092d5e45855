//! Reads a case file: text in, plan or all errors out.

use crate::case_file::CaseFile;
use crate::diagnostic::{CaseErrors, Diagnostic};
use crate::document::Document;
use crate::report::Report;
use crate::resolve::resolve;
use crate::structure;
use ballast::track::plan::Plan;

/// A case that was read and found sound.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    pub plan: Plan,
    /// What is allowed but looks like a slip.
    pub warnings: Vec<Diagnostic>,
}

/// Reads the case file `text`; `name` stands for it in messages.
///
/// Returns every error that can be told apart, in the order of the file. Never panics, whatever
/// the text is.
pub fn read_case(text: &str, name: &str) -> Result<Case, CaseErrors> {
    let document = Document::parse(text, name).map_err(|errors| CaseErrors { errors })?;
    let mut report = Report::new(&document);
    structure::check(&mut report, &crate::schema());
    let plan = match toml::from_str::<CaseFile>(text) {
        Ok(case) => Some(resolve(&case, &mut report)),
        Err(error) => {
            unreadable(&mut report, &error);
            None
        }
    };
    let Report { mut errors, mut warnings, .. } = report;
    errors.sort_by_key(|e| (e.line, e.column));
    warnings.sort_by_key(|w| (w.line, w.column));
    match plan {
        Some(plan) if errors.is_empty() => Ok(Case { plan, warnings }),
        _ => Err(CaseErrors { errors }),
    }
}

/// The deserialiser's own complaint, for what the schema cannot tell.
fn unreadable(report: &mut Report, error: &toml::de::Error) {
    if report.errors.is_empty() {
        let mut diagnostic =
            report.document.diagnostic(error.span().unwrap_or(0..0), String::new());
        diagnostic.problem = error.message().trim().to_string();
        report.errors.push(diagnostic);
    }
}
