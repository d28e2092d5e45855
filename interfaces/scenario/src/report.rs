//! Collects errors and warnings about the keys of a document.

use crate::diagnostic::Diagnostic;
use crate::document::Document;

/// Errors after which no more are collected: nobody reads the rest.
pub const MOST: usize = 100;

/// What was found so far.
pub struct Report<'a, 't> {
    pub document: &'a Document<'t>,
    pub errors: Vec<Diagnostic>,
    pub warnings: Vec<Diagnostic>,
}

/// The words of one finding about a key.
#[derive(Default)]
pub struct Finding {
    pub problem: String,
    pub found: String,
    pub expected: String,
    pub hint: Option<String>,
}

impl<'a, 't> Report<'a, 't> {
    pub fn new(document: &'a Document<'t>) -> Self {
        Self { document, errors: Vec::new(), warnings: Vec::new() }
    }

    /// Adds an error about the key at `path`.
    pub fn error(&mut self, path: &str, finding: Finding) {
        if self.errors.len() < MOST {
            let diagnostic = self.diagnostic(path, finding);
            self.errors.push(diagnostic);
        }
    }

    /// Whether further errors would not be told.
    pub fn is_full(&self) -> bool {
        self.errors.len() >= MOST
    }

    /// Adds a warning about the key at `path`.
    pub fn warn(&mut self, path: &str, finding: Finding) {
        if self.warnings.len() < MOST {
            let diagnostic = self.diagnostic(path, finding);
            self.warnings.push(diagnostic);
        }
    }

    /// Whether no error was found so far at or below any of the `paths`: what is wrong already
    /// would only cause more errors.
    pub fn clean(&self, paths: &[&str]) -> bool {
        !self.errors.iter().any(|e| {
            paths.iter().any(|p| {
                e.key.strip_prefix(p).is_some_and(|rest| {
                    rest.is_empty() || rest.starts_with('.') || rest.starts_with('[')
                })
            })
        })
    }

    fn diagnostic(&self, path: &str, finding: Finding) -> Diagnostic {
        let mut d = self.document.diagnostic(self.document.span(path), path.to_string());
        d.problem = finding.problem;
        d.found = finding.found;
        d.expected = finding.expected;
        d.hint = finding.hint;
        d
    }
}
