//! Tables of numbers over the steps: `/tables/NAME/{step, rows}`.
//!
//! `rows` is `[n, columns]`, f64; its group's attributes `columns` and `units` name the columns.

use super::growing::{
    append, create_table, group as make_group, read, read_texts, texts, truncate,
};
use crate::error::Fault;
use hdf5::{Group, Result};

/// Maximum number of rows in memory before they are written.
const MAX_ROWS: usize = 1024;

/// Table with the rows that are not in the file yet.
#[derive(Debug)]
pub(crate) struct TableBuffer {
    columns: Vec<(String, String)>,
    steps: Vec<u64>,
    rows: Vec<f64>,
}

impl TableBuffer {
    pub fn create(parent: &Group, name: &str, columns: &[(&str, &str)]) -> Result<Self> {
        let group = make_group(parent, name)?;
        let (names, units): (Vec<&str>, Vec<&str>) = columns.iter().copied().unzip();
        texts(&group, "columns", &names)?;
        texts(&group, "units", &units)?;
        create_table::<u64>(&group, "step", &[])?;
        create_table::<f64>(&group, "rows", &[columns.len()])?;
        Ok(Self::empty(columns.iter().map(|(n, u)| (n.to_string(), u.to_string())).collect()))
    }

    fn empty(columns: Vec<(String, String)>) -> Self {
        Self { columns, steps: vec![], rows: vec![] }
    }

    /// Opens a table and removes the rows after `at_step`.
    pub fn open(parent: &Group, name: &str, at_step: u64) -> Result<Self> {
        let group = parent.group(name)?;
        let columns = read_texts(&group, "columns")?;
        let units = read_texts(&group, "units")?;
        let dataset = group.dataset("step")?;
        let steps: Vec<u64> = read(&dataset, 0..dataset.shape()[0])?;
        let kept = steps.partition_point(|&step| step <= at_step);
        truncate(&group, "step", kept)?;
        truncate(&group, "rows", kept)?;
        Ok(Self::empty(columns.into_iter().zip(units).collect()))
    }

    pub fn fits(&self, columns: &[(&str, &str)]) -> bool {
        self.columns.iter().map(|(n, u)| (n.as_str(), u.as_str())).eq(columns.iter().copied())
    }

    pub fn describe(&self) -> String {
        format!("columns {:?}", self.columns)
    }

    pub fn push(&mut self, step: u64, row: &[f64]) -> std::result::Result<(), Fault> {
        if row.len() != self.columns.len() {
            let expected = format!("{} values", self.columns.len());
            return Err(Fault::new("row of a series", expected, row.len()));
        }
        self.steps.push(step);
        self.rows.extend_from_slice(row);
        Ok(())
    }

    pub fn is_full(&self) -> bool {
        self.steps.len() >= MAX_ROWS
    }

    /// Writes the collected rows.
    pub fn store(&mut self, parent: &Group, name: &str) -> Result<()> {
        if self.steps.is_empty() {
            return Ok(());
        }
        let group = parent.group(name)?;
        append(&group, "rows", &self.rows)?;
        append(&group, "step", &self.steps)?;
        self.rows.clear();
        self.steps.clear();
        Ok(())
    }
}
