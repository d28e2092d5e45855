//! TextTable of measurements, as text, events and CSV.

use super::machine_info::MachineInfo;
use ballast_session::files::{csv_text, replace_text};
use ballast_session::table::{TextTable, figure};
use ballast_session::{Reporter, Result};
use serde_json::{Map, Value, json};
use std::fmt::Write;
use std::path::Path;

/// Value in one cell of a [`ResultSheet`].
#[derive(Debug, Clone, PartialEq)]
pub enum SheetValue {
    Text(String),
    Count(u64),
    Figure(f64),
    Nothing,
}

impl From<&str> for SheetValue {
    fn from(text: &str) -> Self {
        SheetValue::Text(text.into())
    }
}

impl From<String> for SheetValue {
    fn from(text: String) -> Self {
        SheetValue::Text(text)
    }
}

impl From<usize> for SheetValue {
    fn from(count: usize) -> Self {
        SheetValue::Count(count as u64)
    }
}

impl From<u32> for SheetValue {
    fn from(count: u32) -> Self {
        SheetValue::Count(count.into())
    }
}

impl From<f64> for SheetValue {
    fn from(value: f64) -> Self {
        SheetValue::Figure(value)
    }
}

impl<T: Into<SheetValue>> From<Option<T>> for SheetValue {
    fn from(value: Option<T>) -> Self {
        value.map_or(SheetValue::Nothing, Into::into)
    }
}

impl From<&Value> for SheetValue {
    fn from(value: &Value) -> Self {
        match (value, value.as_u64(), value.as_f64()) {
            (Value::Null, ..) => SheetValue::Nothing,
            (_, Some(count), _) => SheetValue::Count(count),
            (_, _, Some(value)) => SheetValue::Figure(value),
            _ => SheetValue::Text(value.as_str().map_or_else(|| value.to_string(), str::to_string)),
        }
    }
}

impl SheetValue {
    fn text(&self, digits: usize) -> String {
        match self {
            SheetValue::Text(text) => text.clone(),
            SheetValue::Count(count) => count.to_string(),
            SheetValue::Figure(value) => figure(*value, digits),
            SheetValue::Nothing => String::new(),
        }
    }

    /// Returns true if the title of a section already contains the value.
    fn is_in(&self, title: &str) -> bool {
        matches!(self, SheetValue::Text(text) if title.contains(text.as_str()))
    }

    fn json(&self) -> Value {
        match self {
            SheetValue::Text(text) => json!(text),
            SheetValue::Count(count) => json!(count),
            SheetValue::Figure(value) => json!(value),
            SheetValue::Nothing => Value::Null,
        }
    }
}

/// Builds a row of [`SheetValue`]s from values of several types.
macro_rules! cells {
    ($($value:expr),* $(,)?) => {
        vec![$($crate::result_sheet::SheetValue::from($value)),*]
    };
}
pub(super) use cells;

/// Rows with the same columns, printed in sections.
pub struct ResultSheet {
    /// Names with units, as in `wall_ms`.
    columns: &'static [&'static str],
    notes: Vec<(String, String)>,
    sections: Vec<(String, Vec<Vec<SheetValue>>)>,
}

impl ResultSheet {
    pub fn new(columns: &'static [&'static str]) -> Self {
        Self { columns, notes: Vec::new(), sections: Vec::new() }
    }

    /// Adds a note about the whole table.
    pub fn note(&mut self, word: &str, text: impl Into<String>) {
        self.notes.push((word.into(), text.into()));
    }

    /// Starts a section of rows under `title`.
    pub fn section(&mut self, title: impl Into<String>) {
        self.sections.push((title.into(), Vec::new()));
    }

    /// Appends a row with one value per column.
    pub fn row(&mut self, cells: Vec<SheetValue>) {
        assert_eq!(cells.len(), self.columns.len(), "a cell per column");
        if self.sections.is_empty() {
            self.section("");
        }
        self.sections.last_mut().expect("there is a section").1.push(cells);
    }

    /// Writes the table to `csv` and prints nothing.
    pub fn write(mut self, machine_info: &MachineInfo, csv: &Path) -> Result {
        self.notes.splice(0..0, machine_info.lines());
        replace_text(csv, &self.csv())
    }

    /// Prints the table, and writes it to `csv` if given.
    pub fn publish(
        mut self,
        machine_info: &MachineInfo,
        csv: Option<&Path>,
        console: &dyn Reporter,
    ) -> Result {
        self.notes.splice(0..0, machine_info.lines());
        for (title, rows) in &self.sections {
            for row in rows {
                console.event("row", self.fields(title, row));
            }
        }
        console.result(self.text().trim_end());
        if let Some(path) = csv {
            replace_text(path, &self.csv())?;
        }
        let notes: Map<String, Value> =
            self.notes.into_iter().map(|(word, text)| (word, json!(text))).collect();
        console.event("done", json!({ "notes": notes, "csv": csv }));
        Ok(())
    }

    fn fields(&self, title: &str, row: &[SheetValue]) -> Value {
        let mut fields = Map::new();
        fields.insert("section".into(), json!(title));
        for (column, cell) in self.columns.iter().zip(row) {
            fields.insert(column.to_string(), cell.json());
        }
        fields.into()
    }

    /// Returns the table as text, without columns that are empty in a section or repeat its title.
    fn text(&self) -> String {
        let mut text = String::new();
        for (word, note) in &self.notes {
            let _ = writeln!(text, "{word}: {note}");
        }
        for (title, rows) in &self.sections {
            let used: Vec<usize> = (0..self.columns.len())
                .filter(|&c| rows.iter().any(|row| row[c] != SheetValue::Nothing))
                .filter(|&c| !rows.iter().all(|row| row[c].is_in(title)))
                .collect();
            let Some((first, rest)) = used.split_first() else { continue };
            let name = |c: &usize| self.columns[*c].replace('_', " ");
            let mut table = TextTable::new(&name(first), rest.iter().map(name));
            for row in rows {
                table.row(used.iter().map(|&c| row[c].text(3)));
            }
            let _ = write!(text, "\n{title}\n{}", table.text());
        }
        text
    }

    /// Returns the table as CSV: comment lines, a header, rows.
    fn csv(&self) -> String {
        let mut text = String::new();
        for (word, note) in &self.notes {
            let _ = writeln!(text, "# {word}: {}", note.replace('\n', " "));
        }
        let rows = self.sections.iter().flat_map(|(_, rows)| rows);
        let rows = rows.map(|row| row.iter().map(|cell| cell.text(6)).collect::<Vec<_>>());
        text + &csv_text(self.columns, rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_csv_and_events_agree() {
        let mut sheet = ResultSheet::new(&["phase", "wall_ms", "ratio"]);
        sheet.note("steps", "1 to 3");
        sheet.section("two threads");
        sheet.row(cells!["solve", 12.34567, None::<f64>]);
        sheet.row(cells!["a, b", 2usize, None::<f64>]);
        assert_eq!(
            sheet.text(),
            "steps: 1 to 3\n\ntwo threads\nphase  wall ms\nsolve     12.3\na, b         2\n"
        );
        assert_eq!(
            sheet.csv(),
            "# steps: 1 to 3\nphase,wall_ms,ratio\nsolve,12.3457,\n\"a, b\",2,\n"
        );
        let row = cells!["solve", 1.5, None::<f64>];
        assert_eq!(
            sheet.fields("two threads", &row),
            json!({"section": "two threads", "phase": "solve", "wall_ms": 1.5, "ratio": null})
        );
    }
}
