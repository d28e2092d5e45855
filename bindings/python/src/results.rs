//! What runs have left: results, as arrays.

use crate::arrays::{self, Matrix, Vector};
use crate::errors;
use crate::inputs;
use crate::lock::enter;
use ballast_hdf5::results::{Reader, Table};
use pyo3::exceptions::PyKeyError;
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
    fn read<T: Send>(
        &self,
        py: Python<'_>,
        ask: impl FnOnce(&Reader) -> ballast_hdf5::Result<T> + Send,
    ) -> PyResult<T> {
        py.detach(|| ask(&enter(&self.reader))).map_err(|e| errors::file(py, e))
    }

    /// The table of this name, where there is one.
    fn named(&self, py: Python<'_>, name: &str) -> PyResult<Table> {
        let read = |r: &Reader| {
            let names = r.series_names()?;
            let table = names.iter().any(|known| known == name).then(|| r.series(name));
            Ok((table.transpose()?, names))
        };
        let (table, names) = self.read(py, read)?;
        table.ok_or_else(|| {
            let names = names.join(", ");
            PyKeyError::new_err(format!("table: expected one of {names}, found {name}"))
        })
    }
}

#[pymethods]
impl Results {
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let reader = py.detach(|| Reader::open(path)).map_err(|e| errors::file(py, e))?;
        Ok(Self { reader: Mutex::new(reader) })
    }

    /// Whether the run has closed its results, at its end or where it was told to stop; not while it is going on, nor
    /// where it was killed.
    #[getter]
    fn is_closed(&self) -> bool {
        enter(&self.reader).is_closed()
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
        let steps = self.read(py, |r| Ok(r.steps().to_vec()))?;
        Ok(arrays::column(py, &steps))
    }

    /// (n,) time of each frame, s.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> PyResult<Vector<'py>> {
        let times = self.read(py, Reader::times)?;
        Ok(arrays::column(py, &times))
    }

    /// Positions (n, 3) in m and orientations (n, 4) of all bodies in a frame, grains first.
    fn poses<'py>(
        &self,
        py: Python<'py>,
        frame: &Bound<'py, PyAny>,
    ) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        let frames = self.read(py, |r| Ok(r.steps().len()))?;
        let frame = inputs::index(frame, "frame", frames)?;
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
        let table = self.named(py, name)?;
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
        let table = self.named(py, name)?;
        let units = PyDict::new(py);
        for (column, unit) in &table.columns {
            units.set_item(column, unit)?;
        }
        Ok(units)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (name, frames) = self.read(py, |r| Ok((r.about("case_name")?, r.steps().len())))?;
        let so_far = if self.is_closed() { "" } else { ", not closed" };
        Ok(format!("Results({name:?}, {frames} frames{so_far})"))
    }
}
