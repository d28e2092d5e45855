//! What is wrong with a case file, for people and for programs.

use serde::Serialize;
use std::fmt;
use std::ops::Range;

/// One error or warning, with its place in the file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Diagnostic {
    /// Name of the file as it was given to the reader.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// Path of the key, for example `bed.grains.classes[2].share`; empty for the whole file.
    pub key: String,
    /// What is wrong, in a few words.
    pub problem: String,
    /// What the file says.
    pub found: String,
    /// What it should say.
    pub expected: String,
    /// How to repair it, where that can be told.
    pub hint: Option<String>,
    /// The line of the file, and how many characters of it are marked from `column` on.
    #[serde(skip)]
    source: Excerpt,
}

/// A line of the file, shortened to what is around the place.
#[derive(Debug, Clone, Default, PartialEq)]
struct Excerpt {
    before: String,
    marked: String,
    after: String,
}

/// Characters kept on each side of the marked place.
const CONTEXT: usize = 60;

impl Diagnostic {
    /// A diagnostic about the bytes `span` of `text`.
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
                before: printable(before[before.len().saturating_sub(CONTEXT)..].iter().copied()),
                marked: printable(text[start..end].chars().take(CONTEXT)),
                after: printable(text[end..line_end].trim_end().chars().take(CONTEXT)),
            },
        }
    }
}

impl Diagnostic {
    /// Without line and column, for a text that nobody has before their eyes.
    pub fn without_place(&self) -> String {
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

/// The largest character boundary up to `at`.
fn floor_boundary(text: &str, at: usize) -> usize {
    let mut at = at.min(text.len());
    while !text.is_char_boundary(at) {
        at -= 1;
    }
    at
}

/// Characters that cannot steer a terminal; a tab stays one character wide.
fn printable(chars: impl Iterator<Item = char>) -> String {
    chars
        .map(|c| match c {
            '\t' => ' ',
            c if c.is_control() => '\u{fffd}',
            c => c,
        })
        .collect()
}

/// Text from the file, safe to print and not longer than a line.
pub(crate) fn quoted(text: &str) -> String {
    let mut short: String = printable(text.chars().take(CONTEXT));
    if text.chars().nth(CONTEXT).is_some() {
        short.push('…');
    }
    format!("`{short}`")
}

impl fmt::Display for Diagnostic {
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

/// Everything that is wrong with a case file, in the order of the file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub struct CaseErrors {
    /// Never empty.
    pub errors: Vec<Diagnostic>,
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
