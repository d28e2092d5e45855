//! Parsed TOML text with the position of every key.

use crate::diagnostic::{CaseDiagnostic, quoted};
use crate::notation;
use crate::read_text::MAX_CASE_BYTES;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Segment of the path of a key.
#[derive(Debug, Clone, PartialEq)]
pub enum PathSegment {
    Key(String),
    Index(usize),
}

/// Text, name and parsed table of a case file.
pub struct CaseDocument<'t> {
    pub file: &'t str,
    pub text: &'t str,
    pub root: DeTable<'t>,
}

impl<'t> CaseDocument<'t> {
    /// Parses `text`; returns all syntax errors at once.
    pub fn parse(text: &'t str, file: &'t str) -> Result<Self, Vec<CaseDiagnostic>> {
        if text.len() as u64 > MAX_CASE_BYTES {
            let mut d = CaseDiagnostic::new(file, "", 0..0, String::new());
            d.problem = "the file is too large".into();
            d.found = format!("{} bytes", text.len());
            d.expected = format!("a case file of at most {MAX_CASE_BYTES} bytes");
            return Err(vec![d]);
        }
        let (root, errors) = DeTable::parse_recoverable(text);
        if errors.is_empty() {
            return Ok(Self { file, text, root: root.into_inner() });
        }
        Err(syntax_errors(file, text, &errors))
    }

    /// Creates a diagnostic about the bytes `span`.
    pub fn diagnostic(&self, span: Range<usize>, key: String) -> CaseDiagnostic {
        CaseDiagnostic::new(self.file, self.text, span, key)
    }

    /// Returns the bytes of the value at `path`, or of the name of a table there. For a missing key, returns the
    /// bytes of its table.
    pub fn span(&self, path: &str) -> Range<usize> {
        let mut span = 0..0;
        let mut table = Some(&self.root);
        let mut array: Option<&[Spanned<DeValue>]> = None;
        for segment in segments(path) {
            let (name, value) = match &segment {
                PathSegment::Key(key) => {
                    let Some((name, value)) = table.and_then(|t| find(t, key)) else { break };
                    (name.span(), value)
                }
                PathSegment::Index(i) => {
                    let Some(value) = array.and_then(|a| a.get(*i)) else { break };
                    (value.span(), value)
                }
            };
            table = value.get_ref().as_table();
            array = value.get_ref().as_array().map(|a| a.as_ref());
            span = if table.is_some() { name } else { value.span() };
        }
        span
    }

    /// True if the file has the key at `path`.
    pub fn has(&self, path: &str) -> bool {
        let mut table = Some(&self.root);
        let mut array: Option<&[Spanned<DeValue>]> = None;
        segments(path).iter().all(|segment| {
            let found = match segment {
                PathSegment::Key(key) => table.and_then(|t| find(t, key)).map(|(_, value)| value),
                PathSegment::Index(i) => array.and_then(|a| a.get(*i)),
            };
            table = found.and_then(|value| value.get_ref().as_table());
            array = found.and_then(|value| value.get_ref().as_array()).map(|a| a.as_ref());
            found.is_some()
        })
    }

    /// Quotes the bytes `span` for messages.
    pub fn quote(&self, span: Range<usize>) -> String {
        quoted(self.text.get(span).unwrap_or_default().trim())
    }
}

/// Returns the entry with the name `key`.
pub fn find<'a, 'i>(
    table: &'a DeTable<'i>,
    key: &str,
) -> Option<(&'a Spanned<std::borrow::Cow<'i, str>>, &'a Spanned<DeValue<'i>>)> {
    table.iter().find(|(name, _)| name.get_ref().as_ref() == key)
}

/// Splits a path like `bed.grains.classes[2].size_m` into its segments.
fn segments(path: &str) -> Vec<PathSegment> {
    let mut segments = Vec::new();
    for word in path.split('.').filter(|w| !w.is_empty()) {
        let mut pieces = word.split('[');
        segments
            .extend(pieces.next().filter(|k| !k.is_empty()).map(|k| PathSegment::Key(k.into())));
        segments.extend(
            pieces.filter_map(|p| p.trim_end_matches(']').parse().ok()).map(PathSegment::Index),
        );
    }
    segments
}

/// Maximum number of the parser's syntax errors that are reported.
const MAX_SYNTAX_ERRORS: usize = 100;

/// Returns the syntax errors of a text: each foreign notation, and the parser's errors on other lines.
fn syntax_errors(file: &str, text: &str, errors: &[toml::de::Error]) -> Vec<CaseDiagnostic> {
    let errors = &errors[..errors.len().min(MAX_SYNTAX_ERRORS)];
    let starts: Vec<usize> = errors.iter().map(|e| e.span().map_or(0, |s| s.start)).collect();
    let mut found: Vec<CaseDiagnostic> = notation::find(text, &starts)
        .into_iter()
        .map(|n| CaseDiagnostic::new(file, text, n.span, String::new()).with_text(n.text))
        .collect();
    let lines: Vec<usize> = found.iter().map(|d| d.line).collect();
    let parser = errors.iter().map(|error| syntax_error(file, text, error));
    found.extend(parser.filter(|d| !lines.contains(&d.line)));
    found.sort_by_key(|d| (d.line, d.column));
    found
}

fn syntax_error(file: &str, text: &str, error: &toml::de::Error) -> CaseDiagnostic {
    let span = error.span().unwrap_or(0..0);
    let mut d = CaseDiagnostic::new(file, text, span.clone(), String::new());
    let message = error.message().trim();
    let (problem, expected) = match message.split_once(", expected ") {
        Some((problem, expected)) => (problem, expected),
        None => message.strip_prefix("expected ").map_or((message, ""), |expected| ("", expected)),
    };
    d.problem = format!("not TOML: {}", problem.trim().trim_end_matches([',', ';', '\n']));
    d.expected = expected.into();
    if let Some(found) = text.get(span).filter(|s| !s.trim().is_empty()) {
        d.found = quoted(found.trim());
        // The parser takes everything that is no other value for a text.
        if message.contains("string values must be quoted")
            && found.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c))
        {
            d.problem = "not TOML: not a number".into();
            d.expected = "one number, entries separated by commas, or a text in quotes".into();
        }
    }
    d
}
