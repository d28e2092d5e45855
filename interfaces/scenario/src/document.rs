//! A parsed TOML text in which every key can be found again.

use crate::diagnostic::{Diagnostic, quoted};
use crate::text::LONGEST_CASE;
use std::ops::Range;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// One part of the path of a key.
#[derive(Debug, Clone, PartialEq)]
pub enum Part {
    Key(String),
    Index(usize),
}

/// Text, name and parsed table.
pub struct Document<'t> {
    pub file: &'t str,
    pub text: &'t str,
    pub root: DeTable<'t>,
}

impl<'t> Document<'t> {
    /// Parses `text`; all errors of syntax are returned at once.
    pub fn parse(text: &'t str, file: &'t str) -> Result<Self, Vec<Diagnostic>> {
        if text.len() as u64 > LONGEST_CASE {
            let mut d = Diagnostic::new(file, "", 0..0, String::new());
            d.problem = "the file is too large".into();
            d.found = format!("{} bytes", text.len());
            d.expected = format!("a case file of at most {LONGEST_CASE} bytes");
            return Err(vec![d]);
        }
        let (root, errors) = DeTable::parse_recoverable(text);
        if errors.is_empty() {
            return Ok(Self { file, text, root: root.into_inner() });
        }
        Err(errors.iter().map(|e| syntax(file, text, e)).collect())
    }

    /// A diagnostic about the bytes `span`.
    pub fn diagnostic(&self, span: Range<usize>, key: String) -> Diagnostic {
        Diagnostic::new(self.file, self.text, span, key)
    }

    /// Where the value at `path` is written (for a table, its name); for a key that is not written,
    /// the table that would hold it.
    pub fn span(&self, path: &str) -> Range<usize> {
        let mut place = 0..0;
        let mut table = Some(&self.root);
        let mut array: Option<&[Spanned<DeValue>]> = None;
        for part in parts(path) {
            let (name, value) = match &part {
                Part::Key(key) => {
                    let Some((name, value)) = table.and_then(|t| find(t, key)) else { break };
                    (name.span(), value)
                }
                Part::Index(i) => {
                    let Some(value) = array.and_then(|a| a.get(*i)) else { break };
                    (value.span(), value)
                }
            };
            table = value.get_ref().as_table();
            array = value.get_ref().as_array().map(|a| a.as_ref());
            place = if table.is_some() { name } else { value.span() };
        }
        place
    }

    /// Whether the key at `path` is written.
    pub fn has(&self, path: &str) -> bool {
        let mut table = Some(&self.root);
        path.split('.').all(|key| {
            let found = table.and_then(|t| find(t, key));
            table = found.and_then(|(_, value)| value.get_ref().as_table());
            found.is_some()
        })
    }

    /// The text of `span`, for messages.
    pub fn quote(&self, span: Range<usize>) -> String {
        quoted(self.text.get(span).unwrap_or_default().trim())
    }
}

/// The entry called `key`.
pub fn find<'a, 'i>(
    table: &'a DeTable<'i>,
    key: &str,
) -> Option<(&'a Spanned<std::borrow::Cow<'i, str>>, &'a Spanned<DeValue<'i>>)> {
    table.iter().find(|(name, _)| name.get_ref().as_ref() == key)
}

/// The parts of a path like `bed.grains.classes[2].share`.
fn parts(path: &str) -> Vec<Part> {
    let mut parts = Vec::new();
    for word in path.split('.').filter(|w| !w.is_empty()) {
        let mut pieces = word.split('[');
        parts.extend(pieces.next().filter(|k| !k.is_empty()).map(|k| Part::Key(k.into())));
        parts.extend(pieces.filter_map(|p| p.trim_end_matches(']').parse().ok()).map(Part::Index));
    }
    parts
}

fn syntax(file: &str, text: &str, error: &toml::de::Error) -> Diagnostic {
    let span = error.span().unwrap_or(0..0);
    let mut d = Diagnostic::new(file, text, span.clone(), String::new());
    let message = error.message().trim();
    let (problem, expected) = match message.split_once(", expected ") {
        Some((problem, expected)) => (problem, expected),
        None => message.strip_prefix("expected ").map_or((message, ""), |expected| ("", expected)),
    };
    d.problem = format!("not TOML: {}", problem.trim().trim_end_matches([',', ';', '\n']));
    if !problem.contains("duplicate")
        && let Some((found, expected)) = slip(text, span.start)
    {
        (d.found, d.expected) = (quoted(found), expected);
        return d;
    }
    d.expected = expected.into();
    if let Some(found) = text.get(span).filter(|s| !s.trim().is_empty()) {
        d.found = quoted(found.trim());
    }
    d
}

/// What was written instead of what, where a value of another language stands at or around `at`.
fn slip(text: &str, at: usize) -> Option<(&str, String)> {
    let line = text.get(..at)?.rfind('\n').map_or(0, |end| end + 1);
    let (_, value) = text[line..].lines().next()?.split_once('=')?;
    let value = value.split('#').next()?.trim();
    let is_number = |word: &str| word.parse::<f64>().is_ok_and(f64::is_finite);
    if is_number(&value.replacen(',', ".", 1)) && value.contains(',') {
        return Some((
            value,
            format!("a number with a decimal point: {}", value.replacen(',', ".", 1)),
        ));
    }
    let digits = value.trim_start_matches('0');
    if value.starts_with('0')
        && digits.starts_with(|c: char| c.is_ascii_digit())
        && is_number(digits)
    {
        return Some((value, format!("a number without zeros before it: {digits}")));
    }
    let is_word = value.starts_with(char::is_alphabetic) && !value.contains(['"', '\'', '[', '{']);
    is_word.then(|| (value, format!("a text in quotes: \"{value}\"")))
}
