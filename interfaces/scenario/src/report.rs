//! Errors and warnings about the keys of a document.

use crate::diagnostic::{CaseDiagnostic, DiagnosticText};
use crate::document::CaseDocument;
use std::ops::Range;

/// Maximum number of errors, and of warnings, that are collected.
pub const MAX_DIAGNOSTICS: usize = 100;

/// Errors and warnings found so far.
pub struct DiagnosticReport<'a, 't> {
    pub document: &'a CaseDocument<'t>,
    pub errors: Vec<CaseDiagnostic>,
    pub warnings: Vec<CaseDiagnostic>,
}

impl<'a, 't> DiagnosticReport<'a, 't> {
    pub fn new(document: &'a CaseDocument<'t>) -> Self {
        Self { document, errors: Vec::new(), warnings: Vec::new() }
    }

    /// Adds an error about the key at `path`.
    pub fn error(&mut self, path: &str, text: DiagnosticText) {
        self.error_at(self.document.span(path), path.to_string(), text);
    }

    /// Adds an error about the key at `path` that marks the bytes `span`.
    pub fn error_at(&mut self, span: Range<usize>, path: String, text: DiagnosticText) {
        if !self.is_full() {
            self.errors.push(self.document.diagnostic(span, path).with_text(text));
        }
    }

    /// Adds a warning about the key at `path`.
    pub fn warn(&mut self, path: &str, text: DiagnosticText) {
        if self.warnings.len() < MAX_DIAGNOSTICS {
            let span = self.document.span(path);
            self.warnings.push(self.document.diagnostic(span, path.to_string()).with_text(text));
        }
    }

    /// Returns the first of `keys` that the file has; the first one if it has none.
    pub fn written_key<'k>(&self, keys: &[&'k str]) -> &'k str {
        let written = keys.iter().find(|key| self.document.has(key));
        written.or(keys.first()).copied().unwrap_or_default()
    }

    /// True if further errors are not collected.
    pub fn is_full(&self) -> bool {
        self.errors.len() >= MAX_DIAGNOSTICS
    }

    /// True if there is no error yet at or below any of the `paths`, so that dependent checks make sense.
    pub fn is_clean(&self, paths: &[&str]) -> bool {
        !self.errors.iter().any(|e| {
            paths.iter().any(|p| {
                e.key.strip_prefix(p).is_some_and(|rest| {
                    rest.is_empty() || rest.starts_with('.') || rest.starts_with('[')
                })
            })
        })
    }
}
