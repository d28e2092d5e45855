//! What runs have left: results and recordings, as arrays and dictionaries.

use crate::arrays::{self, Matrix, Vector};
use crate::case::as_dict;
use crate::errors;
use crate::lock::enter_patiently;
use ballast_hdf5::results::Reader;
use ballast_mcap::recording::Windows;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::Mutex;

/// A results file of `ballast run`.
#[pyclass(frozen, module = "ballast")]
pub struct Results {
    reader: Mutex<Reader>,
}

impl Results {
    fn read<T>(
        &self,
        py: Python<'_>,
        ask: impl FnOnce(&Reader) -> ballast_hdf5::Result<T>,
    ) -> PyResult<T> {
        ask(&enter_patiently(py, &self.reader)).map_err(|e| errors::file(py, e))
    }
}

#[pymethods]
impl Results {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let reader = Reader::open(path).map_err(|e| errors::file(py, e))?;
        Ok(Self { reader: Mutex::new(reader) })
    }

    /// As the case calls itself.
    #[getter]
    fn case_name(&self, py: Python<'_>) -> PyResult<String> {
        self.read(py, |r| r.about("case_name"))
    }

    /// Of the case file, TOML.
    #[getter]
    fn case_text(&self, py: Python<'_>) -> PyResult<String> {
        self.read(py, |r| r.about("case_text"))
    }

    /// Number of grains, and names of the driven bodies after them.
    #[getter]
    fn bodies(&self, py: Python<'_>) -> PyResult<(u64, Vec<String>)> {
        self.read(py, Reader::bodies)
    }

    /// What each of the driven bodies is: "boundary", "sleeper" or "tine".
    #[getter]
    fn roles(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.read(py, Reader::roles)
    }

    /// (n,) step of each frame.
    #[getter]
    fn steps<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py, u64>> {
        self.read(py, |r| Ok(arrays::column(py, r.steps())))
    }

    /// (n,) time of each frame, s.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py>> {
        let times = self.read(py, Reader::times)?;
        Ok(arrays::column(py, &times))
    }

    /// Positions (n, 3) in m and orientations (n, 4) of all bodies in a frame, grains first.
    fn poses<'py>(&self, py: Python<'py>, frame: usize) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        let frames = self.read(py, |r| Ok(r.steps().len()))?;
        if frame >= frames {
            let text = format!("frame: expected less than {frames}, found {frame}");
            return Err(pyo3::exceptions::PyIndexError::new_err(text));
        }
        let poses = self.read(py, |r| r.poses(frame))?;
        let positions: Vec<f64> = poses.iter().flat_map(|p| <[f64; 3]>::from(p.position)).collect();
        let turns = poses.iter().flat_map(|p| <[f64; 4]>::from(p.orientation.coords));
        let turns: Vec<f64> = turns.collect();
        Ok((arrays::table(py, &positions, 3), arrays::table(py, &turns, 4)))
    }

    /// Names of the tables.
    #[getter]
    fn tables(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.read(py, Reader::series_names)
    }

    /// Columns of a table by name, and `step`; units in `units(name)`.
    fn table<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyDict>> {
        let table = self.read(py, |r| r.series(name))?;
        let columns = PyDict::new(py);
        columns.set_item("step", arrays::column(py, &table.steps))?;
        for (i, (column, _)) in table.columns.iter().enumerate() {
            let values = table.rows.iter().skip(i).step_by(table.columns.len());
            let values: Vec<f64> = values.copied().collect();
            columns.set_item(column, arrays::column(py, &values))?;
        }
        Ok(columns)
    }

    /// Units of the columns of a table, by name.
    fn units<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyDict>> {
        let table = self.read(py, |r| r.series(name))?;
        let units = PyDict::new(py);
        for (column, unit) in &table.columns {
            units.set_item(column, unit)?;
        }
        Ok(units)
    }
}

/// A recording (MCAP): an iterator over its windows, each a dictionary with `seq`, `t0_ns`, `t1_ns`, what was asked
/// (`request`), and the `hash` of the state and the `reply_digest` that it led to.
#[pyclass(frozen, module = "ballast")]
pub struct Recording {
    windows: Mutex<Windows>,
}

#[pymethods]
impl Recording {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let windows = Windows::open(&path).map_err(|e| errors::file(py, e))?;
        Ok(Self { windows: Mutex::new(windows) })
    }

    fn __iter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    /// The record of the next window: what was asked, and what was answered.
    fn __next__<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let next = enter_patiently(py, &self.windows).next().map_err(|e| errors::file(py, e))?;
        next.map(|window| as_dict(py, &window.record)).transpose()
    }

    /// Why reading ended early, where it did.
    #[getter]
    fn lost(&self, py: Python<'_>) -> Option<String> {
        enter_patiently(py, &self.windows).lost().map(ToString::to_string)
    }
}
