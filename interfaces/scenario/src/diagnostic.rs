//! Diagnostics of case files, for people and for programs.

use serde::Serialize;
use std::fmt;
use std::ops::Range;

/// Error or warning about a case file, with its position.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CaseDiagnostic {
    /// Name of the file as it was given to the reader.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Path of the key, for example `bed.grains.classes[2].share`; empty for the whole file.
    pub key: String,
    /// Problem in a few words.
    pub problem: String,
    /// Content of the file.
    pub found: String,
    /// Expected content.
    pub expected: String,
    /// Suggested correction, if known.
    pub hint: Option<String>,
    /// Line of the file, marked from `column` on.
    #[serde(skip)]
    source: Excerpt,
}

/// Line of the file, shortened to the surroundings of the marked characters.
#[derive(Debug, Clone, Default, PartialEq)]
struct Excerpt {
    before: String,
    marked: String,
    after: String,
}

/// Text of a diagnostic, without its position.
#[derive(Default)]
pub(crate) struct DiagnosticText {
    pub problem: String,
    pub found: String,
    pub expected: String,
    pub hint: Option<String>,
}

/// Maximum number of characters shown on each side of the marked ones.
const MAX_CONTEXT: usize = 60;

impl CaseDiagnostic {
    /// Creates a diagnostic about the bytes `span` of `text`, still without words.
    pub(crate) fn new(file: &str, text: &str, span: Range<usize>, key: String) -> Self {
        let start = floor_boundary(text, span.start);
        let line_start = text[..start].rfind('\n').map_or(0, |i| i + 1);
        let line_end = text[start..].find('\n').map_or(text.len(), |i| start + i);
        let end = floor_boundary(text, span.end).clamp(start, line_end);
        let before: Vec<char> = text[line_start..start].chars().collect();
        Self {
            file: file.to_string(),
            line: text[..line_start].matches('\n').count() + 1,
            column: before.len() + 1,
            key,
            problem: String::new(),
            found: String::new(),
            expected: String::new(),
            hint: None,
            source: Excerpt {
                before: printable(
                    before[before.len().saturating_sub(MAX_CONTEXT)..].iter().copied(),
                ),
                marked: printable(text[start..end].chars().take(MAX_CONTEXT)),
                after: printable(text[end..line_end].trim_end().chars().take(MAX_CONTEXT)),
            },
        }
    }

    pub(crate) fn with_text(self, text: DiagnosticText) -> Self {
        let DiagnosticText { problem, found, expected, hint } = text;
        Self { problem, found, expected, hint, ..self }
    }

    /// Formats the diagnostic as one line without position, for generated texts that are in no file.
    pub fn without_position(&self) -> String {
        let mut text = self.problem.clone();
        if !self.key.is_empty() {
            text = format!("{}: {text}", self.key);
        }
        for (word, what) in [("expected ", &self.expected), ("found ", &self.found)] {
            if !what.is_empty() {
                text += &format!(", {word}{what}");
            }
        }
        self.hint.iter().for_each(|hint| text += &format!("; {hint}"));
        text
    }
}

/// Returns the largest character boundary up to `at`.
fn floor_boundary(text: &str, at: usize) -> usize {
    let mut at = at.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

/// Returns the name of a space other than the plain one, or of a character without width.
pub(crate) fn invisible_name(c: char) -> Option<&'static str> {
    Some(match c {
        '\u{a0}' => "no-break space",
        '\u{202f}' => "narrow no-break space",
        '\u{1680}' | '\u{2000}'..='\u{200a}' | '\u{205f}' | '\u{3000}' => "Unicode space",
        '\u{200b}' => "zero-width space",
        '\u{feff}' => "byte order mark",
        '\u{85}' | '\u{2028}' | '\u{2029}' => "Unicode line separator",
        '\u{ad}'
        | '\u{180e}'
        | '\u{200c}'..='\u{200f}'
        | '\u{202a}'..='\u{202e}'
        | '\u{2060}'..='\u{206f}' => "invisible character",
        _ => return None,
    })
}

/// Replaces control characters, which could control a terminal, and invisible ones; a tab becomes one space.
fn printable(chars: impl Iterator<Item = char>) -> String {
    chars
        .map(|c| match c {
            '\t' => ' ',
            c if c.is_control() || invisible_name(c).is_some() => '\u{fffd}',
            c => c,
        })
        .collect()
}

/// Quotes a text from the file, safe to print and shortened to a line.
pub(crate) fn quoted(text: &str) -> String {
    let mut short: String = printable(text.chars().take(MAX_CONTEXT));
    if text.chars().nth(MAX_CONTEXT).is_some() {
        short.push('…');
    }
    format!("`{short}`")
}

impl fmt::Display for CaseDiagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = self.line.to_string();
        let margin = " ".repeat(number.len());
        writeln!(f, "{}", self.problem)?;
        write!(f, "{margin}--> {}:{}:{}", self.file, self.line, self.column)?;
        if !self.key.is_empty() {
            write!(f, "  {}", self.key)?;
        }
        let Excerpt { before, marked, after } = &self.source;
        writeln!(f, "\n{margin} |\n{number} | {before}{marked}{after}")?;
        let indent = " ".repeat(before.chars().count());
        let carets = "^".repeat(marked.chars().count().max(1));
        write!(f, "{margin} | {indent}{carets}")?;
        for (word, text) in [("found", &self.found), ("expected", &self.expected)] {
            if !text.is_empty() {
                write!(f, "\n{margin} = {word}: {text}")?;
            }
        }
        match &self.hint {
            Some(hint) => write!(f, "\n{margin} = {hint}"),
            None => Ok(()),
        }
    }
}

/// All errors of a case file, in the order of the file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub struct CaseErrors {
    /// Errors, never empty.
    pub errors: Vec<CaseDiagnostic>,
}

impl fmt::Display for CaseErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for error in &self.errors {
            writeln!(f, "error: {error}\n")?;
        }
        match self.errors.len() {
            1 => write!(f, "1 error"),
            n => write!(f, "{n} errors"),
        }?;
        match self.errors.first() {
            Some(first) => write!(f, " in {}", first.file),
            None => Ok(()),
        }
    }
}
