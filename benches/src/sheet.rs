//! A table of measurements: for people, for programs, as a file.

use super::machine::Machine;
use ballast_session::Outcome;
use ballast_session::Reporter;
use ballast_session::files::replace_text;
use ballast_session::table::{Table, figure};
use serde_json::{Map, Value, json};
use std::fmt::Write;
use std::path::Path;

/// What stands in one place of a table.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    Text(String),
    Count(u64),
    Figure(f64),
    Nothing,
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Cell::Text(text.into())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Cell::Text(text)
    }
}

impl From<usize> for Cell {
    fn from(count: usize) -> Self {
        Cell::Count(count as u64)
    }
}

impl From<u32> for Cell {
    fn from(count: u32) -> Self {
        Cell::Count(count.into())
    }
}

impl From<f64> for Cell {
    fn from(value: f64) -> Self {
        Cell::Figure(value)
    }
}

impl<T: Into<Cell>> From<Option<T>> for Cell {
    fn from(value: Option<T>) -> Self {
        value.map_or(Cell::Nothing, Into::into)
    }
}

impl From<&Value> for Cell {
    fn from(value: &Value) -> Self {
        match (value, value.as_u64(), value.as_f64()) {
            (Value::Null, ..) => Cell::Nothing,
            (_, Some(count), _) => Cell::Count(count),
            (_, _, Some(value)) => Cell::Figure(value),
            _ => Cell::Text(value.as_str().map_or_else(|| value.to_string(), str::to_string)),
        }
    }
}

impl Cell {
    fn text(&self, digits: usize) -> String {
        match self {
            Cell::Text(text) => text.clone(),
            Cell::Count(count) => count.to_string(),
            Cell::Figure(value) => figure(*value, digits),
            Cell::Nothing => String::new(),
        }
    }

    fn is_told_by(&self, title: &str) -> bool {
        matches!(self, Cell::Text(text) if title.contains(text.as_str()))
    }

    fn json(&self) -> Value {
        match self {
            Cell::Text(text) => json!(text),
            Cell::Count(count) => json!(count),
            Cell::Figure(value) => json!(value),
            Cell::Nothing => Value::Null,
        }
    }
}

/// A row of [`Cell`]s out of values of all kinds.
macro_rules! cells {
    ($($value:expr),* $(,)?) => {
        vec![$($crate::sheet::Cell::from($value)),*]
    };
}
pub(super) use cells;

/// Rows under the same columns, printed in sections.
pub struct Sheet {
    /// Names with units, as in `wall_ms`.
    columns: &'static [&'static str],
    notes: Vec<(String, String)>,
    sections: Vec<(String, Vec<Vec<Cell>>)>,
}

impl Sheet {
    pub fn new(columns: &'static [&'static str]) -> Self {
        Self { columns, notes: Vec::new(), sections: Vec::new() }
    }

    /// Something that holds for the whole table.
    pub fn note(&mut self, word: &str, text: impl Into<String>) {
        self.notes.push((word.into(), text.into()));
    }

    /// Rows from here on stand under this title.
    pub fn section(&mut self, title: impl Into<String>) {
        self.sections.push((title.into(), Vec::new()));
    }

    /// Appends a row, one cell per column.
    pub fn row(&mut self, cells: Vec<Cell>) {
        assert_eq!(cells.len(), self.columns.len(), "a cell per column");
        if self.sections.is_empty() {
            self.section("");
        }
        self.sections.last_mut().expect("there is a section").1.push(cells);
    }

    /// Writes the table, and prints nothing.
    pub fn keep(mut self, machine: &Machine, csv: &Path) -> Outcome {
        self.notes.splice(0..0, machine.lines());
        replace_text(csv, &self.csv())
    }

    /// Prints the table, and writes it to `csv` where asked.
    pub fn publish(
        mut self,
        machine: &Machine,
        csv: Option<&Path>,
        console: &dyn Reporter,
    ) -> Outcome {
        self.notes.splice(0..0, machine.lines());
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

    fn fields(&self, title: &str, row: &[Cell]) -> Value {
        let mut fields = Map::new();
        fields.insert("section".into(), json!(title));
        for (column, cell) in self.columns.iter().zip(row) {
            fields.insert(column.to_string(), cell.json());
        }
        fields.into()
    }

    /// For people: columns without anything in a section, or with what its title says, are left out there.
    fn text(&self) -> String {
        let mut text = String::new();
        for (word, note) in &self.notes {
            let _ = writeln!(text, "{word}: {note}");
        }
        for (title, rows) in &self.sections {
            let used: Vec<usize> = (0..self.columns.len())
                .filter(|&c| rows.iter().any(|row| row[c] != Cell::Nothing))
                .filter(|&c| !rows.iter().all(|row| row[c].is_told_by(title)))
                .collect();
            let Some((first, rest)) = used.split_first() else { continue };
            let name = |c: &usize| self.columns[*c].replace('_', " ");
            let mut table = Table::new(&name(first), rest.iter().map(name));
            for row in rows {
                table.row(used.iter().map(|&c| row[c].text(3)));
            }
            let _ = write!(text, "\n{title}\n{}", table.text());
        }
        text
    }

    /// For programs: comment lines, a header, rows.
    fn csv(&self) -> String {
        let mut text = String::new();
        for (word, note) in &self.notes {
            let _ = writeln!(text, "# {word}: {}", note.replace('\n', " "));
        }
        let _ = writeln!(text, "{}", self.columns.join(","));
        for row in self.sections.iter().flat_map(|(_, rows)| rows) {
            // A comma in a text would shift the columns.
            let cells: Vec<String> =
                row.iter().map(|cell| cell.text(6).replace([',', '"', '\n'], ";")).collect();
            let _ = writeln!(text, "{}", cells.join(","));
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sheet_reads_the_same_for_people_and_programs() {
        let mut sheet = Sheet::new(&["phase", "wall_ms", "ratio"]);
        sheet.note("steps", "1 to 3");
        sheet.section("two threads");
        sheet.row(cells!["solve", 12.34567, None::<f64>]);
        sheet.row(cells!["a, b", 2usize, None::<f64>]);
        assert_eq!(
            sheet.text(),
            "steps: 1 to 3\n\ntwo threads\nphase  wall ms\nsolve     12.3\na, b         2\n"
        );
        assert_eq!(sheet.csv(), "# steps: 1 to 3\nphase,wall_ms,ratio\nsolve,12.3457,\na; b,2,\n");
        let row = cells!["solve", 1.5, None::<f64>];
        assert_eq!(
            sheet.fields("two threads", &row),
            json!({"section": "two threads", "phase": "solve", "wall_ms": 1.5, "ratio": null})
        );
    }
}
