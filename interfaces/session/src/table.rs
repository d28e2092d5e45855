//! Tables of text with aligned columns.

use std::fmt::Write;
use std::time::Duration;

/// Table with a title; the first column is left-aligned, the others right-aligned.
#[derive(Debug, Clone, Default)]
pub struct TextTable {
    rows: Vec<Vec<String>>,
}

impl TextTable {
    /// Creates a table with a header line, which starts with the title.
    pub fn new<S: Into<String>>(title: &str, header: impl IntoIterator<Item = S>) -> Self {
        let mut first = vec![title.to_string()];
        first.extend(header.into_iter().map(Into::into));
        Self { rows: vec![first] }
    }

    /// Appends a row.
    pub fn row<S: Into<String>>(&mut self, cells: impl IntoIterator<Item = S>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// Returns true if there are no rows below the header.
    pub fn is_empty(&self) -> bool {
        self.rows.len() < 2
    }

    /// Header and rows.
    pub fn rows(&self) -> &[Vec<String>] {
        &self.rows
    }

    /// Returns the table as lines; empty without rows.
    pub fn text(&self) -> String {
        if self.is_empty() {
            return String::new();
        }
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let width = |c: usize| {
            self.rows.iter().filter_map(|r| r.get(c)).map(|s| s.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..columns).map(width).collect();
        let mut text = String::new();
        for row in &self.rows {
            let mut line = String::new();
            for (c, cell) in row.iter().enumerate() {
                let _ = match c {
                    0 => write!(line, "{cell:<0$}", widths[0]),
                    _ => write!(line, "  {cell:>0$}", widths[c]),
                };
            }
            text += line.trim_end();
            text.push('\n');
        }
        text
    }
}

/// Returns the number of threads as text.
pub fn on_threads(threads: usize) -> String {
    format!("{threads} {}", if threads == 1 { "thread" } else { "threads" })
}

/// Formats a number with `digits` significant digits.
pub fn figure(value: f64, digits: usize) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    // Exponent of the rounded number: 9.996 is 10.0.
    let rounded = format!("{value:.*e}", digits.saturating_sub(1));
    let exponent: i32 = rounded.rsplit('e').next().and_then(|e| e.parse().ok()).unwrap_or(0);
    if !(-4..7).contains(&exponent) {
        return rounded;
    }
    let decimals = (digits as i32 - 1 - exponent).max(0) as usize;
    format!("{value:.decimals$}")
}

/// Formats a duration: `0.8 s`, `42 s`, `3 min 20 s`, `2 h 05 min`.
pub fn duration(time: Duration) -> String {
    let seconds = time.as_secs();
    match seconds {
        0..10 => format!("{:.1} s", time.as_secs_f64()),
        10..60 => format!("{seconds} s"),
        60..3600 => format!("{} min {:02} s", seconds / 60, seconds % 60),
        _ => format!("{} h {:02} min", seconds / 3600, seconds / 60 % 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_align_with_letters_of_two_bytes() {
        let mut table = TextTable::new("zone", ["φ", "after"]);
        table.row(["under the sleeper", "0.5812", "0.61"]);
        table.row(["crib", "0.5", "0.4"]);
        assert_eq!(
            table.text(),
            "zone                    φ  after\n\
             under the sleeper  0.5812   0.61\n\
             crib                  0.5    0.4\n"
        );
        assert_eq!(TextTable::new("empty", ["x"]).text(), "");
    }

    #[test]
    fn figures_keep_their_significant_digits() {
        assert_eq!(figure(0.0012345, 3), "0.00123");
        assert_eq!(figure(12345.6, 3), "12346");
        assert_eq!(figure(-2.5e-9, 2), "-2.5e-9");
        assert_eq!(figure(0.0, 3), "0");
        assert_eq!(figure(1.0, 3), "1.00");
        assert_eq!(figure(9.996, 3), "10.0");
        assert_eq!(figure(-0.09996, 3), "-0.100");
        assert_eq!(figure(9_999_999.9, 3), "1.00e7");
        assert_eq!(figure(0.000_099_999, 3), "0.000100");
    }

    #[test]
    fn durations_have_units() {
        let text = |s: f64| duration(Duration::from_secs_f64(s));
        assert_eq!(text(0.84), "0.8 s");
        assert_eq!(text(42.9), "42 s");
        assert_eq!(text(200.0), "3 min 20 s");
        assert_eq!(text(7500.0), "2 h 05 min");
    }
}
