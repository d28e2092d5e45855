//! Tables that grow row by row: plain CSV, one header line, numbers that read back exactly.
//!
//! A run is resumed from a checkpoint, and its tables may hold rows of later steps; those are cut
//! off, and the earlier rows are handed back, so that a resumed run's summary covers the whole run.

use crate::exit::{Failure, Outcome};
use crate::files::{read_text, replace_text};
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// Larger than any series of a real run; a limit on what a wrong file may make us read.
const LIMIT: u64 = 4 << 30;

/// One row: the step, the phase of the cycle, and the columns' values.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    pub step: u64,
    pub phase: String,
    pub values: Vec<f64>,
}

/// A table being written.
#[derive(Debug)]
pub struct Series {
    path: PathBuf,
    file: BufWriter<File>,
    columns: usize,
}

impl Series {
    /// Starts a table with the columns `step`, `phase` and `columns`.
    pub fn create(path: &Path, columns: &[String]) -> Outcome<Self> {
        let file = File::create(path).map_err(|e| Failure::at(path, e))?;
        let mut series =
            Self { path: path.into(), file: BufWriter::new(file), columns: columns.len() };
        series.line(&header(columns))?;
        Ok(series)
    }

    /// Opens a table to go on after step `last`; returns its rows up to there.
    pub fn reopen(path: &Path, columns: &[String], last: u64) -> Outcome<(Self, Vec<Row>)> {
        let text = read_text(path, LIMIT)?;
        let rows = parse(path, &text, columns, last)?;
        // Rewritten as a whole: cutting in place could lose rows if this is interrupted.
        let mut kept = header(columns) + "\n";
        for row in &rows {
            kept += &format(row);
            kept.push('\n');
        }
        replace_text(path, &kept)?;
        let file =
            OpenOptions::new().append(true).open(path).map_err(|e| Failure::at(path, e))?;
        Ok((Self { path: path.into(), file: BufWriter::new(file), columns: columns.len() }, rows))
    }

    /// Appends a row.
    pub fn push(&mut self, row: &Row) -> Outcome {
        assert_eq!(row.values.len(), self.columns, "one value per column");
        self.line(&format(row))
    }

    /// Hands everything to the system. To be called before a checkpoint that relies on the rows.
    pub fn flush(&mut self) -> Outcome {
        self.file.flush().map_err(|e| unwritable(&self.path, e))
    }

    fn line(&mut self, text: &str) -> Outcome {
        writeln!(self.file, "{text}").map_err(|e| unwritable(&self.path, e))
    }
}

fn unwritable(path: &Path, e: std::io::Error) -> Failure {
    Failure::at(path, format!("cannot write it: {e}; the rows before are kept"))
}

fn header(columns: &[String]) -> String {
    let mut line = String::from("step,phase");
    for column in columns {
        line.push(',');
        line += column;
    }
    line
}

fn format(row: &Row) -> String {
    let mut line = format!("{},{}", row.step, row.phase);
    for value in &row.values {
        // The shortest text that reads back as the same number.
        line += &format!(",{value:?}");
    }
    line
}

/// Rows up to step `last`. A last line that was cut off by a crash is not a row.
fn parse(path: &Path, text: &str, columns: &[String], last: u64) -> Outcome<Vec<Row>> {
    let mut lines = text.split_inclusive('\n').enumerate();
    let found = lines.next().map_or("", |(_, line)| line.trim_end());
    if found != header(columns) {
        let what = "its columns are not those of this run; it belongs to another case";
        return Err(Failure::at(path, what));
    }
    let mut rows = Vec::new();
    for (number, line) in lines.filter(|(_, line)| line.ends_with('\n')) {
        let row = parse_row(line.trim_end(), columns.len()).ok_or_else(|| {
            let what = format!("line {}: expected {} values", number + 1, columns.len() + 2);
            Failure::at(path, what)
        })?;
        if row.step <= last {
            rows.push(row);
        }
    }
    Ok(rows)
}

fn parse_row(line: &str, columns: usize) -> Option<Row> {
    let mut cells = line.split(',');
    let step = cells.next()?.parse().ok()?;
    let phase = cells.next()?.to_string();
    let values = cells.map(|cell| cell.parse().ok()).collect::<Option<Vec<f64>>>()?;
    (values.len() == columns).then_some(Row { step, phase, values })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(step: u64, a: f64, b: f64) -> Row {
        Row { step, phase: "squeeze".into(), values: vec![a, b] }
    }

    fn columns() -> Vec<String> {
        vec!["time_s".into(), "force_n".into()]
    }

    #[test]
    fn rows_read_back_exactly_and_later_ones_are_cut() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("steps.csv");
        let rows = [row(1, 0.1, 1e-300), row(2, 0.1 + 0.2, -0.0), row(3, 1.0 / 3.0, f64::INFINITY)];
        let mut series = Series::create(&path, &columns()).unwrap();
        rows.iter().for_each(|r| series.push(r).unwrap());
        drop(series);

        let (mut series, kept) = Series::reopen(&path, &columns(), 2).unwrap();
        assert_eq!(kept, rows[..2]);
        assert!(kept[1].values[1].is_sign_negative());
        series.push(&rows[2]).unwrap();
        drop(series);
        let (_, all) = Series::reopen(&path, &columns(), 3).unwrap();
        assert_eq!(all, rows);
    }

    #[test]
    fn a_torn_last_line_is_not_a_row() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("steps.csv");
        std::fs::write(&path, "step,phase,time_s,force_n\n1,squeeze,0.5,7.0\n2,squeeze,0.7,1").unwrap();
        let (_, rows) = Series::reopen(&path, &columns(), 9).unwrap();
        assert_eq!(rows, [row(1, 0.5, 7.0)]);
    }

    #[test]
    fn foreign_and_damaged_tables_are_refused_with_their_place() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("steps.csv");
        std::fs::write(&path, "step,phase,other\n").unwrap();
        assert!(Series::reopen(&path, &columns(), 9).is_err());
        std::fs::write(&path, "step,phase,time_s,force_n\n1,squeeze,zero,7.0\n").unwrap();
        let error = Series::reopen(&path, &columns(), 9).unwrap_err().to_string();
        assert!(error.contains("line 2"), "{error}");
    }
}
