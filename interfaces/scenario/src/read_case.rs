//! Reading of a case file: from text to a plan or to all errors.

use crate::case_file::CaseFile;
use crate::diagnostic::{CaseDiagnostic, CaseErrors};
use crate::document::CaseDocument;
use crate::report::DiagnosticReport;
use crate::resolve::resolve;
use crate::schema::schema;
use crate::schema_check;
use ballast::track::plan::Plan;

/// Plan of a case without errors.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckedPlan {
    /// Plan of the scenario.
    pub plan: Plan,
    /// Allowed values that are probably mistakes.
    pub warnings: Vec<CaseDiagnostic>,
}

/// Reads the case file `text`; `name` stands for it in messages. Never panics, whatever the text is.
///
/// # Errors
/// All errors that can be distinguished, in the order of the file.
pub fn read_case(text: &str, name: &str) -> Result<CheckedPlan, CaseErrors> {
    let document = CaseDocument::parse(text, name).map_err(|errors| CaseErrors { errors })?;
    let mut report = DiagnosticReport::new(&document);
    schema_check::check(&mut report, &schema());
    let plan = match toml::from_str::<CaseFile>(text) {
        Ok(case) => Some(resolve(&case, &mut report)),
        Err(error) => {
            add_deserialiser_error(&mut report, &error);
            None
        }
    };
    let DiagnosticReport { mut errors, mut warnings, .. } = report;
    errors.sort_by_key(|e| (e.line, e.column));
    warnings.sort_by_key(|w| (w.line, w.column));
    match plan {
        Some(plan) if errors.is_empty() => Ok(CheckedPlan { plan, warnings }),
        _ => Err(CaseErrors { errors }),
    }
}

/// Adds the deserialiser's own message where the schema check found no error.
fn add_deserialiser_error(report: &mut DiagnosticReport, error: &toml::de::Error) {
    if report.errors.is_empty() {
        let mut diagnostic =
            report.document.diagnostic(error.span().unwrap_or(0..0), String::new());
        diagnostic.problem = error.message().trim().to_string();
        report.errors.push(diagnostic);
    }
}
